//! Approximate nearest neighbours of nodes, found by the order of their means along shifted Morton curves.

use super::density::{Density, Table};
use super::node::corners;
use crate::scene::Curve;

/// Neighbours of a node: its candidates for a merge.
pub const CANDIDATES: usize = 8;
/// Nodes before and after a node along each curve that may be its neighbours.
const WINDOW: usize = 6;
/// Shifts of the boxes of the curves, as fractions of the box: neighbours on both sides of a border of one curve are
/// close on another.
const SHIFTS: [f32; 3] = [0.0, 0.31, 0.17];

/// For each node, the indices of nodes with small [`Density::distance`] to it, the nearest first. The index of the node
/// itself stands for each that is missing.
pub fn neighbours(densities: &[Density]) -> Vec<[u32; CANDIDATES]> {
    let count = densities.len();
    let (low, high) = corners(densities.iter().map(Density::mean));
    // A cube, so that cells of the curve are cubes.
    let side = (0..3).map(|i| high[i] - low[i]).fold(f32::MIN_POSITIVE, f32::max);
    let mut nearest = vec![Nearest([Nearest::NONE; CANDIDATES]); count];
    let mut distances = Vec::new();
    for shift in SHIFTS {
        let from = low.map(|v| v - shift * side);
        let curve = Curve::through(from, from.map(|v| v + 2.0 * side));
        let mut order: Vec<(u64, u32)> =
            (0..count as u32).map(|i| (curve.key(densities[i as usize].mean()), i)).collect();
        order.sort_unstable();
        let table = Table::new(order.iter().map(|(_, i)| &densities[*i as usize]));
        for offset in 1..=WINDOW {
            table.distances(offset, &mut distances);
            for (pair, distance) in order.iter().zip(order.iter().skip(offset)).zip(&distances) {
                let ((_, a), (_, b)) = pair;
                nearest[*a as usize].add(*distance, *b);
                nearest[*b as usize].add(*distance, *a);
            }
        }
    }
    let index = |own: u32, key: u64| if key == Nearest::NONE { own } else { key as u32 };
    (0..).zip(nearest).map(|(own, nearest)| nearest.0.map(|key| index(own, key))).collect()
}

/// The nearest nodes of a node so far, as ascending keys: the bits of the distance above the index.
#[derive(Clone, Copy)]
struct Nearest([u64; CANDIDATES]);

impl Nearest {
    const NONE: u64 = u64::MAX;

    fn add(&mut self, distance: f32, index: u32) {
        // A distance is not negative. One that overflows to NaN counts as 0.
        let new = u64::from(distance.max(0.0).to_bits()) << 32 | u64::from(index);
        if new >= self.0[CANDIDATES - 1] || self.0.contains(&new) {
            return;
        }
        for i in (1..CANDIDATES).rev() {
            self.0[i] = self.0[i].min(new.max(self.0[i - 1]));
        }
        self.0[0] = self.0[0].min(new);
    }
}

#[cfg(test)]
mod tests {
    use super::super::node::Node;
    use super::*;

    fn densities(means: &[[f32; 3]]) -> Vec<Density> {
        let node = |mean: &[f32; 3]| Node::leaf(*mean, [1.0, 0.0, 0.0, 0.0], [0.01; 3], 0.5);
        means.iter().map(|mean| Density::of(&node(mean), [0.5; 3], [0.0; 3], 1e-6)).collect()
    }

    #[test]
    fn most_of_the_nearest_are_found() {
        let noise = |i: u32| (i.wrapping_mul(2_654_435_761) >> 8 & 0xffff) as f32 / 65536.0;
        let points: Vec<[f32; 3]> = (0..803).map(|i| [noise(3 * i), noise(3 * i + 1), noise(3 * i + 2)]).collect();
        let all = densities(&points);
        let near = neighbours(&all);
        let found = (0..all.len()).filter(|own| {
            let others = (0..all.len()).filter(|other| other != own);
            let distance = |i: &usize| all[*own].distance(&all[*i]);
            near[*own][0] as usize == others.min_by(|a, b| distance(a).total_cmp(&distance(b))).unwrap()
        });
        assert!(found.count() > 700);
        for (own, near) in near.iter().enumerate() {
            let found = near.split(|other| *other as usize == own).next().unwrap();
            let distances: Vec<_> = found.iter().map(|i| (all[own].distance(&all[*i as usize]), *i)).collect();
            assert!(found.len() >= 6 && distances.is_sorted_by(|a, b| a < b), "{own}: {distances:?}");
            assert!(near[found.len()..].iter().all(|other| *other as usize == own));
        }
    }

    #[test]
    fn missing_neighbours_are_the_node_itself() {
        assert_eq!(neighbours(&densities(&[[1.0; 3]])), [[0; CANDIDATES]]);
        let two = [[1, 0, 0, 0, 0, 0, 0, 0], [0, 1, 1, 1, 1, 1, 1, 1]];
        assert_eq!(neighbours(&densities(&[[1.0; 3]; 2])), two, "points in one place");
    }
}
