//! Writes page files from a scene in memory, or from one that is read in blocks.

use std::fs::File;
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{self, RecvTimeoutError};
use std::time::Duration;

use anyhow::{Context, Result, bail, ensure};
use rayon::prelude::*;

use super::buckets::{BucketBounds, BucketWriter, gaussians_of, mean_of, name, record_words, records};
use super::checkpoint::{State, Work};
use super::group_checkpoint::GroupCheckpoint;
use super::hierarchy::build;
use super::hierarchy_layout::inner_pages;
use super::output::Output;
use crate::files::Checkpoint;
use crate::lod::{FitOptions, Fitter};
use crate::options::{Options, Storage};
use crate::packing::{Accumulator, Layout, Statistics};
use crate::pagefile::{HEADER, Header, LodSections, PADDING, PAGE};
use crate::scene::{Cancelled, Curve, Gaussians, Scene};
use crate::threads::{self, joined};

/// The layout of the file, and the limits of the conversion.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Settings {
    /// The options of the layout and of the alpha threshold; by default, 32-bit floats.
    pub options: Options,
    /// Memory limit of a bucket while it is sorted, bytes.
    pub memory: usize,
    /// Builds levels of detail, too.
    pub has_levels: bool,
    /// Rounds in which the shapes of merged nodes are fitted to pictures of what they stand for.
    pub fit_rounds: u32,
}

impl Settings {
    /// The layout without loss.
    pub const LOSSLESS: Options = Options { sh_storage: Storage::F32, shape_storage: Storage::F32, ..Options::EXACT };
}

impl Default for Settings {
    fn default() -> Self {
        Self { options: Self::LOSSLESS, memory: 2 << 30, has_levels: false, fit_rounds: 0 }
    }
}

/// Time between two writes to the disk while levels are made.
const SYNC_INTERVAL: Duration = Duration::from_secs(1);

/// The least memory in which pages are sorted.
pub const LEAST_MEMORY: usize = 1 << 20;

/// Takes the next Gaussians of a scene, and their expected number in all.
pub type Take<'t> = dyn FnMut(Gaussians, usize) -> Result<()> + 't;

/// Passes all Gaussians of a scene in the order of their indices, block by block, the same in every call. Returns the
/// scene without its Gaussians.
pub type Blocks<'b> = dyn Fn(&mut Take) -> Result<Scene> + Sync + 'b;

/// The inputs of a conversion, and its callbacks.
pub struct Job<'j> {
    pub output: &'j Path,
    pub settings: Settings,
    /// The name of the source.
    pub title: String,
    /// What fits merged nodes; by default the host.
    pub fitter: Option<&'j dyn Fitter>,
    /// Receives the progress, 0 to 1.
    pub progress: &'j (dyn Fn(f64) + Sync),
    /// Called between blocks and between buckets. Once it returns true, the job ends with [`Cancelled`].
    pub is_cancelled: &'j (dyn Fn() -> bool + Sync),
}

/// A file that was written.
pub struct Finished {
    pub header: Header,
    /// Buckets that an earlier run had finished.
    pub resumed: usize,
    pub buckets: usize,
    /// Groups of the hierarchy that an earlier run had built.
    pub resumed_levels: usize,
    pub notices: Vec<String>,
}

/// The pages of the output.
pub(crate) const PAGES: &str = "pages";
/// The pages of a scene with levels, before their nodes are sorted by error.
const SCENE: &str = "scene";
pub(crate) const STATE: &str = "state.json";
const HEADER_FILE: &str = "header";
const REST: &str = "rest";

impl<'j> Job<'j> {
    /// A job without callbacks.
    pub fn new(output: &'j Path, settings: Settings, title: &str) -> Self {
        Self { output, settings, title: title.to_owned(), fitter: None, progress: &|_| {}, is_cancelled: &|| false }
    }
}

