//! What a page file with levels of detail says of a page: where its nodes are allowed to be drawn, and their errors.

use crate::lod::{FINEST, NEVER, Node, code};
use crate::scene::along_curve;

/// Parts of a page, in the order of their errors, whose largest error is known.
pub const PARTS: usize = 8;

/// Nodes of a page whose places are known without reading it.
pub const SAMPLES: usize = 8;

/// The number of no page: of the parent of the coarsest one.
pub const NO_PAGE: u32 = u32::MAX;

/// Words of levels that a Gaussian takes: its own error and its parent's, its opacity and the sum of opacities.
pub const LEVEL_WORDS: usize = 2;

/// A page in a hierarchy. All of its nodes are judged from one distance: that of the camera to a box, which holds the
/// boxes of all pages whose parents are in it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Level {
    pub low: [f32; 3],
    pub high: [f32; 3],
    /// Errors show whole in pixels up to this width, world units; not less than that of its children.
    pub detail: f32,
    /// A page with the box and the detail by which the parents of its nodes are judged, or [`NO_PAGE`].
    pub parent: u32,
    /// The largest opacity or sum of opacities.
    pub most_opacity: f32,
    /// The least code of an own error.
    pub least: u16,
    /// The own errors as codes, ascending: the largest of each eighth of the nodes.
    pub errors: [u16; PARTS],
    /// The same of the errors of parents.
    pub parents: [u16; PARTS],
    /// For each eighth of the nodes by own errors: the mean squared error against the scene, as a code.
    pub energies: [u16; PARTS],
    /// The means of some nodes: for each axis ten bits with a place among 1024 equal parts of the box of all means.
    pub samples: [u32; SAMPLES],
    /// XXH3 of the words of levels.
    pub checksum: u64,
}

impl Level {
    pub const BYTES: usize = 128;

    /// The page of these nodes; `own` and `parents` are the codes of their errors and of those of their parents, in the
    /// same order. The box, the detail and the page of the parents are set by the caller. `fallen`: the part of the
    /// squared errors of the nodes that is left in pixels as wide as that detail.
    pub fn of(nodes: &[Node], [own, parents]: [&[u16]; 2], fallen: f32) -> Self {
        let mut own: Vec<(u16, f32)> = own.iter().zip(nodes).map(|(code, node)| (*code, node.energy)).collect();
        own.sort_unstable_by(|a, b| a.0.cmp(&b.0).then(a.1.total_cmp(&b.1)));
        let mut parents = parents.to_vec();
        parents.sort_unstable();
        let end = |part: usize| ((part + 1) * nodes.len()).div_ceil(PARTS);
        let energy = |part: usize| {
            let nodes = &own[(part * nodes.len()).div_ceil(PARTS)..end(part)];
            let sum: f64 = nodes.iter().map(|(_, energy)| f64::from(*energy)).sum();
            code(f64::from(fallen) * sum / nodes.len().max(1) as f64)
        };
        Self {
            low: [0.0; 3],
            high: [0.0; 3],
            detail: 0.0,
            parent: NO_PAGE,
            most_opacity: nodes.iter().map(|node| node.opacity.max(node.summed)).fold(0.0, f32::max),
            least: own.first().map_or(FINEST, |first| first.0),
            errors: std::array::from_fn(|part| own[end(part) - 1].0),
            parents: std::array::from_fn(|part| parents[end(part) - 1]),
            energies: std::array::from_fn(energy),
            samples: samples(nodes),
            checksum: 0,
        }
    }

    pub fn encoded(&self) -> [u8; Self::BYTES] {
        let mut bytes = [0; Self::BYTES];
        let floats = self.low.into_iter().chain(self.high).chain([self.detail]).flat_map(f32::to_le_bytes);
        let codes = [self.least, 0].into_iter().chain(self.errors).chain(self.parents).chain(self.energies);
        let all = floats
            .chain(self.parent.to_le_bytes())
            .chain(self.most_opacity.to_le_bytes())
            .chain(codes.flat_map(u16::to_le_bytes))
            .chain(self.samples.into_iter().flat_map(u32::to_le_bytes))
            .chain(self.checksum.to_le_bytes());
        bytes.iter_mut().zip(all).for_each(|(to, from)| *to = from);
        bytes
    }

    pub fn decoded(bytes: &[u8; Self::BYTES]) -> Self {
        let word = |i: usize| u32::from_le_bytes(std::array::from_fn(|k| bytes[4 * i + k]));
        let float = |i: usize| f32::from_bits(word(i));
        let codes = |first: usize| -> [u16; PARTS] {
            std::array::from_fn(|i| u16::from_le_bytes([bytes[first + 2 * i], bytes[first + 2 * i + 1]]))
        };
        Self {
            low: [0, 1, 2].map(float),
            high: [3, 4, 5].map(float),
            detail: float(6),
            parent: word(7),
            most_opacity: float(8),
            least: word(9) as u16,
            errors: codes(40),
            parents: codes(56),
            energies: codes(72),
            samples: std::array::from_fn(|i| word(22 + i)),
            checksum: u64::from_le_bytes(std::array::from_fn(|k| bytes[120 + k])),
        }
    }

