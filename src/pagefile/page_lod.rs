//! The levels of detail of one page: its entry in the table of levels, and the words of levels of its nodes.

use super::page::Page;
use crate::lod::{FINEST, NEVER, Node, code_of};
use crate::scene::along_curve;

/// Parts of a page by error, an eighth of its nodes each. The table has the largest error of each part.
pub const PARTS: usize = 8;

/// Nodes of a page whose means are in the table.
pub const SAMPLES: usize = 8;

/// The parent of a page without parents, as the coarsest.
pub const NO_PAGE: u32 = u32::MAX;

/// Words of levels of a node: its own error and its parent's, its opacity and the sum of opacities.
pub const LEVEL_WORDS: usize = 2;

/// The words of levels of a Gaussian of a scene without levels, which is in every cut.
pub const ALWAYS: [u32; LEVEL_WORDS] = [(NEVER as u32) << 16, 0];

/// A page in a hierarchy. All of its nodes have one distance: that of the camera to a box, which contains the boxes of
/// all pages whose parents are in this page.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PageLod {
    pub low: [f32; 3],
    pub high: [f32; 3],
    /// The reference pixel width, world units: in wider pixels, errors fall with the square of the width. Not less than
    /// that of its children.
    pub reference_width: f32,
    /// A page with the box and the reference width of the parents of its nodes, or [`NO_PAGE`].
    pub parent: u32,
    /// The level of detail: 0 for Gaussians of the scene. The table has it for levels of a source; that of others
    /// follows from the number of the page.
    pub level: u16,
    /// The largest opacity or sum of opacities.
    pub highest_opacity: f32,
    /// The least own error, as a code.
    pub least_error: u16,
    /// The largest own error of each eighth of the nodes, as codes, ascending.
    pub errors: [u16; PARTS],
    /// The largest error of the parents of each eighth of the nodes by that error, as codes, ascending.
    pub parent_errors: [u16; PARTS],
    /// The mean squared error against the scene of each eighth of the nodes by own errors, as codes.
    pub squared_errors: [u16; PARTS],
    /// The means of some nodes: ten bits per axis, quantized in the box of all means.
    pub samples: [u32; SAMPLES],
    /// XXH3 of the words of levels.
    pub checksum: u64,
}

impl PageLod {
    pub const BYTES: usize = 128;

    /// The page of these nodes; `own` and `parents` are the codes of their errors and of their parents' errors, in the
    /// same order. The caller sets the box, the reference width and the page of the parents. `scale`: the factor of the
    /// squared errors in pixels of the reference width of the page.
    pub fn of(nodes: &[Node], [own, parents]: [&[u16]; 2], scale: f32) -> Self {
        let mut own: Vec<(u16, f32)> = own.iter().zip(nodes).map(|(code, node)| (*code, node.squared_error)).collect();
        own.sort_unstable_by(|a, b| a.0.cmp(&b.0).then(a.1.total_cmp(&b.1)));
        let mut parents = parents.to_vec();
        parents.sort_unstable();
        let end = |part: usize| ((part + 1) * nodes.len()).div_ceil(PARTS);
        let squared_error = |part: usize| {
            let nodes = &own[(part * nodes.len()).div_ceil(PARTS)..end(part)];
            let sum: f64 = nodes.iter().map(|(_, squared_error)| f64::from(*squared_error)).sum();
            code_of(f64::from(scale) * sum / nodes.len().max(1) as f64)
        };
        Self {
            low: [0.0; 3],
            high: [0.0; 3],
            reference_width: 0.0,
            parent: NO_PAGE,
            level: 0,
            highest_opacity: nodes.iter().map(|node| node.opacity.max(node.opacity_sum)).fold(0.0, f32::max),
            least_error: own.first().map_or(FINEST, |first| first.0),
            errors: std::array::from_fn(|part| own[end(part) - 1].0),
            parent_errors: std::array::from_fn(|part| parents[end(part) - 1]),
            squared_errors: std::array::from_fn(squared_error),
            samples: samples(nodes),
            checksum: 0,
        }
    }

