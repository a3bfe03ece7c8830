//! Writes the levels of detail of a page file, whose pages of the scene are written.
//!
//! The nodes of [`FLOOR`] neighbouring pages are the floor of a block. They are halved three times: floor, first level,
//! second level, top. The top fills one page, and is a part of the floor of the block above. A block is judged from one
//! distance, so its nodes are put into pages by the errors of their parents: the nodes of a page leave the picture at
//! about the same distance. Blocks are built from the bottom up, each as soon as those below are, so that few are in
//! memory at a time.

use std::fs::File;
use std::ops::Range;
use std::sync::atomic::{AtomicUsize, Ordering};

use anyhow::{Result, ensure};
use rayon::prelude::*;

use super::group_checkpoint::{KeptTops, Place, Top};
use super::hierarchy_layout::{FLOOR, HALVINGS, Storey, TOPS, storeys};
use super::output::{Output, sealed};
use crate::files::{read_exact_at, write_all_at};
use crate::lod::{NEVER, Node, Nodes, Parents, code, median, parents};
use crate::packing::Shape;
use crate::pagefile::{LEVEL_WORDS, Level, NO_NODE, NO_PAGE, PADDING, PAGE, PageRecord, level_words};
use crate::scene::Cancelled;

/// The largest opacity that fits into 16-bit floats, with room for rounding.
const MOST_OPACITY: f32 = 60_000.0;

struct Hierarchy<'h> {
    output: &'h Output<'h>,
    /// The pages of the scene, at the places that they have in the output.
    scene: &'h File,
    tops: Option<&'h KeptTops<'h>>,
    sh_degree: u32,
    /// Gaussians of the scene.
    count: usize,
    storeys: Vec<Storey>,
    typical: Typical,
    done: AtomicUsize,
    progress: &'h (dyn Fn(f64) + Sync),
    is_cancelled: &'h (dyn Fn() -> bool + Sync),
}

/// The least error of a node, as a part of the typical one of its level. A block with a few distant Gaussians is
/// measured on pictures in which all others are smaller than a pixel, and their merges seem to change nothing.
const LEAST_ERROR: f64 = 0.25;

/// The least error of a node, as a part of its largest standard deviation. A Gaussian that is large in the picture
/// and near the camera is drawn far from where it is: its projection is linear about its mean. Errors are measured from
/// afar and do not have that.
const PER_SIZE: f64 = 1e-3;

/// The least typical error of Gaussians of the scene: 2^-60 world units.
const LEAST_TYPICAL: f64 = 1.0 / (1_u64 << 60) as f64;

/// The typical error of a node of a level: twice that of the level below.
#[derive(Clone, Copy)]
struct Typical(f64);

impl Typical {
    /// The codes of the errors of nodes of a level, 0 for Gaussians of the scene, as files hold them: moved towards the
    /// typical error of the level, by three quarters of the way between their logarithms. At equal numbers of nodes,
    /// pictures are better so (docs/levels.md, Errors).
    fn codes(self, nodes: &Nodes, level: usize) -> Vec<u16> {
        let typical = self.0 * (level as f64).exp2();
        let least = if level == 0 { 0.0 } else { LEAST_ERROR * typical };
        let tempered = |node: &Node| (f64::from(node.error).max(least) * typical.powi(3)).sqrt().sqrt();
        nodes.nodes.iter().map(|node| code(tempered(node).max(PER_SIZE * f64::from(node.size)))).collect()
    }
}

/// Nodes of one level of a block, and the codes of their errors and of those of their parents.
struct Children<'n> {
    nodes: &'n Nodes,
    own: Vec<u16>,
    parents: Vec<u16>,
    place: Place,
}

