//! Which nodes are merged: pairs, the cheapest first, with costs that are computed anew after every merge.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use super::density::Blob;
use super::neighbours::neighbours;

/// Neighbours of a node that are looked at for a partner.
const PARTNERS: usize = 8;

/// A pair that may be merged. Ordered by its cost, then by its nodes, so that every run merges the same pairs.
#[derive(PartialEq, Eq, PartialOrd, Ord)]
struct Pair {
    /// The bits of the cost, which is not negative.
    cost: u32,
    nodes: [u32; 2],
    /// How often each node had been merged when the cost was computed.
    versions: [u32; 2],
}

/// A neighbour, and the cost of a merge with it.
#[derive(Clone, Copy)]
struct Partner {
    node: u32,
    /// How often it had been merged when the cost was computed, or [`UNKNOWN`].
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
    blobs: Vec<Blob>,
    /// For a node that was merged into another: that one.
    into: Vec<u32>,
    versions: Vec<u32>,
    near: Vec<Vec<Partner>>,
    pairs: BinaryHeap<Reverse<Pair>>,
}

/// Merges nodes until `wanted` are left. Returns for each node the one that it was merged into, which is itself for
/// those that are left.
pub fn merged(blobs: Vec<Blob>, wanted: usize) -> Vec<u32> {
    let count = blobs.len();
    let mut merging = Merging {
        near: vec![Vec::new(); count],
        blobs,
        into: (0..count as u32).collect(),
        versions: vec![0; count],
        pairs: BinaryHeap::with_capacity(2 * count),
    };
    let mut left = count;
    while left > wanted.max(1) {
        let Some(Reverse(pair)) = merging.pairs.pop() else {
            // At first, and where all neighbours of some nodes were merged with one another.
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
    /// Finds the neighbours of all nodes that are left, and their partners.
    fn find_neighbours(&mut self) {
        let left: Vec<u32> = (0..self.into.len() as u32).filter(|node| self.into[*node as usize] == *node).collect();
        let mean = |node: &u32| self.blobs[*node as usize].mean();
        let means: Vec<[f32; 3]> = left.iter().map(mean).collect();
        for (node, near) in left.iter().zip(neighbours(&means)) {
            self.near[*node as usize] = near.into_iter().map(|other| Partner::new(left[other as usize])).collect();
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

    /// Takes the neighbours of a node, as the nodes that they were merged into, each once.
    fn left_near(&mut self, own: u32) -> Vec<Partner> {
        let mut near = std::mem::take(&mut self.near[own as usize]);
        for partner in &mut near {
            let root = self.root(partner.node);
            if root != partner.node {
                *partner = Partner::new(root);
            }
        }
        near.sort_unstable_by_key(|partner| partner.node);
        near.dedup_by_key(|partner| partner.node);
        near.retain(|partner| partner.node != own);
        near
    }

    fn keep_nearest(&mut self, node: u32) {
        let mut near = std::mem::take(&mut self.near[node as usize]);
        if near.len() > PARTNERS {
            let own = &self.blobs[node as usize];
            let mut keyed: Vec<(f32, u32)> =
                near.iter().map(|other| (own.distance(&self.blobs[other.node as usize]), other.node)).collect();
            keyed.select_nth_unstable_by(PARTNERS, |a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
            near = keyed[..PARTNERS].iter().map(|(_, other)| Partner::new(*other)).collect();
            near.sort_unstable_by_key(|partner| partner.node);
        }
        self.near[node as usize] = near;
    }

    /// Notes the cheapest partner of a node.
    fn pair(&mut self, own: u32) {
        let mut near = self.left_near(own);
        let blob = &self.blobs[own as usize];
        for partner in &mut near {
            let other = partner.node as usize;
            // Most were not merged since: one of them was.
            if partner.version != self.versions[other] {
                let cost = blob.cost(&self.blobs[other]).to_bits();
                *partner = Partner { version: self.versions[other], cost, ..*partner };
            }
        }
        if let Some(Partner { node, version, cost }) = near.iter().min_by_key(|partner| (partner.cost, partner.node)) {
            let versions = [self.versions[own as usize], *version];
            self.pairs.push(Reverse(Pair { cost: *cost, nodes: [own, *node], versions }));
        }
        self.near[own as usize] = near;
    }

    fn merge(&mut self, own: u32, other: u32) {
        self.blobs[own as usize] = self.blobs[own as usize].merged(&self.blobs[other as usize]);
        self.into[other as usize] = own;
        self.versions[own as usize] += 1;
        let theirs = std::mem::take(&mut self.near[other as usize]);
        let near = &mut self.near[own as usize];
        near.extend(theirs);
        // All of them were costs of what the two had been.
        near.iter_mut().for_each(|partner| *partner = Partner::new(partner.node));
        self.near[own as usize] = self.left_near(own);
        self.keep_nearest(own);
        self.pair(own);
    }
}
