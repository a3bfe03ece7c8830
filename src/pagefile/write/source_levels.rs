//! Writes page files with the levels of detail of a source, in which a leaf of a tree has all of its Gaussians at one
//! level.

use std::ops::Range;
use std::path::Path;
use std::sync::atomic::{AtomicUsize, Ordering};

use anyhow::{Context, Result, ensure};
use rayon::prelude::*;

use super::convert::{Finished, Job, PAGES, STATE, Settings, check_count, complete};
use super::group_checkpoint::GroupBounds;
use super::hierarchy::{LEAST_TYPICAL, tempered};
use super::output::Output;
use crate::files::{Checkpoint, PartialFolder};
use crate::formats::{Leaf, SourceLevels};
use crate::lod::{NEVER, Nodes, Replacement, code_of, median, replacement};
use crate::packing::Statistics;
use crate::pagefile::{Header, LodSections, NO_PAGE, PAGE, PageFile, PageLod};
use crate::scene::{Gaussians, along_curve};

/// Most pages, beyond a multiple of those that would hold all Gaussians. Each level of a leaf has pages of its own.
const MOST_PAGES: usize = 4096;
const MOST_PER_FULL: usize = 16;

/// A page file with the levels of a source, which has no name any more, and is gone when it is closed. Errors name the
/// file `source`.
///
/// # Errors
/// As [`write_source_levels`].
pub fn temporary_levels(
    levels: &SourceLevels,
    source: &Path,
    progress: &(dyn Fn(f64) + Sync),
    is_cancelled: &(dyn Fn() -> bool + Sync),
) -> Result<PageFile> {
    let open = || {
        let folder = PartialFolder::inside(&std::env::temp_dir()).context("there is no folder for temporary files")?;
        let output = &folder.path().join("levels.smalto");
        let settings = Settings { has_levels: true, ..Settings::default() };
        // The hash of a page file in reports is that of its header, which has the title.
        let title = source.file_name().unwrap_or_default().to_string_lossy().into_owned();
        write_source_levels(&Job { output, settings, title, fitter: None, progress, is_cancelled }, levels)?;
        // The file stays readable while it is open.
        PageFile::open(output)
    };
    open().with_context(|| format!("levels of {}", source.display()))
}

/// Writes a scene with the levels of its source. Each leaf is a group, of which all nodes of a level have one error,
/// so that exactly one level of a leaf is drawn. The errors are measured.
///
/// # Errors
/// If the leaves are so small that most pages would be empty, or the file cannot be written;
/// [`Cancelled`](crate::scene::Cancelled).
pub fn write_source_levels(job: &Job, levels: &SourceLevels) -> Result<Finished> {
    let SourceLevels { scene, coarser, leaves } = levels;
    let count = scene.gaussians.len();
    check_count(count + coarser.len())?;
    let checkpoint = Checkpoint::beside(job.output, STATE)?;
    checkpoint.clear()?;
    let own = Statistics::of(&scene.gaussians);
    let both = match coarser.is_empty() {
        true => own.clone(),
        false => Statistics::joined([&own, &Statistics::of(coarser)].into_iter()),
    };
    let statistics = job.statistics(Statistics { count, focus: own.focus, ..both });
    let layout = job.layout(&statistics);
    let pages_of = |leaf: &Leaf| {
        [leaf.finest.len().div_ceil(PAGE), leaf.coarser.iter().map(|level| level.len().div_ceil(PAGE)).sum()]
    };
    let [scene_pages, pages] = leaves.iter().map(pages_of).fold([0; 2], |[a, b], [c, d]| [a + c, b + d]);
    let (full, all) = ((count + coarser.len()).div_ceil(PAGE), scene_pages + pages);
    let is_dense = all <= MOST_PAGES + MOST_PER_FULL * full;
    ensure!(
        is_dense,
        "its leaves are too small: they take {all} pages for their levels, where {full} hold all Gaussians; `smalto \
         lod` without --keep-levels makes new levels"
    );
    let sections = LodSections { pages, scene_pages: Some(scene_pages), words_at: 0, table_at: 0, checksum: 0 };
    let header = Header { levels: Some(sections), ..job.header(scene, statistics, layout) };
    let file = checkpoint.file(PAGES)?;
    let output = Output::new(&file, (&header.layout, header.alpha_min), header.pages());

    let mut next = [0, scene_pages];
    let begin = |leaf: &Leaf| {
        let [finest, coarser] = pages_of(leaf);
        let first = next;
        next = [next[0] + finest, next[1] + coarser];
        first
    };
    let first_pages: Vec<[usize; 2]> = leaves.iter().map(begin).collect();
    let done = AtomicUsize::new(0);
    // Leaves are measured, then written.
    let advance = |leaf: &Leaf| {
        let done = leaf.finest.len() + done.fetch_add(leaf.finest.len(), Ordering::Relaxed);
        (job.progress)(done as f64 / (2 * count) as f64);
    };
    let measured = leaves.par_iter().map(|leaf| {
        let measured = measure(job, levels, leaf)?;
        advance(leaf);
        Ok(measured)
    });
    let measured: Vec<Vec<Measured>> = measured.collect::<Result<_>>()?;
    let coarser_levels = measured.iter().flat_map(|levels| &levels[1..]);
    let of_one = coarser_levels.map(|level| level.error / level.per_node);
    let typical = median(of_one.collect()).max(LEAST_TYPICAL);
    (leaves.par_iter().zip(first_pages)).zip(&measured).try_for_each(|((leaf, first), measured)| {
        job.check()?;
        let written = LeafWriter { output: &output, levels, leaf, measured, typical }.write(first);
        written.with_context(|| format!("cannot write {}", job.output.display()))?;
        advance(leaf);
        anyhow::Ok(())
    })?;
    complete(checkpoint, &output, header.clone())?;
    Ok(Finished { header, resumed: 0, buckets: 1, resumed_levels: 0, notices: scene.notices.clone() })
}