impl<'n> Children<'n> {
    fn of((nodes, level): (&'n Nodes, usize), found: &Parents, typical: Typical, place: Place) -> Self {
        let above = typical.codes(&found.nodes, level + 1);
        let parents = found.of_children.iter().map(|parent| above[*parent as usize]).collect();
        Self { nodes, own: typical.codes(nodes, level), parents, place }
    }

    /// Nodes without parents.
    fn of_none((nodes, level): (&'n Nodes, usize), typical: Typical, place: Place) -> Self {
        Self { nodes, own: typical.codes(nodes, level), parents: vec![NEVER; nodes.len()], place }
    }

    /// The indices of the nodes in the order of the errors of their parents.
    fn order(&self) -> Vec<u32> {
        let mut order: Vec<u32> = (0..self.parents.len() as u32).collect();
        order.sort_by_key(|index| self.parents[*index as usize]);
        order
    }
}

/// Builds and writes the levels of the pages in the file `scene`, and these pages, each in the order of errors. Blocks
/// whose tops were kept by an earlier run are not built again.
///
/// # Errors
/// If a file cannot be read or written; [`Cancelled`].
pub fn build(
    (output, scene, tops): (&Output, &File, Option<&KeptTops>),
    (count, sh_degree): (usize, u32),
    progress: &(dyn Fn(f64) + Sync),
    is_cancelled: &(dyn Fn() -> bool + Sync),
) -> Result<()> {
    let (storeys, typical, done) = (storeys(count), Typical(0.0), AtomicUsize::new(0));
    let mut hierarchy =
        Hierarchy { output, scene, tops, sh_degree, count, done, progress, is_cancelled, storeys, typical };
    let Some(last) = hierarchy.storeys.last() else {
        let (nodes, records) = hierarchy.scene_pages(0..1)?;
        let children = Children::of_none((&nodes, 0), typical, Place::around(&nodes));
        let written = hierarchy.write_scene(0, &children, &records)?;
        return hierarchy.finish(&written, NO_PAGE);
    };
    let (page, storeys) = (last.above().first, hierarchy.storeys.len());
    hierarchy.typical = hierarchy.typical()?;
    let top = hierarchy.block(storeys - 1, 0)?;
    let children = Children::of_none((&top.nodes, storeys * HALVINGS), hierarchy.typical, top.place);
    let written = hierarchy.write_nodes(page, &children)?;
    hierarchy.finish(&written, NO_PAGE)?;
    hierarchy.finish(&top.last, page as u32)
}

impl Hierarchy<'_> {
    /// The typical error of this scene: the median of the second levels of some blocks.
    fn typical(&self) -> Result<Typical> {
        const BLOCKS: usize = 16;
        const LEVEL: usize = 2;
        let blocks = self.storeys[0].blocks();
        let medians = (0..blocks.min(BLOCKS)).into_par_iter().map(|i| {
            let (mut nodes, mut detail) = (self.floor(i * blocks / blocks.min(BLOCKS))?.0, 0.0);
            for _ in 0..LEVEL {
                let found = parents(&nodes, nodes.len().div_ceil(2), detail);
                (nodes, detail) = (found.nodes, found.detail);
            }
            Ok(median(nodes.nodes.iter().map(|node| f64::from(node.error)).collect()))
        });
        let medians = medians.collect::<Result<Vec<f64>>>()?;
        // Not 0, where most merges change nothing: the others still differ, and the third power stays a number.
        Ok(Typical((median(medians) / (LEVEL as f64).exp2()).max(LEAST_TYPICAL)))
    }

    /// The Gaussians of a block on the ground.
    fn floor(&self, block: usize) -> Result<(Nodes, Vec<PageRecord>)> {
        let begin = block * FLOOR;
        self.scene_pages(begin..(begin + FLOOR).min(self.count.div_ceil(PAGE)))
    }

    /// Builds a block and all below it, or finds it as an earlier run has written it. All is in the file then but its
    /// top and the table of the level below that.
    fn block(&self, storey: usize, block: usize) -> Result<Top> {
        ensure!(!(self.is_cancelled)(), Cancelled);
        let Some(tops) = self.tops.filter(|_| storey == KeptTops::storey(&self.storeys)) else {
            return self.built(storey, block);
        };
        if let Some(top) = tops.find(block, self.sh_degree) {
            for (below, storey) in self.storeys[..=storey].iter().rev().enumerate() {
                let blocks = TOPS.pow(below as u32);
                let blocks = block * blocks..storey.blocks().min((block + 1) * blocks);
                self.advance(blocks.map(|block| storey.levels_of(block)[0]).sum());
            }
            return Ok(top);
        }
        let top = self.built(storey, block)?;
        tops.keep(block, &top)?;
        Ok(top)
    }

    /// Reports that the floors of some blocks, so many nodes in all, are done.
    fn advance(&self, nodes: usize) {
        let done = nodes + self.done.fetch_add(nodes, Ordering::Relaxed);
        (self.progress)(done as f64 / self.storeys.iter().map(|storey| storey.nodes).sum::<usize>() as f64);
    }

    fn built(&self, storey: usize, block: usize) -> Result<Top> {
        let own = self.storeys[storey];
        let pages = own.pages_of(block);
        let (floor, below) = if own.is_ground {
            (self.floor(block)?, Vec::new())
        } else {
            let under = &self.storeys[storey - 1];
            let below = block * TOPS..under.blocks().min((block + 1) * TOPS);
            let tops = below.into_par_iter().map(|below| self.block(storey - 1, below)).collect::<Result<Vec<_>>>()?;
            let mut nodes = Nodes::new(self.sh_degree);
            tops.iter().for_each(|top| nodes.append(&top.nodes));
            ((nodes, Vec::new()), tops)
        };
        let (floor, records) = floor;
        let of_tops = below.iter().map(|top| top.place).reduce(Place::and);
        let place = of_tops.unwrap_or_else(|| Place::around(&floor));
        let mut found: Vec<Parents> = Vec::new();
        for _ in 0..HALVINGS {
            let (nodes, detail) = found.last().map_or((&floor, place.own_detail), |last| (&last.nodes, last.detail));
            found.push(parents(nodes, nodes.len().div_ceil(2), detail));
        }
        let detail = found.iter().map(|parents| parents.detail).fold(place.detail, f32::max);
        let place = Place { detail, ..place };
        let at = |own_detail: f32| Place { own_detail, ..place };
        // Parents in the same block are judged from the same place.
        below.iter().try_for_each(|top| self.finish(&top.last, pages[0] as u32))?;
        let mut last = Vec::new();
        for level in 0..HALVINGS {
            let (nodes, own_detail) = match level {
                0 => (&floor, place.own_detail),
                _ => (&found[level - 1].nodes, found[level - 1].detail),
            };
            let number = storey * HALVINGS + level;
            let children = Children::of((nodes, number), &found[level], self.typical, at(own_detail));
            last = match level == 0 && own.is_ground {
                true => self.write_scene(pages[0], &children, &records)?,
                false => self.write_nodes(pages[level], &children)?,
            };
            if level + 1 < HALVINGS {
                self.finish(&last, pages[level] as u32)?;
            }
        }
        self.advance(floor.len());
        let top = found.pop().expect("a floor is halved");
        Ok(Top { place: at(top.detail), nodes: top.nodes, last })
    }

    /// Writes the table of some pages. `parent` is a page that is judged from the place of their parents.
    fn finish(&self, written: &[(usize, Level)], parent: u32) -> Result<()> {
        let [.., table_at] = self.output.places;
        for (page, level) in written {
            // Pages follow those that they are judged with.
            let parent = if parent == NO_PAGE { NO_PAGE } else { parent.max(*page as u32) };
            let level = Level { parent, ..*level };
            write_all_at(self.output.file, &level.encoded(), table_at + (page * Level::BYTES) as u64)?;
        }
        Ok(())
    }

    /// The Gaussians of some pages of the scene as they are drawn, and their words.
    fn scene_pages(&self, pages: Range<usize>) -> Result<(Nodes, Vec<PageRecord>)> {
        let Output { words, layout, .. } = self.output;
        let (mut nodes, mut records) = (Nodes::new(self.sh_degree), Vec::new());
        for page in pages {
            let [geometry, colours] = self.read_page(page)?;
            for k in (0..PAGE).filter(|k| geometry[words.ids.start + k] != PADDING) {
                let Shape { mean, rotation, scale, opacity } = words.unpacked(layout, &geometry, k);
                nodes.push(Node::leaf(mean, rotation, scale, opacity), &layout.unpacked_sh(&words.sh_of(&colours, k)));
                records.push(words.record(&geometry, &colours, k));
            }
        }
        Ok((nodes, records))
    }

    /// The words of the geometry and of the colours of a page of the scene.
    fn read_page(&self, page: usize) -> Result<[Vec<u32>; 2]> {
        let words = &self.output.words;
        let mut streams = [words.geometry(), words.colours()].map(|words| vec![0_u32; words]);
        for (stream, place) in streams.iter_mut().zip(self.output.places) {
            let bytes = 4 * stream.len() as u64;
            read_exact_at(self.scene, bytemuck::cast_slice_mut(stream), place + page as u64 * bytes)?;
            stream.iter_mut().for_each(|word| *word = u32::from_le(*word));
        }
        Ok(streams)
    }

    /// Writes the Gaussians of a block on the ground, in the order of the errors of their parents.
    fn write_scene(&self, first: usize, children: &Children, records: &[PageRecord]) -> Result<Vec<(usize, Level)>> {
        self.write(first, children, |_, part, geometry, colours| {
            let records: Vec<&PageRecord> = part.iter().map(|index| &records[*index as usize]).collect();
            self.output.words.fill_records(&records, geometry, colours);
        })
    }

    /// Writes nodes that stand for others, in the order of the errors of their parents.
    fn write_nodes(&self, first: usize, children: &Children) -> Result<Vec<(usize, Level)>> {
        let Output { words, layout, alpha_min, .. } = self.output;
        let nodes = children.nodes;
        self.write(first, children, |page, part, geometry, colours| {
            let shape = |k: usize| {
                let Node { mean, rotation, scale, opacity, summed, .. } = nodes.nodes[part[k] as usize];
                // The larger of the two decides how far the node reaches.
                Shape { mean, rotation, scale, opacity: opacity.max(summed).min(MOST_OPACITY) }
            };
            let id = self.count + (page - self.count.div_ceil(PAGE)) * PAGE;
            words.fill_geometry((layout, *alpha_min), part.len(), shape, |k| (id + k) as u32, geometry);
            words.fill_colours(layout, part.len(), colours, |k| nodes.sh(part[k] as usize));
        })
    }

    /// Writes the pages of a level from page `first` on; `fill` makes a page of some of its nodes. Returns the pages
    /// and their entries in the table of levels, without the page of the parents.
    fn write(
        &self,
        first: usize,
        children: &Children,
        fill: impl Fn(usize, &[u32], &mut [u32], &mut [u32]),
    ) -> Result<Vec<(usize, Level)>> {
        let write = |(number, part): (usize, &[u32])| {
            let page = first + number;
            self.output.write_page(page, |geometry, colours| fill(page, part, geometry, colours))?;
            Ok((page, self.write_words(page, children, part)?))
        };
        children.order().chunks(PAGE).enumerate().map(write).collect()
    }

    /// Writes the words of levels of a page with some nodes, and returns its entry in the table of levels.
    fn write_words(&self, page: usize, children: &Children, part: &[u32]) -> Result<Level> {
        let mut words = vec![0; LEVEL_WORDS * PAGE];
        let is_scene = page < self.count.div_ceil(PAGE);
        let nodes: Vec<Node> = part.iter().map(|index| children.nodes.nodes[*index as usize]).collect();
        let [own, parents] = [&children.own, &children.parents]
            .map(|codes| part.iter().map(|i| codes[*i as usize]).collect::<Vec<u16>>());
        for (k, words) in words.as_chunks_mut::<LEVEL_WORDS>().0.iter_mut().enumerate() {
            *words = match nodes.get(k) {
                None => NO_NODE,
                Some(node) => {
                    let opacities = [node.opacity, node.summed].map(|value| value.min(MOST_OPACITY));
                    level_words(own[k], parents[k], (!is_scene).then_some(opacities))
                }
            };
        }
        let checksum = sealed(&mut words);
        let [.., words_at, _] = self.output.places;
        let bytes: &[u8] = bytemuck::cast_slice(&words);
        write_all_at(self.output.file, bytes, words_at + (page * bytes.len()) as u64)?;
        let Place { low, high, detail, own_detail } = children.place;
        let level = Level::of(&nodes, [&own, &parents], (own_detail / detail).min(1.0).powi(2));
        let most_opacity = level.most_opacity.min(MOST_OPACITY);
        Ok(Level { low, high, detail, most_opacity, checksum, ..level })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Where most merges change nothing, the typical error is 0, and the nodes that do change pictures must not be
    /// taken for Gaussians of the scene.
    #[test]
    fn errors_differ_however_small_the_typical_one_is() {
        let mut nodes = Nodes::new(0);
        for error in [0.0, 1e-3, 1.0] {
            nodes.push(Node { error, ..Node::leaf([0.0; 3], [1.0, 0.0, 0.0, 0.0], [1.0; 3], 1.0) }, &[[0.0; 3]]);
        }
        let codes = Typical(LEAST_TYPICAL).codes(&nodes, 1);
        assert!(0 < codes[0] && codes[0] < codes[1] && codes[1] < codes[2], "{codes:?}");
        assert_eq!(Typical(LEAST_TYPICAL).codes(&nodes, 0)[0], 0, "a Gaussian of the scene");
    }

    /// Where the measurement sees no change, the typical one counts.
    #[test]
    fn a_node_has_a_part_of_the_typical_error_at_least() {
        let mut nodes = Nodes::new(0);
        nodes.push(Node::leaf([0.0; 3], [1.0, 0.0, 0.0, 0.0], [1.0; 3], 1.0), &[[0.0; 3]]);
        assert_eq!(
            Typical(0.25).codes(&nodes, 2),
            [code(0.25_f64.powf(0.25))],
            "the fourth root of 1/4, of an error of 1"
        );
    }

    /// A wall of one colour has no error from afar, but a node that stands for it is not drawn as large as the picture.
    #[test]
    fn an_error_grows_with_the_size_of_what_is_drawn() {
        let mut nodes = Nodes::new(0);
        let leaf = Node::leaf([0.0; 3], [1.0, 0.0, 0.0, 0.0], [3.0; 3], 1.0);
        [leaf, Node { size: 3.0, ..leaf }].into_iter().for_each(|node| nodes.push(node, &[[0.0; 3]]));
        let codes = Typical(1e-9).codes(&nodes, 1);
        assert!(codes[0] < codes[1] && codes[1] == code(3.0 * PER_SIZE), "{codes:?}");
        assert_eq!(Typical(1e-9).codes(&nodes, 0)[0], 0, "a Gaussian of the scene is drawn at any size");
    }
}
