//! Builds the hierarchy of a page file whose pages of the scene are written.
//!
//! A group takes the nodes of [`GROUP_PAGES`] neighbouring pages as input and simplifies them [`HALVINGS`] times to
//! half their number. Its output fills one page and is a part of the input of the group above. The distance to the
//! camera is that of the whole group, so its nodes are put into pages by the errors of their parents: the nodes of a
//! page leave the cut at about the same distance. Groups are built from the leaves up, each as soon as its children are
//! built, so that few are in memory at a time.

use std::fs::File;
use std::ops::Range;
use std::sync::atomic::{AtomicUsize, Ordering};

use anyhow::{Result, ensure};
use rayon::prelude::*;

use super::group_checkpoint::{GroupBounds, GroupCheckpoint, GroupOutput};
use super::hierarchy_layout::{CHILD_GROUPS, GROUP_PAGES, HALVINGS, HierarchyLevel, hierarchy_levels};
use super::output::{MOST_OPACITY, Output};
use crate::files::read_exact_at;
use crate::lod::{FitOptions, NEVER, Node, Nodes, Simplified, code_of, median, simplify};
use crate::packing::Shape;
use crate::pagefile::{NO_PAGE, PADDING, PAGE, PageLod};
use crate::scene::Cancelled;

struct Hierarchy<'h> {
    output: &'h Output<'h>,
    /// The pages of the scene, at the same offsets as in the output.
    scene: &'h File,
    checkpoint: Option<&'h GroupCheckpoint<'h>>,
    sh_degree: u32,
    /// Gaussians of the scene.
    count: usize,
    fit_options: FitOptions<'h>,
    levels: Vec<HierarchyLevel>,
    typical: Typical,
    done: AtomicUsize,
    progress: &'h (dyn Fn(f64) + Sync),
    is_cancelled: &'h (dyn Fn() -> bool + Sync),
}

/// The least error of a node, as a fraction of the typical error of its level. A group with a few distant Gaussians is
/// measured on pictures in which all others are smaller than a pixel, so that their merges measure no difference.
const LEAST_ERROR: f64 = 0.25;

/// The least error of a node, as a fraction of its largest standard deviation. A large Gaussian near the camera is
/// drawn far from its true position, because its projection is linear about its mean. Measured errors lack this, since
/// they are measured from afar.
const PER_SIZE: f64 = 1e-3;

/// The least typical error of Gaussians of the scene: 2^-60 world units.
pub const LEAST_TYPICAL: f64 = 1.0 / (1_u64 << 60) as f64;

/// The typical error of a node of a level: twice that of the level below.
#[derive(Clone, Copy)]
struct Typical(f64);

/// The stored error of a node of a level with this typical error. Errors are moved towards the typical one by three
/// quarters of the way between their logarithms: this makes better pictures at equal numbers of nodes (docs/levels.md,
/// Errors).
pub fn tempered(error: f64, typical: f64) -> f64 {
    (error.max(LEAST_ERROR * typical) * typical.powi(3)).sqrt().sqrt()
}

impl Typical {
    /// The codes of the errors of nodes of a level, 0 for Gaussians of the scene.
    fn codes(self, nodes: &Nodes, level: usize) -> Vec<u16> {
        let typical = self.0 * (level as f64).exp2();
        let stored = |node: &Node| if level == 0 { 0.0 } else { tempered(node.error.into(), typical) };
        nodes.nodes.iter().map(|node| code_of(stored(node).max(PER_SIZE * f64::from(node.size)))).collect()
    }
}

/// Nodes of one step of a group, and the codes of their errors and of their parents' errors.
struct Children<'n> {
    nodes: &'n Nodes,
    own: Vec<u16>,
    parents: Vec<u16>,
    bounds: GroupBounds,
}

