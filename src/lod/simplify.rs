//! Neighbouring nodes and their parents.

use std::collections::BTreeMap;

use super::density::Blob;
use super::fit::fit;
use super::median::median;
use super::merge::parent;
use super::node::Nodes;
use super::pairs::merged;
use crate::scene::{Curve, harmonics};

/// The parents of a family.
#[derive(Clone, Debug)]
pub struct Parents {
    pub nodes: Nodes,
    /// For each child, the index of its parent.
    pub of_children: Vec<u32>,
    /// Differences show whole in pixels up to this width, world units, and fall with the square of it beyond.
    pub detail: f32,
}

/// The part of the distance to a neighbour under which differences do not count when pairs are chosen.
const BLURRED: f32 = 0.05;

/// Finds `wanted` parents of these children, in the order of their places. `detail`: that of the children.
pub fn parents(children: &Nodes, wanted: usize, detail: f32) -> Parents {
    let into = merged(blobs(children), wanted);
    let mut groups: BTreeMap<u32, Vec<u32>> = BTreeMap::new();
    for (child, root) in into.iter().enumerate() {
        groups.entry(*root).or_default().push(child as u32);
    }
    let mut nodes = Nodes::new(children.sh_degree);
    for members in groups.values() {
        match members[..] {
            [only] => nodes.push(children.nodes[only as usize], children.sh(only as usize)),
            _ => {
                let (node, sh) = parent(children, members);
                nodes.push(node, &sh);
            }
        }
    }
    let is_new: Vec<bool> = groups.values().map(|members| members.len() > 1).collect();
    let left = fit(children, &mut nodes, &is_new);
    for ((node, members), energy) in nodes.nodes.iter_mut().zip(groups.values()).zip(left.energies) {
        let saved = members.len() - 1;
        if saved > 0 {
            node.error = node.error.max((energy / saved as f64).sqrt() as f32);
            // In the pixels in which the parents are drawn, the errors of the children have fallen.
            let fallen = (detail / left.detail as f32).min(1.0).powi(2);
            node.energy = node.energy * fallen + energy as f32;
        }
    }
    // A node that has no brother is the same on both pages. It changes pages as most of the family does.
    let new = nodes.nodes.iter().zip(&is_new).filter(|(_, is_new)| **is_new);
    let typical = median(new.map(|(node, _)| node.error.into()).collect()) as f32;
    let copies = nodes.nodes.iter_mut().zip(&is_new).filter(|(_, is_new)| !**is_new);
    copies.for_each(|(node, _)| node.error = node.error.max(typical));
    let order = along_a_curve(&nodes);
    let mut place = vec![0; order.len()];
    order.iter().enumerate().for_each(|(new, old)| place[*old as usize] = new as u32);
    let mut of_children = vec![0; children.len()];
    for (number, members) in groups.values().enumerate() {
        members.iter().for_each(|child| of_children[*child as usize] = place[number]);
    }
    Parents { nodes: nodes.selected(&order), of_children, detail: left.detail as f32 }
}

/// The children as the choice of pairs sees them.
fn blobs(children: &Nodes) -> Vec<Blob> {
    let origin = children.nodes[0].mean;
    let pairs = children.nodes.windows(2);
    let typical = median(pairs.map(|pair| (pair[0].centre() - pair[1].centre()).length()).collect());
    let blur = (BLURRED * typical as f32).powi(2).max(1e-20);
    let colour = |i: usize| children.sh(i)[0].map(|value| (0.5 + harmonics::C0 as f32 * value).max(0.0));
    (0..children.len()).map(|i| Blob::of(&children.nodes[i], colour(i), origin, blur)).collect()
}

fn along_a_curve(nodes: &Nodes) -> Vec<u32> {
    let (low, high) = nodes.bounds();
    let curve = Curve::through(low, high);
    let mut keyed: Vec<(u64, u32)> =
        nodes.nodes.iter().enumerate().map(|(i, node)| (curve.key(node.mean), i as u32)).collect();
    keyed.sort_unstable();
    keyed.into_iter().map(|(_, i)| i).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::procedural::cactus;

    #[test]
    fn families_of_a_scene_lose_little_and_the_same_in_every_run() {
        let children = Nodes::of(&cactus::cactus(4096).unwrap().gaussians);
        let found = parents(&children, 1024, 0.0);
        assert_eq!(found.nodes.len(), 1024);
        let mut members = vec![0; 1024];
        found.of_children.iter().for_each(|parent| members[*parent as usize] += 1);
        assert!(members.iter().all(|count| *count > 0));
        assert!(found.nodes.nodes.iter().all(|node| node.error > 0.0));
        let again = parents(&children, 1024, 0.0);
        assert_eq!((again.nodes, again.of_children), (found.nodes, found.of_children));
    }
}