    /// True if no value is out of its range, for page `own` of `pages`.
    pub fn is_plausible(&self, own: usize, pages: usize) -> bool {
        let is_box =
            self.low.iter().zip(self.high).all(|(low, high)| low.is_finite() && *low <= high && high.is_finite());
        let is_last = own + 1 == pages;
        let has_parent = (own..pages).contains(&(self.parent as usize));
        let is_parent = if is_last { self.parent == NO_PAGE } else { has_parent };
        is_box
            && self.detail >= 0.0
            && is_parent
            && self.most_opacity >= 0.0
            && self.errors.is_sorted()
            && self.parents.is_sorted()
    }
}

/// The means of some nodes of a page: that in the middle of every eighth of them along a curve through space.
fn samples(nodes: &[Node]) -> [u32; SAMPLES] {
    let means: Vec<[f32; 3]> = nodes.iter().map(|node| node.mean).collect();
    let corner = |start: f32, pick: fn(f32, f32) -> f32| {
        means.iter().fold([start; 3], |corner, mean| std::array::from_fn(|axis| pick(corner[axis], mean[axis])))
    };
    let (low, high) = (corner(f32::INFINITY, f32::min), corner(f32::NEG_INFINITY, f32::max));
    let order = along_curve(&means);
    std::array::from_fn(|i| {
        let place = order.get((2 * i + 1) * means.len() / (2 * SAMPLES));
        place.map_or(0, |place| sample(means[*place as usize], low, high))
    })
}

/// A point in the box from `low` to `high`: for each axis ten bits with a place among 1024 equal parts, x lowest.
fn sample(point: [f32; 3], low: [f32; 3], high: [f32; 3]) -> u32 {
    let part = |axis: usize| {
        let [point, low, high] = [point, low, high].map(|corner| f64::from(corner[axis]));
        if high > low { ((point - low) / (high - low) * 1024.0).clamp(0.0, 1023.0) as u32 } else { 0 }
    };
    part(0) | part(1) << 10 | part(2) << 20
}

/// The words of levels of a node.
pub fn level_words(error: u16, parent: u16, opacities: Option<[f32; 2]>) -> [u32; LEVEL_WORDS] {
    let [opacity, summed] = opacities.map_or([0; 2], |both| both.map(|value| code(value.into())));
    [u32::from(error) | u32::from(parent) << 16, u32::from(opacity) | u32::from(summed) << 16]
}

/// The words of a place in the last page that holds no node: it is never drawn.
pub const NO_NODE: [u32; LEVEL_WORDS] = [NEVER as u32, 0];

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn levels_are_read_as_they_were_written() {
        let level = Level {
            low: [1.0, -2.0, 3.0],
            high: [1.5, 2.0, 3.0],
            detail: 0.5,
            parent: 77,
            most_opacity: 12.0,
            least: 3,
            errors: [3, 4, 5, 6, 7, 8, 9, 60000],
            parents: [10, 11, 12, 13, 14, 15, 16, 17],
            energies: [9, 8, 7, 6, 5, 4, 3, 2],
            samples: [1, 2, 3, 4, 5, 6, 7, u32::MAX],
            checksum: 0x1234_5678_9abc_def0,
        };
        assert_eq!(Level::decoded(&level.encoded()), level);
        assert!(level.is_plausible(5, 78) && !level.is_plausible(77, 78) && !level.is_plausible(80, 90));
        assert!(Level { parent: NO_PAGE, ..level }.is_plausible(77, 78));
    }

    #[test]
    fn samples_lie_near_their_nodes() {
        let nodes: Vec<Node> =
            (0..100).map(|i| Node::leaf([i as f32, -1.0, 5.0], [1.0, 0.0, 0.0, 0.0], [1.0; 3], 1.0)).collect();
        let found = samples(&nodes).map(|sample| f64::from(sample & 1023) / 1024.0 * 99.0);
        for (found, expected) in found.into_iter().zip([6.0, 18.0, 31.0, 43.0, 56.0, 68.0, 81.0, 93.0]) {
            assert!((found - expected).abs() < 0.1, "{found}, not {expected}");
        }
        assert_eq!(sample([1.0, 2.0, 3.0], [0.0; 3], [1.0, 4.0, 3.0]), 1023 | 512 << 10 | 1023 << 20);
    }
}
