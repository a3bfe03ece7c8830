//! Writes page files of scenes whose blocks are already in Morton order.

use std::fs::File;

use anyhow::{Result, bail, ensure};

use super::convert::{Blocks, CHANGED, Finished, Job, STATE, Settings, check_count, finish, statistics_passes};
use super::hierarchy_layout::inner_pages;
use super::output::Output;
use crate::files::Checkpoint;
use crate::options::Storage;
use crate::packing::{Accumulator, Layout, Statistics};
use crate::pagefile::PAGE;
use crate::scene::{Cancelled, Gaussians, along_curve};
use crate::threads::{self, joined};

/// Writes a scene whose blocks of several pages are already in Morton order: each block is sorted and written at once.
/// If the layout depends on the whole scene, the statistics take a pass before.
///
/// # Errors
/// Those of the source; if the file cannot be written; [`Cancelled`].
pub fn write_in_order(job: &Job, blocks: &Blocks) -> Result<Finished> {
    let checkpoint = Checkpoint::beside(job.output, STATE)?;
    checkpoint.clear()?;
    let file = checkpoint.file(job.scene_file())?;
    let is_plain = |storage: Storage| storage == Storage::F32;
    let options = &job.settings.options;
    let is_free = is_plain(options.sh_storage) && is_plain(options.shape_storage);
    let known = if is_free { None } else { Some(statistics_passes(job, blocks, 2.0)?.1) };
    let mut writer: Option<OrderedWriter> = None;
    let mut add = |block: Gaussians, of: usize| {
        job.check()?;
        check_count(of)?;
        let writer = writer.get_or_insert_with(|| OrderedWriter::new(job, known.as_ref(), of, block.sh_degree()));
        if known.is_none() {
            writer.statistics.add(&block);
        }
        writer.add(&file, block).map_err(|error| error.context(format!("cannot write {}", job.output.display())))?;
        let done = writer.added as f64 / of as f64;
        job.report(if known.is_some() { 0.5 + 0.5 * done } else { done });
        anyhow::Ok(())
    };
    // The next block is made while one is written.
    let scene = threads::scope(|threads| {
        let (sender, receiver) = std::sync::mpsc::sync_channel(1);
        let making =
            threads.spawn(move || blocks(&mut |block, of| sender.send((block, of)).map_err(|_| Cancelled.into())))?;
        let added = receiver.iter().try_for_each(|(block, of)| add(block, of));
        drop(receiver);
        let made = joined(making);
        added.and(made)
    })?;
    let Some(mut writer) = writer else { bail!("there are no Gaussians") };
    writer.end(&file)?;
    let statistics = known.unwrap_or_else(|| job.statistics(writer.statistics.finish()));
    ensure!(statistics.count == writer.count, CHANGED);
    let mut layout = job.layout(&statistics);
    // Coefficients of degrees that turned out to be 0 are stored, too.
    layout.sh_degree = writer.layout.sh_degree;
    let header = job.header(&scene, statistics, layout);
    let output = Output::new(&file, (&header.layout, header.alpha_min), writer.pages);
    finish(job, checkpoint, &output, header.clone())?;
    Ok(Finished { header, resumed: 0, buckets: 1, resumed_levels: 0, notices: scene.notices })
}

/// Writes blocks in the order in which they are read.
struct OrderedWriter {
    layout: Layout,
    alpha_min: f32,
    /// Most pages.
    pages: usize,
    /// Statistics of the blocks, where those of the scene were not known before.
    statistics: Accumulator,
    /// Gaussians of the scene, as announced.
    count: usize,
    added: usize,
    written: usize,
    /// The Gaussians after the last whole page, and their indices in the scene.
    rest: Option<(Gaussians, Vec<u32>)>,
}

impl OrderedWriter {
    fn new(job: &Job, known: Option<&Statistics>, count: usize, sh_degree: u32) -> Self {
        let Settings { options, has_levels, .. } = &job.settings;
        let statistics = Accumulator::new(count, sh_degree);
        let layout = match known {
            Some(known) => job.layout(known),
            None => Layout::plain(sh_degree.min(options.sh_degree)),
        };
        let (alpha_min, scene_pages) = (options.rules.alpha_min, count.div_ceil(PAGE));
        let pages = scene_pages + if *has_levels { inner_pages(count) } else { 0 };
        Self { layout, alpha_min, pages, statistics, count, added: 0, written: 0, rest: None }
    }

    fn add(&mut self, file: &File, block: Gaussians) -> Result<()> {
        let own = self.added as u32..(self.added + block.len()) as u32;
        self.added += block.len();
        let (gaussians, ids) = match self.rest.take() {
            Some((rest, mut ids)) => {
                ids.extend(own);
                (Gaussians::joined([&rest, &block].into_iter())?, ids)
            }
            None => (block, own.collect()),
        };
        let order = along_curve(gaussians.means());
        let whole = order.len() / PAGE * PAGE;
        self.write(file, &gaussians, &order[..whole], &ids)?;
        if whole < order.len() {
            // In the order of the scene, as a part of the next block.
            let mut rest = order[whole..].to_vec();
            rest.sort_unstable();
            let ids = rest.iter().map(|index| ids[*index as usize]).collect();
            self.rest = Some((gaussians.selected(&rest)?, ids));
        }
        Ok(())
    }

    fn write(&mut self, file: &File, gaussians: &Gaussians, order: &[u32], ids: &[u32]) -> Result<()> {
        let output = Output::new(file, (&self.layout, self.alpha_min), self.pages);
        output.write(self.written / PAGE, gaussians, order, |index| ids[index as usize])?;
        self.written += order.len();
        Ok(())
    }

    /// Writes the last Gaussians.
    fn end(&mut self, file: &File) -> Result<()> {
        if let Some((gaussians, ids)) = self.rest.take() {
            let order = along_curve(gaussians.means());
            self.write(file, &gaussians, &order, &ids)?;
        }
        ensure!(self.added == self.count, "the source has another number of Gaussians than announced");
        Ok(())
    }
}