impl Job<'_> {
    /// The name of the file with the pages of the scene.
    pub(crate) fn scene_file(&self) -> &'static str {
        if self.settings.has_levels { SCENE } else { PAGES }
    }

    pub(crate) fn check(&self) -> Result<()> {
        ensure!(!(self.is_cancelled)(), Cancelled);
        Ok(())
    }

    /// The header of a file of this scene, with offsets of 0.
    pub(crate) fn header(&self, scene: &Scene, statistics: Statistics, layout: Layout) -> Header {
        let levels = self.settings.has_levels.then(|| LodSections {
            pages: inner_pages(statistics.count),
            scene_pages: None,
            words_at: 0,
            table_at: 0,
            checksum: 0,
        });
        Header {
            statistics,
            layout,
            alpha_min: self.settings.options.rules.alpha_min,
            is_antialiased: scene.is_antialiased,
            report: scene.report,
            title: self.title.clone(),
            format: scene.format.clone(),
            table_checksum: 0,
            geometry_at: 0,
            colours_at: 0,
            levels,
        }
    }

    /// The statistics for the layout of the file, in which merged nodes are larger.
    pub(crate) fn statistics(&self, statistics: Statistics) -> Statistics {
        if self.settings.has_levels { statistics.with_room_for_levels() } else { statistics }
    }

    /// The layout of the file of a scene with these statistics.
    pub(crate) fn layout(&self, statistics: &Statistics) -> Layout {
        let Settings { options, has_levels, .. } = &self.settings;
        if *has_levels { Layout::of_nodes(statistics, options) } else { Layout::of(statistics, options) }
    }

    /// Reports the progress of the work before the levels.
    pub(crate) fn report(&self, done: f64) {
        (self.progress)(if self.settings.has_levels { 0.3 * done } else { done });
    }
}

pub(crate) fn check_count(count: usize) -> Result<()> {
    ensure!(count > 0, "there are no Gaussians");
    ensure!(count < PADDING as usize, "a page file holds fewer than {PADDING} Gaussians, not {count}");
    Ok(())
}

/// Writes a scene in memory.
///
/// # Errors
/// If the file cannot be written.
pub fn write_whole(job: &Job, scene: &Scene) -> Result<Finished> {
    let gaussians = &scene.gaussians;
    check_count(gaussians.len())?;
    let checkpoint = Checkpoint::beside(job.output, STATE)?;
    checkpoint.clear()?;
    let statistics = job.statistics(Statistics::of(gaussians));
    let layout = job.layout(&statistics);
    let header = job.header(scene, statistics, layout);
    let file = checkpoint.file(job.scene_file())?;
    let output = Output::new(&file, (&header.layout, header.alpha_min), header.pages());
    let order = header.statistics.curve().order(gaussians.means());
    for (i, part) in order.chunks(PAGE << 10).enumerate() {
        job.check()?;
        let written = output.write(i << 10, gaussians, part, |index| index);
        written.map_err(|error| checkpoint.failed(&error))?;
        job.report(((i << 20) + part.len()) as f64 / order.len() as f64);
    }
    finish(job, checkpoint, &output, header.clone())?;
    Ok(Finished { header, resumed: 0, buckets: 1, resumed_levels: 0, notices: scene.notices.clone() })
}

/// Completes the output from the pages of the scene. Returns the number of groups that an earlier run had built.
pub(crate) fn finish(job: &Job, checkpoint: Checkpoint, scene: &Output, header: Header) -> Result<usize> {
    let file = checkpoint.file(PAGES)?;
    let output = scene.for_file(&file);
    let mut resumed = 0;
    if job.settings.has_levels {
        let (count, progress) = (header.statistics.count, |done: f64| (job.progress)(0.3 + 0.7 * done));
        let groups = GroupCheckpoint::new(&checkpoint, &file);
        // Without a state, no run can resume.
        let groups = checkpoint.path(STATE).is_file().then_some(&groups);
        let build_levels = || {
            let fit_options = FitOptions { shape_rounds: job.settings.fit_rounds, fitter: job.fitter };
            let sizes = (count, header.layout.sh_degree);
            build((&output, scene.file, groups), sizes, fit_options, &progress, job.is_cancelled)
        };
        // Some threads wait for the device.
        let more_threads = || threads::pool(rayon::current_num_threads() * 3 / 2).ok();
        let built = while_syncing(checkpoint.file(PAGES)?, || match job.fitter.and_then(|_| more_threads()) {
            Some(pool) => pool.install(build_levels),
            None => build_levels(),
        });
        built.with_context(|| format!("cannot write the levels of {}", job.output.display()))?;
        resumed = groups.map_or(0, |groups| groups.found.load(Ordering::Relaxed));
    }
    complete(checkpoint, &output, header)?;
    Ok(resumed)
}

/// Runs `work` while another thread has the system write to the disk what a file holds so far, so that less is left for
/// the end. The file is opened for this alone: a failed write is reported to each open file once, so that later calls
/// for another one report it, too. At the end, this waits for a running write to the disk.
fn while_syncing<T>(file: File, work: impl FnOnce() -> T) -> T {
    threads::scope(|threads| {
        // The thread ends once the sender is dropped.
        let (_sender, receiver) = mpsc::channel::<()>();
        // If the system refuses the thread, the end takes longer.
        _ = threads.spawn(move || {
            while receiver.recv_timeout(SYNC_INTERVAL) == Err(RecvTimeoutError::Timeout) && file.sync_data().is_ok() {}
        });
        work()
    })
}