impl<'n> Children<'n> {
    fn of((nodes, level): (&'n Nodes, usize), found: &Simplified, typical: Typical, bounds: GroupBounds) -> Self {
        let above = typical.codes(&found.nodes, level + 1);
        let parents = found.parent_of_child.iter().map(|parent| above[*parent as usize]).collect();
        Self { nodes, own: typical.codes(nodes, level), parents, bounds }
    }

    /// Nodes without parents.
    fn of_none((nodes, level): (&'n Nodes, usize), typical: Typical, bounds: GroupBounds) -> Self {
        Self { nodes, own: typical.codes(nodes, level), parents: vec![NEVER; nodes.len()], bounds }
    }

    /// The indices of the nodes in the order of the errors of their parents.
    fn order(&self) -> Vec<u32> {
        let mut order: Vec<u32> = (0..self.parents.len() as u32).collect();
        order.sort_by_key(|index| self.parents[*index as usize]);
        order
    }
}

/// Builds the hierarchy of the pages in the file `scene`, and writes all pages, each with its nodes in the order of
/// errors. Groups whose outputs an earlier run has kept are not built again.
///
/// # Errors
/// If a file cannot be read or written; [`Cancelled`].
pub fn build(
    (output, scene, checkpoint): (&Output, &File, Option<&GroupCheckpoint>),
    (count, sh_degree): (usize, u32),
    fit_options: FitOptions,
    progress: &(dyn Fn(f64) + Sync),
    is_cancelled: &(dyn Fn() -> bool + Sync),
) -> Result<()> {
    let (levels, typical, done) = (hierarchy_levels(count), Typical(0.0), AtomicUsize::new(0));
    let mut hierarchy = Hierarchy {
        output,
        scene,
        checkpoint,
        sh_degree,
        count,
        fit_options,
        done,
        progress,
        is_cancelled,
        levels,
        typical,
    };
    let Some(last) = hierarchy.levels.last() else {
        let (nodes, records) = hierarchy.scene_pages(0..1)?;
        let children = Children::of_none((&nodes, 0), typical, GroupBounds::around(&nodes));
        let written = hierarchy.write_leaves(0, &children, &records)?;
        return hierarchy.write_lods(&written, NO_PAGE);
    };
    let (page, levels) = (last.above().first_page, hierarchy.levels.len());
    hierarchy.typical = hierarchy.typical()?;
    let root = hierarchy.group_output(levels - 1, 0)?;
    let children = Children::of_none((&root.nodes, levels * HALVINGS), hierarchy.typical, root.bounds);
    let written = hierarchy.write_inner(page, &children)?;
    hierarchy.write_lods(&written, NO_PAGE)?;
    hierarchy.write_lods(&root.last_pages, page as u32)
}

impl Hierarchy<'_> {
    /// The typical error of this scene: the median after two steps, over some groups.
    fn typical(&self) -> Result<Typical> {
        const GROUPS: usize = 16;
        const STEPS: usize = 2;
        let groups = self.levels[0].groups();
        let medians = (0..groups.min(GROUPS)).into_par_iter().map(|i| {
            let (mut nodes, mut reference_width) = (self.leaf_input(i * groups / groups.min(GROUPS))?.0, 0.0);
            for _ in 0..STEPS {
                self.check()?;
                let found = simplify(&nodes, nodes.len().div_ceil(2), reference_width, self.fit_options);
                (nodes, reference_width) = (found.nodes, found.reference_width);
            }
            Ok(median(nodes.nodes.iter().map(|node| f64::from(node.error)).collect()))
        });
        let medians = medians.collect::<Result<Vec<f64>>>()?;
        // Above 0 even if most merges measure no difference, so that the third power is not 0.
        Ok(Typical((median(medians) / (STEPS as f64).exp2()).max(LEAST_TYPICAL)))
    }

    /// The Gaussians that are the input of a group of the leaf level, and their records.
    fn leaf_input(&self, group: usize) -> Result<(Nodes, Vec<u32>)> {
        let begin = group * GROUP_PAGES;
        self.scene_pages(begin..(begin + GROUP_PAGES).min(self.count.div_ceil(PAGE)))
    }

    /// The output of a group, built or from the checkpoint. All pages below it are then in the file, except for the
    /// table entries of its last pages.
    fn group_output(&self, level: usize, group: usize) -> Result<GroupOutput> {
        self.check()?;
        let Some(checkpoint) = self.checkpoint.filter(|_| level == GroupCheckpoint::level(&self.levels)) else {
            return self.build_group(level, group);
        };
        if let Some(output) = checkpoint.find(group, self.sh_degree) {
            for (depth, below) in self.levels[..=level].iter().rev().enumerate() {
                let groups = CHILD_GROUPS.pow(depth as u32);
                let groups = group * groups..below.groups().min((group + 1) * groups);
                self.advance(groups.map(|group| below.node_counts(group)[0]).sum());
            }
            return Ok(output);
        }
        let output = self.build_group(level, group)?;
        checkpoint.save(group, &output)?;
        Ok(output)
    }

    fn check(&self) -> Result<()> {
        ensure!(!(self.is_cancelled)(), Cancelled);
        Ok(())
    }

    /// Reports that groups with `nodes` input nodes are done.
    fn advance(&self, nodes: usize) {
        let done = nodes + self.done.fetch_add(nodes, Ordering::Relaxed);
        (self.progress)(done as f64 / self.levels.iter().map(|level| level.nodes).sum::<usize>() as f64);
    }

    fn build_group(&self, level: usize, group: usize) -> Result<GroupOutput> {
        let own = self.levels[level];
        let pages = own.page_starts(group);
        let ((input, records), children) = if own.is_leaf {
            (self.leaf_input(group)?, Vec::new())
        } else {
            let below = &self.levels[level - 1];
            let groups = group * CHILD_GROUPS..below.groups().min((group + 1) * CHILD_GROUPS);
            let outputs = groups.into_par_iter().map(|group| self.group_output(level - 1, group));
            let outputs = outputs.collect::<Result<Vec<_>>>()?;
            let mut nodes = Nodes::new(self.sh_degree);
            outputs.iter().for_each(|output| nodes.append(&output.nodes));
            ((nodes, Vec::new()), outputs)
        };
        let union = children.iter().map(|output| output.bounds).reduce(GroupBounds::union);
        let bounds = union.unwrap_or_else(|| GroupBounds::around(&input));
        let mut steps: Vec<Simplified> = Vec::new();
        for _ in 0..HALVINGS {
            self.check()?;
            let (nodes, reference_width) =
                steps.last().map_or((&input, bounds.own_reference_width), |last| (&last.nodes, last.reference_width));
            steps.push(simplify(nodes, nodes.len().div_ceil(2), reference_width, self.fit_options));
        }
        let reference_width = steps.iter().map(|step| step.reference_width).fold(bounds.reference_width, f32::max);
        let bounds = GroupBounds { reference_width, ..bounds };
        let with_own = |own_reference_width: f32| GroupBounds { own_reference_width, ..bounds };
        // Nodes and parents in the same group have the same bounds.
        children.iter().try_for_each(|output| self.write_lods(&output.last_pages, pages[0] as u32))?;
        let mut last_pages = Vec::new();
        for step in 0..HALVINGS {
            let (nodes, own_reference_width) = match step {
                0 => (&input, bounds.own_reference_width),
                _ => (&steps[step - 1].nodes, steps[step - 1].reference_width),
            };
            let lod = level * HALVINGS + step;
            let children = Children::of((nodes, lod), &steps[step], self.typical, with_own(own_reference_width));
            last_pages = match step == 0 && own.is_leaf {
                true => self.write_leaves(pages[0], &children, &records)?,
                false => self.write_inner(pages[step], &children)?,
            };
            if step + 1 < HALVINGS {
                self.write_lods(&last_pages, pages[step] as u32)?;
            }
        }
        self.advance(input.len());
        let output = steps.pop().expect("a group has steps");
        Ok(GroupOutput { bounds: with_own(output.reference_width), nodes: output.nodes, last_pages })
    }

    /// Writes the table entries of some pages. `parent` is a page with the bounds of their parents.
    fn write_lods(&self, pages: &[(usize, PageLod)], parent: u32) -> Result<()> {
        for (page, lod) in pages {
            // The format wants a parent that is not before its page.
            let parent = if parent == NO_PAGE { NO_PAGE } else { parent.max(*page as u32) };
            self.output.write_lod(*page, &PageLod { parent, ..*lod })?;
        }
        Ok(())
    }

    /// The Gaussians of some pages of the scene with their packed values, and their records.
    fn scene_pages(&self, pages: Range<usize>) -> Result<(Nodes, Vec<u32>)> {
        let Output { words, layout, .. } = self.output;
        let (mut nodes, mut records) = (Nodes::new(self.sh_degree), Vec::new());
        for page in pages {
            let [geometry, colours] = self.read_page(page)?;
            for k in (0..PAGE).filter(|k| geometry[words.ids.start + k] != PADDING) {
                let Shape { mean, rotation, scale, opacity } = words.unpacked(layout, &geometry, k);
                nodes.push(Node::leaf(mean, rotation, scale, opacity), &layout.unpacked_sh(&words.sh_of(&colours, k)));
                words.append_record(&geometry, &colours, k, &mut records);
            }
        }
        Ok((nodes, records))
    }

    /// The words of the geometry and of the colours of a page of the scene.
    fn read_page(&self, page: usize) -> Result<[Vec<u32>; 2]> {
        let words = &self.output.words;
        let mut streams = [words.geometry(), words.colours()].map(|words| vec![0_u32; words]);
        for (stream, offset) in streams.iter_mut().zip(self.output.offsets) {
            let bytes = 4 * stream.len() as u64;
            read_exact_at(self.scene, bytemuck::cast_slice_mut(stream), offset + page as u64 * bytes)?;
            stream.iter_mut().for_each(|word| *word = u32::from_le(*word));
        }
        Ok(streams)
    }

    /// Writes Gaussians of the scene, in the order of the errors of their parents.
    fn write_leaves(&self, first: usize, children: &Children, records: &[u32]) -> Result<Vec<(usize, PageLod)>> {
        self.write(first, children, |_, part, geometry, colours| {
            let words = &self.output.words;
            let each = words.record_words();
            let records: Vec<&[u32]> = part.iter().map(|index| &records[*index as usize * each..][..each]).collect();
            words.fill_records(&records, geometry, colours);
        })
    }

    /// Writes merged nodes, in the order of the errors of their parents.
    fn write_inner(&self, first: usize, children: &Children) -> Result<Vec<(usize, PageLod)>> {
        let Output { words, layout, alpha_min, .. } = self.output;
        let nodes = children.nodes;
        self.write(first, children, |page, part, geometry, colours| {
            let shape = |k: usize| {
                let Node { mean, rotation, scale, opacity, opacity_sum, .. } = nodes.nodes[part[k] as usize];
                // The reach is that of the larger one.
                Shape { mean, rotation, scale, opacity: opacity.max(opacity_sum).min(MOST_OPACITY) }
            };
            let id = self.count + (page - self.count.div_ceil(PAGE)) * PAGE;
            words.fill_geometry((layout, *alpha_min), part.len(), shape, |k| (id + k) as u32, geometry);
            words.fill_colours(layout, part.len(), colours, |k| nodes.sh(part[k] as usize));
        })
    }

    /// Writes the pages of a step from page `first` on; `fill` makes a page of some of its nodes. Returns the pages and
    /// their table entries, which lack the page of the parents.
    fn write(
        &self,
        first: usize,
        children: &Children,
        fill: impl Fn(usize, &[u32], &mut [u32], &mut [u32]),
    ) -> Result<Vec<(usize, PageLod)>> {
        let write = |(number, part): (usize, &[u32])| {
            let page = first + number;
            self.output.write_page(page, |geometry, colours| fill(page, part, geometry, colours))?;
            let nodes: Vec<Node> = part.iter().map(|index| children.nodes.nodes[*index as usize]).collect();
            let [own, parents] = [&children.own, &children.parents]
                .map(|codes| part.iter().map(|i| codes[*i as usize]).collect::<Vec<u16>>());
            let is_scene = page < self.count.div_ceil(PAGE);
            let lod = self.output.write_words(page, (&nodes, is_scene), [&own, &parents], &children.bounds)?;
            Ok((page, lod))
        };
        children.order().chunks(PAGE).enumerate().map(write).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A typical error of 0 must not give the code of Gaussians of the scene to nodes with an error.
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

    /// Without a measured error, the typical one counts.
    #[test]
    fn a_node_has_a_fraction_of_the_typical_error_at_least() {
        let mut nodes = Nodes::new(0);
        nodes.push(Node::leaf([0.0; 3], [1.0, 0.0, 0.0, 0.0], [1.0; 3], 1.0), &[[0.0; 3]]);
        assert_eq!(
            Typical(0.25).codes(&nodes, 2),
            [code_of(0.25_f64.powf(0.25))],
            "the fourth root of 1/4, of an error of 1"
        );
    }

    /// A wall of one colour has no measured error, but its node must not be drawn as large as the picture.
    #[test]
    fn an_error_grows_with_the_size_of_what_is_drawn() {
        let mut nodes = Nodes::new(0);
        let leaf = Node::leaf([0.0; 3], [1.0, 0.0, 0.0, 0.0], [3.0; 3], 1.0);
        [leaf, Node { size: 3.0, ..leaf }].into_iter().for_each(|node| nodes.push(node, &[[0.0; 3]]));
        let codes = Typical(1e-9).codes(&nodes, 1);
        assert!(codes[0] < codes[1] && codes[1] == code_of(3.0 * PER_SIZE), "{codes:?}");
        assert_eq!(Typical(1e-9).codes(&nodes, 0)[0], 0, "a Gaussian of the scene is drawn at any size");
    }
}
