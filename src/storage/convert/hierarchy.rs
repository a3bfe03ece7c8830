//! Writes the levels of detail of a page file, whose pages of the scene are written.
//!
//! The nodes of [`FLOOR`] neighbouring pages are the floor of a block. They are halved three times: floor, first level,
//! second level, top. The top fills one page, and is a part of the floor of the block above. A block is judged from one
//! distance, so its nodes are put into pages by the errors of their parents: the nodes of a page leave the picture at
//! about the same distance. Blocks are built from the bottom up, each as soon as those below are, so that few are in
//! memory at a time.

use std::ops::Range;
use std::sync::atomic::{AtomicUsize, Ordering};

use anyhow::{Result, ensure};
use rayon::prelude::*;
use twox_hash::XxHash3_64;

use super::output::Output;
use super::storeys::{FLOOR, Storey, storeys};
use crate::files::{read_exact_at, write_all_at};
use crate::levels::{NEVER, Node, Nodes, code, parents};
use crate::scene::Cancelled;
use crate::storage::pages::{
    Entry, HEADER, LEVEL_WORDS, Level, NO_NODE, NO_PAGE, PADDING, PAGE, Page, PageRecord, level_words,
};
use crate::storage::planes::Shape;

/// The largest opacity that fits into 16-bit floats, with room for rounding.
const MOST_OPACITY: f32 = 60_000.0;

/// The top of a block, whose parents are not known yet.
struct Top {
    nodes: Nodes,
    /// The second level, whose pages are written once the block above is known.
    second: Second,
    low: [f32; 3],
    high: [f32; 3],
    /// Of the block.
    detail: f32,
    /// Of the top itself.
    own_detail: f32,
}

/// The second level of a block: its pages and what their table says but for the block above.
struct Second {
    pages: Vec<(usize, Level)>,
}

struct Hierarchy<'h> {
    output: &'h Output<'h>,
    sh_degree: u32,
    /// Gaussians of the scene.
    count: usize,
    storeys: Vec<Storey>,
    done: AtomicUsize,
    progress: &'h (dyn Fn(f64) + Sync),
    is_cancelled: &'h (dyn Fn() -> bool + Sync),
}

/// The box and the detail that all pages of a block share.
#[derive(Clone, Copy)]
struct Place {
    low: [f32; 3],
    high: [f32; 3],
    detail: f32,
    /// The detail of the level that is written, which is finer.
    own_detail: f32,
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
    let (storeys, done) = (storeys(count), AtomicUsize::new(0));
    let hierarchy = Hierarchy { output, sh_degree, count, done, progress, is_cancelled, storeys };
    let (page, top) = match hierarchy.storeys.last() {
        None => {
            let (nodes, _) = hierarchy.scene_pages(0..1)?;
            let (low, high) = nodes.bounds();
            let level = hierarchy.write_words(
                0,
                &nodes,
                &vec![NEVER; nodes.len()],
                Place { low, high, detail: 0.0, own_detail: 0.0 },
            )?;
            return hierarchy.write_level(0, Level { parent: NO_PAGE, ..level });
        }
        Some(storey) => (storey.above().first, hierarchy.block(hierarchy.storeys.len() - 1, 0)?),
    };
    let place = Place { low: top.low, high: top.high, detail: top.detail, own_detail: top.own_detail };
    let order: Vec<u32> = (0..top.nodes.len() as u32).collect();
    let [(page, level)] = hierarchy.write_nodes(page, &top.nodes, &order, &vec![NEVER; order.len()], place)?[..] else {
        unreachable!("a top fills one page")
    };
    hierarchy.write_level(page, Level { parent: NO_PAGE, ..level })?;
    hierarchy.finish(&top.second, page)
}