/// What was measured of a level of a leaf; zeros of the finest.
#[derive(Default)]
struct Measured {
    /// The root of the squared error against the next finer level, per saved node; not less than that of finer levels.
    error: f64,
    /// Number of Gaussians of the finest level for each of this level.
    per_node: f64,
    reference_width: f32,
    /// The squared error against the scene, in pixels of the reference width.
    squared_error: f32,
}

/// Measures the levels of a leaf, from the finest.
fn measure(job: &Job, levels: &SourceLevels, leaf: &Leaf) -> Result<Vec<Measured>> {
    let mut finer = Nodes::of(&levels.scene.gaussians, leaf.finest.clone());
    let finest = finer.len();
    let mut measured = vec![Measured::default()];
    for range in &leaf.coarser {
        job.check()?;
        let nodes = Nodes::of(&levels.coarser, range.clone());
        let Replacement { squared_error, reference_width } = replacement(&finer, &nodes);
        let (of_finer, reference_width) = (&measured[measured.len() - 1], reference_width as f32);
        let saved = finer.len().saturating_sub(nodes.len()).max(1);
        // In pixels of the reference width of this level, the errors of the finer ones have fallen.
        let fallen = (of_finer.reference_width / reference_width).min(1.0).powi(2);
        measured.push(Measured {
            error: (squared_error / saved as f64).sqrt().max(of_finer.error),
            per_node: (finest as f64 / nodes.len() as f64).max(of_finer.per_node),
            reference_width,
            squared_error: of_finer.squared_error * fallen + squared_error as f32,
        });
        finer = nodes;
    }
    Ok(measured)
}

struct LeafWriter<'w> {
    output: &'w Output<'w>,
    levels: &'w SourceLevels,
    leaf: &'w Leaf,
    measured: &'w [Measured],
    /// The typical error of nodes that stand for one Gaussian of the scene.
    typical: f64,
}

/// One level of a leaf.
struct Level<'l> {
    gaussians: &'l Gaussians,
    /// Indices of the Gaussians in the order of the pages.
    order: Vec<u32>,
    nodes: Nodes,
    /// The code of the error of all nodes.
    error: u16,
    reference_width: f32,
}

impl<'l> Level<'l> {
    fn of(gaussians: &'l Gaussians, range: &Range<usize>, measured: &Measured, typical: f64) -> Self {
        let order = along_curve(&gaussians.means()[range.clone()]);
        let order: Vec<u32> = order.into_iter().map(|index| index + range.start as u32).collect();
        let mut nodes = Nodes::of(gaussians, order.iter().map(|index| *index as usize));
        let squared_error = measured.squared_error / nodes.len() as f32;
        nodes.nodes.iter_mut().for_each(|node| node.squared_error = squared_error);
        // 0 of the finest, above 0 of others.
        let error = code_of(tempered(measured.error, typical * measured.per_node));
        Self { gaussians, order, nodes, error, reference_width: measured.reference_width }
    }
}

impl LeafWriter<'_> {
    /// Writes the pages of the finest level from the page `finest` on, and those of the others from `coarser` on.
    fn write(&self, [finest, coarser]: [usize; 2]) -> Result<()> {
        let SourceLevels { scene, coarser: gaussians, .. } = self.levels;
        let of_coarser = self.leaf.coarser.iter().map(|range| (gaussians, range));
        let parts = std::iter::once((&scene.gaussians, &self.leaf.finest)).chain(of_coarser).zip(self.measured);
        let level = |((gaussians, range), measured)| Level::of(gaussians, range, measured, self.typical);
        let levels: Vec<Level> = parts.map(level).collect();
        let around = levels.iter().map(|level| GroupBounds::around(&level.nodes)).reduce(GroupBounds::union);
        let reference_width = levels.iter().map(|level| level.reference_width).fold(0.0, f32::max);
        let bounds = GroupBounds { reference_width, ..around.expect("a leaf has levels") };
        let (mut first, mut next) = (finest, coarser);
        for (number, level) in levels.iter().enumerate() {
            let above = levels.get(number + 1);
            let parent = if above.is_some() { next as u32 } else { NO_PAGE };
            self.write_level((number, level), first, (above.map_or(NEVER, |above| above.error), parent), bounds)?;
            (first, next) = (next, next + above.map_or(0, |above| above.order.len().div_ceil(PAGE)));
        }
        Ok(())
    }

    /// Writes a level from page `first` on.
    fn write_level(
        &self,
        (number, level): (usize, &Level),
        first: usize,
        (parent_error, parent): (u16, u32),
        bounds: GroupBounds,
    ) -> Result<()> {
        // Indices of nodes follow those of the scene.
        let before = if number == 0 { 0 } else { self.levels.scene.gaussians.len() as u32 };
        self.output.write(first, level.gaussians, &level.order, |index| before + index)?;
        let bounds = GroupBounds { own_reference_width: level.reference_width, ..bounds };
        for (i, nodes) in level.nodes.nodes.chunks(PAGE).enumerate() {
            let codes = [level.error, parent_error].map(|code| vec![code; nodes.len()]);
            let lod = self.output.write_words(first + i, (nodes, number == 0), [&codes[0], &codes[1]], &bounds)?;
            self.output.write_lod(first + i, &PageLod { parent, level: number as u16, ..lod })?;
        }
        Ok(())
    }
}
