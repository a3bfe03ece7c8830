//! Chooses the nodes to merge: the cheapest pair first. The costs of a merged node are computed anew.

use super::density::{Density, costs};
use super::neighbours::{CANDIDATES, neighbours};
use super::raster::LANES;

const _: () = assert!(CANDIDATES == LANES, "all costs of a node are computed at once");

/// A candidate for a merge, and the cost of a merge with it.
#[derive(Clone, Copy)]
struct Candidate {
    /// The node itself where there is no candidate.
    node: u32,
    /// The version of the candidate that the cost was computed for, or [`UNKNOWN`].
    version: u32,
    /// The bits of the cost, which is not negative.
    cost: u32,
}

const UNKNOWN: u32 = u32::MAX;

impl Candidate {
    fn new(node: u32) -> Self {
        Self { node, version: UNKNOWN, cost: 0 }
    }
}

/// The costs of the cheapest pairs of all nodes, and the least of them, in a binary tree.
struct LeastCosts {
    /// The least of each subtree, from the root at 1: the bits of the cost above the number of the node.
    least: Vec<u64>,
}

impl LeastCosts {
    const NONE: u64 = u64::MAX;

    fn new(nodes: usize) -> Self {
        Self { least: vec![Self::NONE; 2 * nodes.next_power_of_two()] }
    }

    fn set(&mut self, node: u32, cost: Option<u32>) {
        let mut at = self.least.len() / 2 + node as usize;
        self.least[at] = cost.map_or(Self::NONE, |cost| u64::from(cost) << 32 | u64::from(node));
        while at > 1 {
            at /= 2;
            self.least[at] = self.least[2 * at].min(self.least[2 * at + 1]);
        }
    }

    /// The node with the least cost, of several the first.
    fn cheapest(&self) -> Option<u32> {
        let least = self.least[1];
        (least != Self::NONE).then_some(least as u32)
    }
}

struct Merging {
    densities: Vec<Density>,
    /// The node that each was merged into; itself while it exists.
    into: Vec<u32>,
    /// Number of merges into each node.
    versions: Vec<u32>,
    candidates: Vec<[Candidate; CANDIDATES]>,
    least_costs: LeastCosts,
}

/// Merges nodes until `wanted` are left. Returns the node that each was merged into; itself if it is left.
pub fn merged(densities: Vec<Density>, wanted: usize) -> Vec<u32> {
    let count = densities.len();
    let mut merging = Merging {
        densities,
        into: (0..count as u32).collect(),
        versions: vec![0; count],
        // `find_neighbours` chooses these before they are read.
        candidates: vec![[Candidate::new(0); CANDIDATES]; count],
        least_costs: LeastCosts::new(count),
    };
    let mut left = count;
    while left > wanted.max(1) {
        let Some((own, other)) = merging.cheapest_pair() else {
            // Initially, and once all candidates of the remaining nodes are used up.
            merging.find_neighbours();
            continue;
        };
        if merging.root(other.node) == other.node && merging.versions[other.node as usize] == other.version {
            merging.merge(own, other.node);
            left -= 1;
        } else {
            merging.pair(own);
        }
    }
    (0..count as u32).map(|node| merging.root(node)).collect()
}

impl Merging {
    /// Finds the candidates of all remaining nodes, and the cheapest of each.
    fn find_neighbours(&mut self) {
        let left: Vec<u32> = (0..self.into.len() as u32).filter(|node| self.into[*node as usize] == *node).collect();
        let densities: Vec<Density> = left.iter().map(|node| self.densities[*node as usize]).collect();
        for (node, near) in left.iter().zip(neighbours(&densities)) {
            self.candidates[*node as usize] = near.map(|other| Candidate::new(left[other as usize]));
            self.pair(*node);
        }
    }

    /// The candidate of a node with the least cost.
    fn cheapest_candidate(&self, own: u32) -> Option<Candidate> {
        let others = self.candidates[own as usize].into_iter().filter(|candidate| candidate.node != own);
        others.min_by_key(|candidate| (candidate.cost, candidate.node))
    }

    /// The node with the least cost, and its candidate.
    fn cheapest_pair(&self) -> Option<(u32, Candidate)> {
        let own = self.least_costs.cheapest()?;
        Some((own, self.cheapest_candidate(own)?))
    }