/// Gives the output its name, once all pages are written.
pub(crate) fn complete(checkpoint: Checkpoint, output: &Output, header: Header) -> Result<()> {
    let finished = output.finish(header).and_then(|()| Ok(output.file.sync_all()?));
    let written = finished.inspect_err(|_| checkpoint.remove(STATE));
    written.with_context(|| format!("cannot write {}", checkpoint.output().display()))?;
    checkpoint.finish(PAGES)
}

pub(crate) const CHANGED: &str = "the source was changed while it was read";

/// One pass over the blocks for the statistics, or two if the source has another number of Gaussians than expected.
/// Also returns a sample of means. `passes` is the number of passes of the whole job.
pub(crate) fn statistics_passes(job: &Job, blocks: &Blocks, passes: f64) -> Result<(Scene, Statistics, Vec<[f32; 3]>)> {
    let pass = |known: Option<usize>| {
        let mut all: Option<Accumulator> = None;
        let scene = blocks(&mut |block, of| {
            job.check()?;
            let count = known.unwrap_or(of);
            let all = all.get_or_insert_with(|| Accumulator::new(count, block.sh_degree()));
            all.add(&block);
            job.report(all.added() as f64 / count.max(1) as f64 / passes);
            Ok(())
        })?;
        let all = all.filter(|all| all.added() > 0).context("there are no Gaussians")?;
        check_count(all.added())?;
        anyhow::Ok((scene, all))
    };
    let (mut scene, mut all) = pass(None)?;
    if !all.is_complete() {
        (scene, all) = pass(Some(all.added()))?;
        ensure!(all.is_complete(), CHANGED);
    }
    let sample = all.sample().to_vec();
    Ok((scene, job.statistics(all.finish()), sample))
}

/// Writes a scene that is read in blocks, in bounded memory: in buckets along the Morton curve, which are sorted one by
/// one. A checkpoint beside the output lets a later run with the same source and settings resume.
///
/// # Errors
/// Those of the source; if the file cannot be written; [`Cancelled`].
pub fn write_blocks(job: &Job, source: &Path, blocks: &Blocks, changes: &str) -> Result<Finished> {
    ensure!(job.settings.memory >= LEAST_MEMORY, "pages cannot be sorted in {} bytes", job.settings.memory);
    let checkpoint = Checkpoint::beside(job.output, STATE)?;
    let work = Work::on(source, &(&job.settings, &job.title, changes));
    let earlier = work.as_ref().map(|work| resumed(job, &checkpoint, work)).transpose()?.flatten();
    let (mut state, header) = match earlier {
        Some(found) => found,
        None => begin(job, &checkpoint, blocks, work)?,
    };
    let resumed = state.done;
    let degree = header.statistics.sh_degree;
    let curve = header.statistics.curve();
    let file = checkpoint.file(job.scene_file())?;
    let output = Output::new(&file, (&header.layout, header.alpha_min), header.pages());
    while state.done < state.buckets.len() {
        job.check()?;
        let rest = if state.done == 0 { Vec::new() } else { checkpoint.read(&rest(state.done)).unwrap_or_default() };
        let rest: Vec<u32> = rest.as_chunks().0.iter().map(|bytes| u32::from_ne_bytes(*bytes)).collect();
        // With damaged buckets, the next run starts anew.
        let records = records(&checkpoint, state.done, state.buckets[state.done], &rest, degree);
        let records = records.inspect_err(|_| checkpoint.remove(STATE))?;
        let is_last = state.done + 1 == state.buckets.len();
        let rest = write_bucket(&output, state.written / PAGE, &records, (curve, degree), is_last)
            .map_err(|problem| problem.context(format!("cannot write {}", job.output.display())))?;
        file.sync_data().map_err(|error| checkpoint.failed(&error))?;
        state.written += (records.len() - rest.len()) / record_words(degree);
        state.done += 1;
        checkpoint.save(&self::rest(state.done), bytemuck::cast_slice(&rest))?;
        checkpoint.save(STATE, &serde_json::to_vec(&state)?)?;
        checkpoint.remove(&name(state.done - 1));
        checkpoint.remove(&self::rest(state.done - 1));
        job.report((2.0 + state.done as f64 / state.buckets.len() as f64) / 3.0);
    }
    let (count, written) = (header.statistics.count, state.written);
    if written != count {
        checkpoint.remove(STATE);
        bail!("{written} of {count} Gaussians were written: the checkpoint of an earlier run is damaged; run it again");
    }
    let resumed_levels = finish(job, checkpoint, &output, header.clone())?;
    Ok(Finished { header, resumed, buckets: state.buckets.len(), resumed_levels, notices: state.notices })
}

