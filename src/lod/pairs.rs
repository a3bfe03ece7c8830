//! Chooses the nodes to merge: the cheapest pair first. The costs of a merged node are computed anew.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use super::density::{Density, costs};
use super::neighbours::neighbours;
use super::raster::LANES;

/// Candidates for a merge per node.
const PARTNERS: usize = 8;

/// A pair that may be merged. Ordered by its cost, then by its nodes, so that every run merges the same pairs.
#[derive(PartialEq, Eq, PartialOrd, Ord)]
struct Pair {
    /// The bits of the cost, which is not negative.
    cost: u32,
    nodes: [u32; 2],
    /// The version of each node that the cost was computed for.
    versions: [u32; 2],
}

/// A candidate, and the cost of a merge with it.
#[derive(Clone, Copy)]
struct Partner {
    node: u32,
    /// The version of the candidate that the cost was computed for, or [`UNKNOWN`].
    version: u32,
    /// The bits of the cost.
    cost: u32,
}

const UNKNOWN: u32 = u32::MAX;

impl Partner {
    fn new(node: u32) -> Self {
        Self { node, version: UNKNOWN, cost: 0 }
    }
}

struct Merging {
    densities: Vec<Density>,
    /// The node that each was merged into; itself while it exists.
    into: Vec<u32>,
    /// Number of merges into each node.
    versions: Vec<u32>,
    partners: Vec<Vec<Partner>>,
    pairs: BinaryHeap<Reverse<Pair>>,
    /// Distances of candidates. The memory is used again.
    keyed: Vec<(f32, u32)>,
}

/// Merges nodes until `wanted` are left. Returns the node that each was merged into; itself if it is left.
pub fn merged(densities: Vec<Density>, wanted: usize) -> Vec<u32> {
    let count = densities.len();
    let mut merging = Merging {
        partners: vec![Vec::new(); count],
        densities,
        into: (0..count as u32).collect(),
        versions: vec![0; count],
        pairs: BinaryHeap::with_capacity(2 * count),
        keyed: Vec::new(),
    };
    let mut left = count;
    while left > wanted.max(1) {
        let Some(Reverse(pair)) = merging.pairs.pop() else {
            // Initially, and once all candidates of the remaining nodes are used up.
            merging.find_neighbours();
            continue;
        };
        let [own, other] = pair.nodes;
        if merging.into[own as usize] != own || merging.versions[own as usize] != pair.versions[0] {
            continue;
        }
        if merging.root(other) != other || merging.versions[other as usize] != pair.versions[1] {
            merging.pair(own);
            continue;
        }
        merging.merge(own, other);
        left -= 1;
    }
    (0..count as u32).map(|node| merging.root(node)).collect()
}

impl Merging {
    /// Finds the candidates of all remaining nodes, and queues the cheapest pair of each.
    fn find_neighbours(&mut self) {
        let left: Vec<u32> = (0..self.into.len() as u32).filter(|node| self.into[*node as usize] == *node).collect();
        let mean = |node: &u32| self.densities[*node as usize].mean();
        let means: Vec<[f32; 3]> = left.iter().map(mean).collect();
        for (node, partners) in left.iter().zip(neighbours(&means)) {
            self.partners[*node as usize] =
                partners.into_iter().map(|other| Partner::new(left[other as usize])).collect();
        }
        for node in left {
            self.keep_nearest(node);
            self.pair(node);
        }
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

    /// Takes the candidates of a node, each replaced by the node that it was merged into, without duplicates.
    fn take_partners(&mut self, own: u32) -> Vec<Partner> {
        let mut partners = std::mem::take(&mut self.partners[own as usize]);
        for partner in &mut partners {
            let root = self.root(partner.node);
            if root != partner.node {
                *partner = Partner::new(root);
            }
        }
        partners.sort_unstable_by_key(|partner| partner.node);
        partners.dedup_by_key(|partner| partner.node);
        partners.retain(|partner| partner.node != own);
        partners
    }

    fn keep_nearest(&mut self, node: u32) {
        let mut partners = std::mem::take(&mut self.partners[node as usize]);
        if partners.len() > PARTNERS {
            let (own, keyed) = (&self.densities[node as usize], &mut self.keyed);
            let distance = |other: u32| own.distance(&self.densities[other as usize]);
            keyed.clear();
            keyed.extend(partners.drain(..).map(|other| (distance(other.node), other.node)));
            keyed.select_nth_unstable_by(PARTNERS, |a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
            partners.extend(keyed[..PARTNERS].iter().map(|(_, other)| Partner::new(*other)));
            partners.sort_unstable_by_key(|partner| partner.node);
        }
        self.partners[node as usize] = partners;
    }

    /// Queues the cheapest pair of a node.
    fn pair(&mut self, own: u32) {
        let mut partners = self.take_partners(own);
        let density = |node: u32| &self.densities[node as usize];
        // Costs of unchanged nodes stay valid.
        let mut changed = partners.iter_mut().filter(|partner| partner.version != self.versions[partner.node as usize]);
        loop {
            let some: [Option<&mut Partner>; LANES] = std::array::from_fn(|_| changed.next());
            if some[0].is_none() {
                break;
            }
            let others = some.each_ref().map(|one| density(one.as_ref().map_or(own, |partner| partner.node)));
            let costs = costs(density(own), &others);
            for (partner, cost) in some.into_iter().flatten().zip(costs) {
                (partner.version, partner.cost) = (self.versions[partner.node as usize], cost.to_bits());
            }
        }
        if let Some(Partner { node, version, cost }) =
            partners.iter().min_by_key(|partner| (partner.cost, partner.node))
        {
            let versions = [self.versions[own as usize], *version];
            self.pairs.push(Reverse(Pair { cost: *cost, nodes: [own, *node], versions }));
        }
        self.partners[own as usize] = partners;
    }

    fn merge(&mut self, own: u32, other: u32) {
        self.densities[own as usize] = self.densities[own as usize].merged(&self.densities[other as usize]);
        self.into[other as usize] = own;
        self.versions[own as usize] += 1;
        let theirs = std::mem::take(&mut self.partners[other as usize]);
        let partners = &mut self.partners[own as usize];
        partners.extend(theirs);
        // The costs were those of the two nodes before the merge.
        partners.iter_mut().for_each(|partner| *partner = Partner::new(partner.node));
        self.partners[own as usize] = self.take_partners(own);
        self.keep_nearest(own);
        self.pair(own);
    }
}