impl Hierarchy<'_> {
    /// Builds a block and all below it, and writes all of it but its top and the table of its second level.
    fn block(&self, storey: usize, block: usize) -> Result<Top> {
        ensure!(!(self.is_cancelled)(), Cancelled);
        let own = self.storeys[storey];
        let pages = own.pages_of(block);
        let (floor, records, below) = if own.is_ground {
            let begin = block * FLOOR;
            let (nodes, records) = self.scene_pages(begin..(begin + FLOOR).min(self.count.div_ceil(PAGE)))?;
            (nodes, records, Vec::new())
        } else {
            let under = &self.storeys[storey - 1];
            let below = block * FLOOR..under.blocks().min((block + 1) * FLOOR);
            let tops = below.into_par_iter().map(|below| self.block(storey - 1, below)).collect::<Result<Vec<_>>>()?;
            let mut nodes = Nodes::new(self.sh_degree);
            tops.iter().for_each(|top| nodes.append(&top.nodes));
            (nodes, Vec::new(), tops)
        };
        let of_floors = below.iter().map(|top| top.own_detail).fold(0.0, f32::max);
        let first = parents(&floor, floor.len().div_ceil(2), of_floors);
        let second = parents(&first.nodes, first.nodes.len().div_ceil(2), first.detail);
        let top = parents(&second.nodes, second.nodes.len().div_ceil(2), second.detail);
        let place = match &below[..] {
            [] => {
                let (low, high) = floor.bounds();
                Place { low, high, detail: 0.0, own_detail: 0.0 }
            }
            tops => {
                let side = |corner: fn(&Top) -> [f32; 3], choose: fn(f32, f32) -> f32| -> [f32; 3] {
                    let corners = tops.iter().map(corner);
                    corners.reduce(|a, b| [0, 1, 2].map(|i| choose(a[i], b[i]))).expect("there are blocks below")
                };
                let detail = tops.iter().map(|top| top.detail).fold(0.0, f32::max);
                Place {
                    low: side(|top| top.low, f32::min),
                    high: side(|top| top.high, f32::max),
                    detail,
                    own_detail: of_floors,
                }
            }
        };
        let detail = [first.detail, second.detail, top.detail].into_iter().fold(place.detail, f32::max);
        let place = Place { detail, ..place };
        // Who is the parent of a node is known by its error alone from here on.
        let errors = |children: &[u32], parents: &Nodes| -> Vec<u16> {
            children.iter().map(|parent| code(parents.nodes[*parent as usize].error.into())).collect()
        };
        let of_floor = errors(&first.of_children, &first.nodes);
        if own.is_ground {
            let order = by_error(&of_floor);
            self.rewrite_scene(pages[0], (&floor, &records), &order, &of_floor, place)?;
        } else {
            for (page, level) in self.write_nodes(pages[0], &floor, &by_error(&of_floor), &of_floor, place)? {
                self.write_level(page, Level { parent: page as u32, ..level })?;
            }
            below.iter().try_for_each(|top| self.finish(&top.second, pages[0]))?;
        }
        let of_first = errors(&second.of_children, &second.nodes);
        for (page, level) in self.write_nodes(
            pages[1],
            &first.nodes,
            &by_error(&of_first),
            &of_first,
            Place { own_detail: first.detail, ..place },
        )? {
            self.write_level(page, Level { parent: page as u32, ..level })?;
        }
        let of_second = errors(&top.of_children, &top.nodes);
        let written = self.write_nodes(
            pages[2],
            &second.nodes,
            &by_error(&of_second),
            &of_second,
            Place { own_detail: second.detail, ..place },
        )?;
        let done = floor.len() + self.done.fetch_add(floor.len(), Ordering::Relaxed);
        (self.progress)(done as f64 / self.storeys.iter().map(|storey| storey.nodes).sum::<usize>() as f64);
        let Place { low, high, detail, .. } = place;
        let own_detail = top.detail;
        Ok(Top { nodes: top.nodes, second: Second { pages: written }, low, high, detail, own_detail })
    }

    /// Writes the table of a second level: its parents are on `page`.
    fn finish(&self, second: &Second, page: usize) -> Result<()> {
        let write = |(own, level): &(usize, Level)| self.write_level(*own, Level { parent: page as u32, ..*level });
        second.pages.iter().try_for_each(write)
    }

    /// The Gaussians of some pages of the scene as they are drawn, and their words.
    fn scene_pages(&self, pages: Range<usize>) -> Result<(Nodes, Vec<PageRecord>)> {
        let Output { words, layout, .. } = self.output;
        let (mut nodes, mut records) = (Nodes::new(self.sh_degree), Vec::new());
        for page in pages {
            let [geometry, colours] = self.read_page(page)?;
            for k in (0..PAGE).filter(|k| geometry[words.ids.start + k] != PADDING) {
                let mean = std::array::from_fn(|axis| f32::from_bits(geometry[4 * k + axis]));
                let (rotation, scale, opacity) = layout.unpacked_shape(&words.shape_of(&geometry, k));
                nodes.push(Node::leaf(mean, rotation, scale, opacity), &layout.unpacked_sh(&words.sh_of(&colours, k)));
                records.push(words.record(&geometry, &colours, k));
            }
        }
        Ok((nodes, records))
    }

    /// The words of the geometry and of the colours of a page.
    fn read_page(&self, page: usize) -> Result<[Vec<u32>; 2]> {
        let words = &self.output.words;
        let mut streams = [words.geometry(), words.colours()].map(|words| vec![0_u32; words]);
        for (stream, place) in streams.iter_mut().zip(self.output.places) {
            let bytes = 4 * stream.len() as u64;
            read_exact_at(self.output.file, bytemuck::cast_slice_mut(stream), place + page as u64 * bytes)?;
            stream.iter_mut().for_each(|word| *word = u32::from_le(*word));
        }
        Ok(streams)
    }

    /// Writes the Gaussians of a block on the ground again, in another order, from page `first` on.
    fn rewrite_scene(
        &self,
        first: usize,
        (nodes, records): (&Nodes, &[PageRecord]),
        order: &[u32],
        parents: &[u16],
        place: Place,
    ) -> Result<()> {
        for (number, part) in order.chunks(PAGE).enumerate() {
            let page = first + number;
            let records: Vec<&PageRecord> = part.iter().map(|index| &records[*index as usize]).collect();
            self.write_page(page, |geometry, colours| self.output.words.fill_records(&records, geometry, colours))?;
            let chosen: Vec<u16> = part.iter().map(|i| parents[*i as usize]).collect();
            let level = self.write_words(page, &nodes.selected(part), &chosen, place)?;
            self.write_level(page, Level { parent: page as u32, ..level })?;
        }
        Ok(())
    }

    /// Writes nodes that stand for others in this order, from page `first` on; `parents` are the codes of the errors of
    /// their parents. Returns the pages and their entries in the table of levels, without the page of the parents.
    fn write_nodes(
        &self,
        first: usize,
        nodes: &Nodes,
        order: &[u32],
        parents: &[u16],
        place: Place,
    ) -> Result<Vec<(usize, Level)>> {
        let write = |(number, part): (usize, &[u32])| {
            let page = first + number;
            let shape = |k: usize| {
                let Node { mean, rotation, scale, opacity, summed, .. } = nodes.nodes[part[k] as usize];
                // The larger of the two decides how far the node reaches.
                Shape { mean, rotation, scale, opacity: opacity.max(summed).min(MOST_OPACITY) }
            };
            let id = self.count + (page - self.count.div_ceil(PAGE)) * PAGE;
            let Output { words, layout, alpha_min, .. } = self.output;
            self.write_page(page, |geometry, colours| {
                words.fill_geometry((layout, *alpha_min), part.len(), shape, |k| (id + k) as u32, geometry);
                words.fill_colours(layout, part.len(), colours, |k| nodes.sh(part[k] as usize));
            })?;
            let chosen: Vec<u16> = part.iter().map(|i| parents[*i as usize]).collect();
            Ok((page, self.write_words(page, &nodes.selected(part), &chosen, place)?))
        };
        order.chunks(PAGE).enumerate().map(write).collect()
    }

    /// Writes the geometry and the colours of a page, which `fill` makes, and its entry.
    fn write_page(&self, page: usize, fill: impl FnOnce(&mut [u32], &mut [u32])) -> Result<()> {
        let Output { words, layout, .. } = self.output;
        let mut geometry = vec![0; words.geometry()];
        let mut colours = vec![0; words.colours()];
        fill(&mut geometry, &mut colours);
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

    /// Writes the words of levels of a page, and returns its entry in the table of levels, without the page of the
    /// parents.
    fn write_words(&self, page: usize, nodes: &Nodes, parents: &[u16], place: Place) -> Result<Level> {
        let mut words = vec![0; LEVEL_WORDS * PAGE];
        let is_scene = page < self.count.div_ceil(PAGE);
        for (k, words) in words.as_chunks_mut::<LEVEL_WORDS>().0.iter_mut().enumerate() {
            *words = match nodes.nodes.get(k) {
                None => NO_NODE,
                Some(node) => {
                    let opacities = [node.opacity, node.summed].map(|value| value.min(MOST_OPACITY));
                    level_words(code(node.error.into()), parents[k], (!is_scene).then_some(opacities))
                }
            };
        }
        words.iter_mut().for_each(|word| *word = word.to_le());
        let bytes: &[u8] = bytemuck::cast_slice(&words);
        let [.., words_at, _] = self.output.places;
        write_all_at(self.output.file, bytes, words_at + (page * bytes.len()) as u64)?;
        let Place { low, high, detail, own_detail } = place;
        let level = Level::of(nodes, parents, (own_detail / detail).min(1.0).powi(2));
        let most_opacity = level.most_opacity.min(MOST_OPACITY);
        Ok(Level { low, high, detail, most_opacity, checksum: XxHash3_64::oneshot(bytes), ..level })
    }

    fn write_level(&self, page: usize, level: Level) -> Result<()> {
        let [.., table_at] = self.output.places;
        write_all_at(self.output.file, &level.encoded(), table_at + (page * Level::BYTES) as u64)?;
        Ok(())
    }
}

/// The indices in the order of these errors.
fn by_error(errors: &[u16]) -> Vec<u32> {
    let mut order: Vec<u32> = (0..errors.len() as u32).collect();
    order.sort_by_key(|index| errors[*index as usize]);
    order
}