    fn root(&mut self, node: u32) -> u32 {
        let mut root = node;
        while self.into[root as usize] != root {
            root = self.into[root as usize];
        }
        let mut node = node;
        while self.into[node as usize] != root {
            node = std::mem::replace(&mut self.into[node as usize], root);
        }
        root
    }

    /// Chooses the cheapest candidate of a node, each replaced by the node that it was merged into.
    fn pair(&mut self, own: u32) {
        let mut candidates = self.candidates[own as usize];
        for i in 0..CANDIDATES {
            let root = self.root(candidates[i].node);
            if root != candidates[i].node {
                let is_known = candidates.iter().any(|candidate| candidate.node == root);
                candidates[i] = Candidate::new(if is_known { own } else { root });
            }
        }
        let is_changed = |candidate: &Candidate| candidate.version != self.versions[candidate.node as usize];
        if candidates.iter().any(is_changed) {
            let others = candidates.each_ref().map(|candidate| &self.densities[candidate.node as usize]);
            for (candidate, cost) in candidates.iter_mut().zip(costs(&self.densities[own as usize], &others)) {
                (candidate.version, candidate.cost) = (self.versions[candidate.node as usize], cost.to_bits());
            }
        }
        self.candidates[own as usize] = candidates;
        self.least_costs.set(own, self.cheapest_candidate(own).map(|candidate| candidate.cost));
    }

    fn merge(&mut self, own: u32, other: u32) {
        self.densities[own as usize] = self.densities[own as usize].merged(&self.densities[other as usize]);
        self.into[other as usize] = own;
        self.versions[own as usize] += 1;
        self.least_costs.set(other, None);
        let both = [own, other].map(|node| self.candidates[node as usize]);
        let mut near = [(f32::INFINITY, own); 2 * CANDIDATES];
        let mut count = 0;
        for candidate in both.as_flattened() {
            let node = self.root(candidate.node);
            if node != own && near[..count].iter().all(|(_, known)| *known != node) {
                near[count].1 = node;
                count += 1;
            }
        }
        if count > CANDIDATES {
            for (distance, node) in &mut near[..count] {
                *distance = self.densities[own as usize].distance(&self.densities[*node as usize]);
            }
            near[..count].select_nth_unstable_by(CANDIDATES, |a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        }
        self.candidates[own as usize] = std::array::from_fn(|i| Candidate::new(near[i].1));
        self.pair(own);
    }
}

#[cfg(test)]
mod tests {
    use super::super::node::Node;
    use super::*;

    fn densities(means: impl Iterator<Item = [f32; 3]>) -> Vec<Density> {
        let node = |mean| Node::leaf(mean, [1.0, 0.0, 0.0, 0.0], [0.1; 3], 0.5);
        means.map(|mean| Density::of(&node(mean), [0.5; 3], [0.0; 3], 1e-6)).collect()
    }

    #[test]
    fn the_least_cost_is_that_of_all_nodes() {
        let (mut tree, mut costs) = (LeastCosts::new(5), [None; 5]);
        for step in 0_u32..200 {
            let hash = step.wrapping_mul(2_654_435_761) >> 16;
            let (node, cost) = (hash % 5, (hash % 7 > 0).then_some(hash / 5 % 4));
            tree.set(node, cost);
            costs[node as usize] = cost;
            let least = (0..5).filter_map(|node: u32| Some((costs[node as usize]?, node))).min();
            assert_eq!(tree.cheapest(), least.map(|(_, node)| node));
        }
    }

    #[test]
    fn the_wanted_number_of_nodes_is_left() {
        for (count, wanted, left) in [(0, 0, 0), (1, 0, 1), (2, 0, 1), (2, 1, 1), (9, 9, 9), (40, 1, 1), (40, 7, 7)] {
            for spread in [0.0, 1.0] {
                let into = merged(densities((0..count).map(|i| [spread * (i * i % 17) as f32, 0.0, 1.0])), wanted);
                assert_eq!(into.len(), count);
                assert_eq!((0..).zip(&into).filter(|(node, root)| node == *root).count(), left, "{count} {wanted}");
                assert!(into.iter().all(|root| into[*root as usize] == *root));
            }
        }
    }

    #[test]
    fn near_nodes_are_merged_first() {
        let into = merged(densities([0.0, 10.0, 0.1, 20.0, 10.1].map(|x| [x, 0.0, 0.0]).into_iter()), 3);
        assert!(into[0] == into[2] && into[1] == into[4] && into[3] == 3, "{into:?}");
    }
}
