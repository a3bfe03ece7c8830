//! Writes the levels of detail of a page file, whose pages of the scene are written.
//!
//! The nodes of [`FAMILY`] neighbouring pages are a family, and its parents fill one page. Families are built from the
//! bottom up, each as soon as its children are, so that few are in memory at a time.

use anyhow::{Result, ensure};
use rayon::prelude::*;
use std::sync::atomic::{AtomicUsize, Ordering};
use twox_hash::XxHash3_64;

use super::output::Output;
use crate::files::{read_exact_at, write_all_at};
use crate::levels::{NEVER, Node, Nodes, code, parents};
use crate::scene::Cancelled;
use crate::storage::pages::{
    Entry, HEADER, LEVEL_WORDS, Level, NO_NODE, NO_PAGE, PADDING, PAGE, Page, level_words,
};
use crate::storage::planes::Shape;

/// Pages of a family.
pub const FAMILY: usize = 2;

/// The largest opacity that fits into 16-bit floats, with room for rounding.
const MOST_OPACITY: f32 = 60_000.0;

/// Number of pages of each level, from the scene up.
fn counts(scene_pages: usize) -> Vec<usize> {
    let mut counts = vec![scene_pages];
    while let Some(last) = counts.last().copied().filter(|last| *last > 1) {
        counts.push(last.div_ceil(FAMILY));
    }
    counts
}

/// Number of pages of nodes that stand for others.
pub fn pages_of_levels(scene_pages: usize) -> usize {
    counts(scene_pages)[1..].iter().sum()
}

/// A page whose parents are not known yet.
struct Built {
    nodes: Nodes,
    page: usize,
    /// The corners of the box around all Gaussians of the scene below it.
    low: [f32; 3],
    high: [f32; 3],
    detail: f32,
}

struct Hierarchy<'h> {
    output: &'h Output<'h>,
    sh_degree: u32,
    /// Gaussians of the scene.
    count: usize,
    counts: Vec<usize>,
    done: AtomicUsize,
    progress: &'h (dyn Fn(f64) + Sync),
    is_cancelled: &'h (dyn Fn() -> bool + Sync),
}

/// Builds and writes all levels above the scene.
///
/// # Errors
/// If the file cannot be read or written; [`Cancelled`].
pub fn build(
    output: &Output,
    (count, sh_degree): (usize, u32),
    progress: &(dyn Fn(f64) + Sync),
    is_cancelled: &(dyn Fn() -> bool + Sync),
) -> Result<()> {
    let counts = counts(count.div_ceil(PAGE));
    let hierarchy = Hierarchy { output, sh_degree, count, done: AtomicUsize::new(0), progress, is_cancelled, counts };
    let top = hierarchy.built(hierarchy.counts.len() - 1, 0)?;
    let never = vec![NEVER; top.nodes.len()];
    hierarchy.write_levels(&top, &never, NO_PAGE)
}