/// The name of the file with the records that the buckets before leave to this one.
fn rest(bucket: usize) -> String {
    format!("{REST}.{bucket}")
}

/// The state of an earlier run on the same source with the same settings.
///
/// # Errors
/// If the source cannot be read; [`Cancelled`].
fn resumed(job: &Job, checkpoint: &Checkpoint, work: &Work) -> Result<Option<(State, Header)>> {
    let Some((state, header)) = saved(job, checkpoint) else { return Ok(None) };
    let without_hash = Work { hash: String::new(), ..state.work.clone() };
    let is_same = without_hash == *work && work.clone().hashed(|| job.check())? == state.work;
    Ok(is_same.then_some((state, header)))
}

/// The state of an earlier run, if it is whole.
fn saved(job: &Job, checkpoint: &Checkpoint) -> Option<(State, Header)> {
    let state: State = serde_json::from_slice(&checkpoint.read(STATE)?).ok()?;
    let header = Header::decoded(checkpoint.read(HEADER_FILE)?.first_chunk::<HEADER>()?).ok()?;
    let has = |name: &str| checkpoint.path(name).is_file();
    let is_whole = has(job.scene_file()) && (state.done == 0 || has(&rest(state.done)));
    is_whole.then_some((state, header))
}

/// Fills the buckets while another thread computes the hash of the source.
fn begin(job: &Job, checkpoint: &Checkpoint, blocks: &Blocks, work: Option<Work>) -> Result<(State, Header)> {
    let has_failed = AtomicBool::new(false);
    let go_on = || {
        ensure!(!has_failed.load(Ordering::Relaxed), "the source is needed no more");
        Ok(())
    };
    threads::scope(|threads| {
        let hash = || work.context("the source is no regular file")?.hashed(go_on);
        let hashing = threads.spawn(hash)?;
        let filled = fill_buckets(job, checkpoint, blocks, || joined(hashing));
        has_failed.store(filled.is_err(), Ordering::Relaxed);
        filled
    })
}

fn fill_buckets(
    job: &Job,
    checkpoint: &Checkpoint,
    blocks: &Blocks,
    work: impl FnOnce() -> Result<Work>,
) -> Result<(State, Header)> {
    checkpoint.clear()?;
    let (scene, statistics, sample) = statistics_passes(job, blocks, 3.0)?;
    let (count, degree) = (statistics.count, statistics.sh_degree);
    let bounds = BucketBounds::new(statistics.curve(), &sample, count, degree, job.settings.memory);
    let mut filling = BucketWriter::new(checkpoint, &bounds)?;
    let mut added = 0;
    blocks(&mut |block, _| {
        job.check()?;
        ensure!(added + block.len() <= count && block.sh_degree() == degree, CHANGED);
        filling.add(&block, added)?;
        added += block.len();
        job.report((1.0 + added as f64 / count as f64) / 3.0);
        Ok(())
    })?;
    ensure!(added == count, CHANGED);
    let layout = job.layout(&statistics);
    let header = job.header(&scene, statistics, layout);
    let file = checkpoint.file(job.scene_file())?;
    let header = Output::new(&file, (&header.layout, header.alpha_min), header.pages()).with_offsets(header.clone());
    let buckets = filling.finish()?;
    let state = State { work: work()?, buckets, done: 0, written: 0, notices: scene.notices.clone() };
    checkpoint.save(HEADER_FILE, &header.encoded())?;
    checkpoint.save(STATE, &serde_json::to_vec(&state)?)?;
    Ok((state, header))
}

/// Sorts the records of a bucket and writes its pages. Returns the records after its last whole page, in their order.
fn write_bucket(
    output: &Output,
    first: usize,
    records: &[u32],
    (curve, degree): (Curve, u32),
    is_last: bool,
) -> Result<Vec<u32>> {
    let each = record_words(degree);
    let gaussians = gaussians_of(records, degree)?;
    let record = |index: u32| &records[index as usize * each..][..each];
    let keyed = |index: u32| (curve.key(mean_of(record(index))), record(index)[0], index);
    let mut keys: Vec<_> = (0..gaussians.len() as u32).into_par_iter().map(keyed).collect();
    keys.par_sort_unstable();
    let order: Vec<u32> = keys.into_iter().map(|(_, _, index)| index).collect();
    let whole = if is_last { order.len() } else { order.len() / PAGE * PAGE };
    output.write(first, &gaussians, &order[..whole], |index| record(index)[0])?;
    Ok(order[whole..].iter().flat_map(|index| record(*index)).copied().collect())
}
