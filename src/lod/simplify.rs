//! Simplifies a group of neighbouring nodes to fewer parents.

use super::density::Density;
use super::fit::{FitOptions, fit};
use super::merge::parent;
use super::node::{Nodes, median};
use super::pairs::merged;
use crate::scene::{Curve, harmonics};

/// The parents of a group of nodes.
#[derive(Clone, Debug, PartialEq)]
pub struct Simplified {
    pub nodes: Nodes,
    /// For each child, the index of its parent.
    pub parent_of_child: Vec<u32>,
    /// The reference pixel width, world units: in wider pixels, the squared difference from the children falls with the
    /// square of the width.
    pub reference_width: f32,
}

/// The blur of densities, as a fraction of the distance between neighbours: smaller differences do not count when pairs
/// are chosen.
const BLUR: f32 = 0.05;

/// Merges children until `wanted` parents are left, which are fitted, measured and put into Morton order.
/// `reference_width`: of the children.
pub fn simplify(children: &Nodes, wanted: usize, reference_width: f32, fit_options: FitOptions) -> Simplified {
    let into = merged(densities(children), wanted);
    // The children, parent by parent.
    let mut members: Vec<u32> = (0..into.len() as u32).collect();
    members.sort_by_key(|child| into[*child as usize]);
    let members_of_parent: Vec<&[u32]> = members.chunk_by(|a, b| into[*a as usize] == into[*b as usize]).collect();
    let mut nodes = Nodes::new(children.sh_degree);
    for members in &members_of_parent {
        match **members {
            [only] => nodes.push(children.nodes[only as usize], children.sh(only as usize)),
            _ => {
                let (node, sh) = parent(children, members);
                nodes.push(node, &sh);
            }
        }
    }
    let is_new: Vec<bool> = members_of_parent.iter().map(|members| members.len() > 1).collect();
    let residual = fit(children, &mut nodes, &is_new, fit_options);
    for ((node, members), squared_error) in nodes.nodes.iter_mut().zip(&members_of_parent).zip(residual.squared_errors)
    {
        let saved = members.len() - 1;
        if saved > 0 {
            node.error = node.error.max((squared_error / saved as f64).sqrt() as f32);
            // In pixels of the reference width of the parents, the errors of the children have fallen.
            let fallen = (reference_width / residual.reference_width as f32).min(1.0).powi(2);
            node.squared_error = node.squared_error * fallen + squared_error as f32;
        }
    }
    // A parent with one child is a copy of it. It gets the median error, so that it is replaced with most of its group.
    let new = nodes.nodes.iter().zip(&is_new).filter(|(_, is_new)| **is_new);
    let typical = median(new.map(|(node, _)| node.error.into()).collect()) as f32;
    let copies = nodes.nodes.iter_mut().zip(&is_new).filter(|(_, is_new)| !**is_new);
    copies.for_each(|(node, _)| node.error = node.error.max(typical));
    let order = morton_order(&nodes);
    let mut position = vec![0; order.len()];
    order.iter().enumerate().for_each(|(new, old)| position[*old as usize] = new as u32);
    let mut parent_of_child = vec![0; children.len()];
    for (number, members) in members_of_parent.iter().enumerate() {
        members.iter().for_each(|child| parent_of_child[*child as usize] = position[number]);
    }
    Simplified { nodes: nodes.selected(&order), parent_of_child, reference_width: residual.reference_width as f32 }
}

/// The projected densities of the children.
fn densities(children: &Nodes) -> Vec<Density> {
    let origin = children.nodes[0].mean;
    let pairs = children.nodes.windows(2);
    let typical = median(pairs.map(|pair| (pair[0].centre() - pair[1].centre()).length()).collect());
    let blur = (BLUR * typical as f32).powi(2).max(1e-20);
    let colour = |i: usize| children.sh(i)[0].map(|value| (0.5 + harmonics::C0 as f32 * value).max(0.0));
    (0..children.len()).map(|i| Density::of(&children.nodes[i], colour(i), origin, blur)).collect()
}

fn morton_order(nodes: &Nodes) -> Vec<u32> {
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
    fn simplified_groups_are_the_same_in_every_run() {
        let children = Nodes::of(&cactus::cactus(4096).unwrap().gaussians, 0..4096);
        let found = simplify(&children, 1024, 0.0, FitOptions::default());
        assert_eq!(found.nodes.len(), 1024);
        let mut members = vec![0; 1024];
        found.parent_of_child.iter().for_each(|parent| members[*parent as usize] += 1);
        assert!(members.iter().all(|count| *count > 0));
        assert!(found.nodes.nodes.iter().all(|node| node.error > 0.0));
        let again = simplify(&children, 1024, 0.0, FitOptions::default());
        assert!(again == found);
    }
}