impl Hierarchy<'_> {
    /// The number of the first page of a level.
    fn start(&self, level: usize) -> usize {
        self.counts[..level].iter().sum()
    }

    fn built(&self, level: usize, index: usize) -> Result<Built> {
        let page = self.start(level) + index;
        if level == 0 {
            ensure!(!(self.is_cancelled)(), Cancelled);
            let nodes = self.scene_page(page)?;
            let (low, high) = nodes.bounds();
            return Ok(Built { nodes, page, low, high, detail: 0.0 });
        }
        let below = FAMILY * index..self.counts[level - 1].min(FAMILY * (index + 1));
        let children = below.into_par_iter().map(|child| self.built(level - 1, child)).collect::<Result<Vec<_>>>()?;
        let mut family = Nodes::new(self.sh_degree);
        children.iter().for_each(|child| family.append(&child.nodes));
        let found = parents(&family, family.len().div_ceil(FAMILY));
        ensure!(found.nodes.len() <= PAGE, "a family of {} has {} parents", family.len(), found.nodes.len());
        let mut place = 0;
        for child in &children {
            let of = &found.of_children[place..place + child.nodes.len()];
            let errors: Vec<u16> =
                of.iter().map(|parent| code(found.nodes.nodes[*parent as usize].error.into())).collect();
            self.write_levels(child, &errors, page as u32)?;
            place += child.nodes.len();
        }
        self.write_page(page, &found.nodes)?;
        let side = |corner: fn(&Built) -> [f32; 3], choose: fn(f32, f32) -> f32| -> [f32; 3] {
            let corners = children.iter().map(corner);
            corners.reduce(|a, b| [0, 1, 2].map(|i| choose(a[i], b[i]))).expect("a family has a page")
        };
        let (low, high) = (side(|child| child.low, f32::min), side(|child| child.high, f32::max));
        let detail = children.iter().map(|child| child.detail).fold(found.detail, f32::max);
        let done = 1 + self.done.fetch_add(1, Ordering::Relaxed);
        (self.progress)(done as f64 / self.counts[1..].iter().sum::<usize>() as f64);
        Ok(Built { nodes: found.nodes, page, low, high, detail })
    }

    /// The Gaussians of a page of the scene, as they are drawn.
    fn scene_page(&self, page: usize) -> Result<Nodes> {
        let Output { words, layout, .. } = self.output;
        let mut geometry = vec![0; words.geometry()];
        let mut colours = vec![0; words.colours()];
        for (stream, part) in [&mut geometry, &mut colours].into_iter().enumerate() {
            let bytes = 4 * part.len() as u64;
            let place = self.output.places[stream] + page as u64 * bytes;
            read_exact_at(self.output.file, bytemuck::cast_slice_mut(part), place)?;
            part.iter_mut().for_each(|word| *word = u32::from_le(*word));
        }
        let mut nodes = Nodes::new(self.sh_degree);
        for k in (0..PAGE).filter(|k| geometry[words.ids.start + k] != PADDING) {
            let mean = std::array::from_fn(|axis| f32::from_bits(geometry[4 * k + axis]));
            let (rotation, scale, opacity) = layout.unpacked_shape(&words.shape_of(&geometry, k));
            nodes.push(Node::leaf(mean, rotation, scale, opacity), &layout.unpacked_sh(&words.sh_of(&colours, k)));
        }
        Ok(nodes)
    }

    /// Writes the geometry, the colours and the entry of a page of parents.
    fn write_page(&self, page: usize, nodes: &Nodes) -> Result<()> {
        let Output { words, layout, alpha_min, .. } = self.output;
        let mut geometry = vec![0; words.geometry()];
        let mut colours = vec![0; words.colours()];
        let shape = |k: usize| {
            let Node { mean, rotation, scale, opacity, summed, .. } = nodes.nodes[k];
            // The larger of the two decides how far the node reaches.
            Shape { mean, rotation, scale, opacity: opacity.max(summed).min(MOST_OPACITY) }
        };
        let first = self.count + (page - self.counts[0]) * PAGE;
        let id = |k: usize| (first + k) as u32;
        words.fill_geometry((layout, *alpha_min), nodes.len(), shape, id, &mut geometry);
        words.fill_colours(layout, nodes.len(), &mut colours, |k| nodes.sh(k));
        let summary = Page::of(words, layout, &geometry);
        let mut checksums = [0; 2];
        for (stream, part) in [&mut geometry, &mut colours].into_iter().enumerate() {
            part.iter_mut().for_each(|word| *word = word.to_le());
            let bytes = bytemuck::cast_slice(part);
            checksums[stream] = XxHash3_64::oneshot(bytes);
            write_all_at(self.output.file, bytes, self.output.places[stream] + (page * bytes.len()) as u64)?;
        }
        let entry = Entry { page: summary, checksums };
        write_all_at(self.output.file, &entry.encoded(), (HEADER + page * Entry::BYTES) as u64)?;
        Ok(())
    }

    /// Writes what levels say of a page, whose nodes have parents with these errors on that page.
    fn write_levels(&self, built: &Built, parents: &[u16], parent: u32) -> Result<()> {
        let mut words = vec![0; LEVEL_WORDS * PAGE];
        let is_scene = built.page < self.counts[0];
        for (k, words) in words.as_chunks_mut::<LEVEL_WORDS>().0.iter_mut().enumerate() {
            *words = match built.nodes.nodes.get(k) {
                None => NO_NODE,
                Some(node) => {
                    let opacities = [node.opacity, node.summed].map(|value| value.min(MOST_OPACITY));
                    level_words(code(node.error.into()), parents[k], (!is_scene).then_some(opacities))
                }
            };
        }
        words.iter_mut().for_each(|word| *word = word.to_le());
        let bytes: &[u8] = bytemuck::cast_slice(&words);
        let [.., words_at, table_at] = self.output.places;
        write_all_at(self.output.file, bytes, words_at + (built.page * bytes.len()) as u64)?;
        let level = Level {
            low: built.low,
            high: built.high,
            detail: built.detail,
            checksum: XxHash3_64::oneshot(bytes),
            ..Level::of(&built.nodes, parents, parent)
        };
        let level = Level { most_opacity: level.most_opacity.min(MOST_OPACITY), ..level };
        write_all_at(self.output.file, &level.encoded(), table_at + (built.page * Level::BYTES) as u64)?;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn levels_end_with_one_page() {
        assert_eq!([1, 2, 4, 5, 16, 17].map(pages_of_levels), [0, 1, 3, 6, 15, 20]);
        assert_eq!(counts(17), [17, 9, 5, 3, 2, 1]);
    }
}