    /// The entry of a page of a scene without levels: its nodes are in every cut.
    pub fn always(page: &Page) -> Self {
        Self {
            low: page.low,
            high: page.high,
            // Its nodes have no errors that fall in wider pixels.
            reference_width: f32::INFINITY,
            parent: NO_PAGE,
            level: 0,
            highest_opacity: page.highest_opacity,
            least_error: 0,
            errors: [0; PARTS],
            parent_errors: [NEVER; PARTS],
            squared_errors: [0; PARTS],
            samples: [0; SAMPLES],
            checksum: 0,
        }
    }

    /// The same entry in a table in which `pages` others come before it.
    pub fn after(self, pages: u32) -> Self {
        let parent = if self.parent == NO_PAGE { NO_PAGE } else { self.parent + pages };
        Self { parent, ..self }
    }

    pub fn encoded(&self) -> [u8; Self::BYTES] {
        let mut bytes = [0; Self::BYTES];
        let floats = self.low.into_iter().chain(self.high).chain([self.reference_width]).flat_map(f32::to_le_bytes);
        let codes = [self.least_error, self.level]
            .into_iter()
            .chain(self.errors)
            .chain(self.parent_errors)
            .chain(self.squared_errors);
        let all = floats
            .chain(self.parent.to_le_bytes())
            .chain(self.highest_opacity.to_le_bytes())
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
            reference_width: float(6),
            parent: word(7),
            highest_opacity: float(8),
            level: (word(9) >> 16) as u16,
            least_error: word(9) as u16,
            errors: codes(40),
            parent_errors: codes(56),
            squared_errors: codes(72),
            samples: std::array::from_fn(|i| word(22 + i)),
            checksum: u64::from_le_bytes(std::array::from_fn(|k| bytes[120 + k])),
        }
    }

    /// True if no value is out of its range, for page `own` of `pages`. `scene_pages` is the number of pages of the
    /// scene in a file with the levels of a source, in which several pages may have no parents.
    pub fn is_plausible(&self, own: usize, pages: usize, scene_pages: Option<usize>) -> bool {
        let is_box =
            self.low.iter().zip(self.high).all(|(low, high)| low.is_finite() && *low <= high && high.is_finite());
        let is_last = own + 1 == pages;
        let has_parent = (own..pages).contains(&(self.parent as usize));
        let may_lack_parent = is_last || scene_pages.is_some();
        let is_parent = if self.parent == NO_PAGE { may_lack_parent } else { has_parent && !is_last };
        let is_level = scene_pages.is_none_or(|scene_pages| (own < scene_pages) == (self.level == 0));
        is_box
            && self.reference_width >= 0.0
            && is_parent
            && is_level
            && self.highest_opacity >= 0.0
            && self.errors.is_sorted()
            && self.parent_errors.is_sorted()
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
    let [opacity, opacity_sum] = opacities.map_or([0; 2], |both| both.map(|value| code_of(value.into())));
    [u32::from(error) | u32::from(parent) << 16, u32::from(opacity) | u32::from(opacity_sum) << 16]
}

/// The words of padding in the last page: never drawn.
pub const NO_NODE: [u32; LEVEL_WORDS] = [NEVER as u32, 0];

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn levels_are_read_as_they_were_written() {
        let level = PageLod {
            low: [1.0, -2.0, 3.0],
            high: [1.5, 2.0, 3.0],
            reference_width: 0.5,
            parent: 77,
            level: 5,
            highest_opacity: 12.0,
            least_error: 3,
            errors: [3, 4, 5, 6, 7, 8, 9, 60000],
            parent_errors: [10, 11, 12, 13, 14, 15, 16, 17],
            squared_errors: [9, 8, 7, 6, 5, 4, 3, 2],
            samples: [1, 2, 3, 4, 5, 6, 7, u32::MAX],
            checksum: 0x1234_5678_9abc_def0,
        };
        assert_eq!(PageLod::decoded(&level.encoded()), level);
        let are_plausible = |level: PageLod, scene_pages| {
            [(5, 78), (77, 78), (80, 90)].map(|(own, pages)| level.is_plausible(own, pages, scene_pages))
        };
        let none = PageLod { parent: NO_PAGE, ..level };
        assert_eq!(are_plausible(level, None), [true, false, false]);
        assert_eq!(are_plausible(none, None), [false, true, false]);
        // Level 5 is none of the scene.
        assert_eq!(are_plausible(none, Some(5)), [true; 3]);
        assert_eq!(are_plausible(none, Some(6)), [false, true, true]);
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
