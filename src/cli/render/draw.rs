//! Draws and writes the pictures of a plan, on the GPU or with the reference.

use std::collections::{BTreeMap, VecDeque};
use std::num::NonZero;
use std::thread::available_parallelism;
use std::time::{Duration, Instant};

use anyhow::{Context, Result};
use crossbeam_channel::{bounded, unbounded};

use super::Args;
use super::bands::{Share, bands_of};
use super::device::Run;
use super::encode::{Job, Task, Times, Written};
use super::notes::Notes;
use super::outputs::{Output, Shot};
use super::plan::Plan;
use super::records::Content;
use super::report::{FileReport, FrameReport};
use super::resume::Record;
use super::video::Encoder;
use crate::cli::drawable::Drawable;
use crate::cli::levels::decibels;
use crate::cli::progress::Bar;
use crate::cli::{Usage, certified, complain, devices::SHARE_NEEDS_SEVERAL, remark, say, size_text};
use crate::files::text_of;
use crate::gpu::{Device, names_of};
use crate::host_memory::OutOfMemory;
use crate::options::Options;
use crate::reference;
use crate::render::{self, Frame, LodReport, Path, SceneSource, SlabReport};
use crate::threads::{self, joined};

/// The files of a view that are not complete yet: those of the picture, and those of depths and counts.
fn outputs_left<'p>(shot: &'p Shot, record: &Record) -> [Vec<&'p Output>; 2] {
    let left = shot.outputs.iter().filter(|output| !record.has(output));
    let (picture, depths) = left.partition(|output| output.layer.is_of_picture());
    [picture, depths]
}

/// Draws with the reference. All layers of a shot come from one rendering.
pub(super) fn by_reference(args: &Args, plan: &Plan, scene: &Drawable, exact: &Options) -> Result<Vec<FrameReport>> {
    let mut frames = Vec::new();
    let mut record = Record::begin(args, plan, &scene.report().hash, exact, None)?;
    let (gaussians, _) = scene.in_memory("--reference")?;
    let gaussians = gaussians.clone().of_degree(exact.sh_degree);
    let mut notes = Notes::new(&scene.source, exact.rules.near);
    for shot in &plan.shots {
        let [pictures, layers] = outputs_left(shot, &record);
        if pictures.is_empty() && layers.is_empty() {
            continue;
        }
        let started = Instant::now();
        let rendering = reference::render(&gaussians, &shot.camera, &exact.rules, args.background);
        if !pictures.is_empty() {
            let pixels = rendering.to_pixels();
            write(&pictures, &mut record, |output| output.write_picture(&pixels, args))?;
        }
        if !layers.is_empty() {
            let depths = rendering.depths();
            write(&layers, &mut record, |output| output.write_depths(&depths, args))?;
        }
        let (outputs, seconds) = ([pictures, layers].concat(), started.elapsed().as_secs_f64());
        let (files, size) = (names(&outputs), size_text(shot.camera.size_px));
        notes.on_view(&files, &shot.camera, false);
        say!("{files}  {size}  float64 reference, {seconds:.1} s")?;
        frames.push(FrameReport { reference_seconds: Some(seconds), ..FrameReport::new(shot, &outputs) });
    }
    record.finish()?;
    Ok(frames)
}

/// Draws on the GPU. `exact` has the same rules as `options` and no knob turned. Returns the options that were used.
pub(super) fn by_gpu(
    args: &Args,
    plan: &Plan,
    devices: &[Device],
    scene: Drawable,
    (exact, options): (Options, Options),
) -> Result<(Options, Vec<FrameReport>)> {
    let views: Vec<_> = plan.shots.iter().map(|shot| shot.camera.clone()).collect();
    let options = args.budget.choose(&devices[0], &scene, &views, (exact, args.background), options)?;
    if let Some(layer) = plan.outputs.depths().next().filter(|_| options.scale != 1.0) {
        return Err(Usage(format!("--layers {} needs --scale 1", layer.name())).into());
    }
    let record = Record::begin(args, plan, &scene.report().hash, &options, Some(&names_of(devices)))?;
    let tasks = plan.shots.iter().enumerate().map(|(number, shot)| {
        let [picture, depths] = outputs_left(shot, &record);
        Task { number, shot, picture, depths, is_of_video: plan.video.is_some(), band: None }
    });
    let tasks: Vec<_> = tasks.filter(|task| !task.is_done()).collect();
    if tasks.is_empty() {
        record.finish()?;
        return Ok((options, Vec::new()));
    }
    args.start.end("layout");
    let encoders = available_parallelism().map_or(1, NonZero::get);
    let (total, bar) = (tasks.len(), Bar::new("rendering"));
    let mut log = Log {
        args,
        record,
        video: None,
        frames: Vec::new(),
        unreported: tasks.iter().map(|task| task.number).collect(),
        done: BTreeMap::new(),
        total,
        bar,
        notes: Notes::new(&scene.source, options.rules.near),
        times: Spent::default(),
    };
    let (tasks, drawers) = divided(args, &options, tasks, devices.len(), is_streamed(&scene.source));
    let run = Run::new(args, options, tasks, (devices, drawers), encoders);
    let frames = match &plan.video {
        None => draw(&run, devices, scene.source, encoders, log)?,
        Some(video) => video.write(|encoder| {
            log.video = Some(encoder);
            draw(&run, devices, scene.source, encoders, log)
        })?,
    };
    devices.iter().try_for_each(complain)?;
    Ok((options, frames))
}

/// True for a page file of so many Gaussians that a picture takes longer than the start of another device.
fn is_streamed(scene: &SceneSource) -> bool {
    const LARGE: usize = 50_000_000;
    matches!(scene.content, render::Content::File(_)) && scene.count() >= LARGE
}

/// The tasks of all views, those of some views band by band, and the number of devices that begin.
fn divided<'p>(
    args: &Args,
    options: &Options,
    tasks: Vec<Task<'p>>,
    devices: usize,
    is_streamed: bool,
) -> (Vec<Task<'p>>, usize) {
    let is_asked_for = args.share == Share::Frame && devices > 1;
    // To prepare another device takes longer than to draw a picture of a scene that fits into device memory.
    let is_shared = is_asked_for || args.share == Share::Auto && is_streamed && tasks.len() < devices;
    let (all, views) = (devices, tasks.len());
    let devices = if is_shared { all } else { 1 };
    if args.share == Share::Frame && devices == 1 {
        remark(SHARE_NEEDS_SEVERAL);
    }
    let (mut divided, mut why) = (Vec::new(), None);
    for task in tasks {
        let whole = task.whole_because(args, options);
        let bands = bands_of(task.shot.camera.size_px, devices);
        if whole.is_some() || bands.is_empty() {
            why = why.or(whole);
            divided.push(task);
            continue;
        }
        divided.extend(bands.into_iter().map(|band| Task { band: Some(band), ..task.clone() }));
    }
    if let Some(why) = why.filter(|_| is_asked_for) {
        remark(&format!("note: --share frame: {why}; one device draws each of them"));
    }
    let drawers = all.min(if is_shared { divided.len() } else { views });
    (divided, drawers)
}

/// Draws on all devices, encodes on all cores, and notes on this thread what is complete.
fn draw<'p>(
    run: &Run<'p>,
    devices: &[Device],
    scene: SceneSource,
    encoders: usize,
    mut log: Log<'p>,
) -> Result<Vec<FrameReport>> {
    let (jobs, to_encode) = unbounded::<Job>();
    // Where the frames of a video wait until ffmpeg takes them, the threads that encode wait, too.
    let (written, to_note) = bounded(encoders);
    let is_recorded = log.record.is_kept();
    let (failure, lost) = threads::scope(|threads| -> Result<_> {
        let stop = |_: &OutOfMemory| run.queue.stop();
        for _ in 0..encoders {
            let (to_encode, written) = (to_encode.clone(), written.clone());
            let encode = move || {
                let _guard = run.queue.stopped_by_panics();
                for job in to_encode {
                    // Without the other end the run has failed.
                    if let Some(outcome) = job.run(run.args, &run.bands, is_recorded).transpose() {
                        _ = written.send(outcome);
                    }
                }
            };
            threads.spawn(encode)?;
        }
        drop((to_encode, written));
        let mut drawers = Vec::new();
        for (number, device) in devices.iter().enumerate() {
            let (scene, jobs) = (scene.clone(), jobs.clone());
            let draw = move || {
                let _guard = run.queue.stopped_by_panics();
                run.draw_on((number, device), scene, jobs).inspect_err(|error| go_on(run, device, devices, error))
            };
            drawers.push(threads.spawn(draw).inspect_err(stop)?);
        }
        drop((scene, jobs));
        let mut failure = None;
        for outcome in to_note {
            if let Err(error) = outcome.and_then(|view| log.note(view)) {
                run.queue.stop();
                failure.get_or_insert(error);
            }
        }
        Ok((failure, drawers.into_iter().map(joined).filter_map(Result::err).next()))
    })?;
    let failure = failure.or(lost.filter(|_| run.queue.is_abandoned()));
    log.report_rest()?;
    failure.map_or(Ok(()), Err)?;
    log.finish(run, encoders)
}

/// Says that a device is lost, if there are others.
fn go_on(run: &Run, device: &Device, devices: &[Device], error: &anyhow::Error) {
    if devices.len() > 1 && run.queue.is_open() {
        let name = &device.capabilities().name;
        remark(&format!("note: {name} draws no more: {error:#}; the other devices draw its pictures"));
    }
}

/// What is complete.
struct Log<'p> {
    args: &'p Args,
    record: Record,
    video: Option<Encoder>,
    frames: Vec<FrameReport>,
    /// The places in the plan of the views that are not reported yet, in their order.
    unreported: VecDeque<usize>,
    /// Views whose files are written, and that are reported after those ahead of them.
    done: BTreeMap<usize, (Task<'p>, Vec<Frame>, Option<f32>)>,
    total: usize,
    bar: Bar,
    notes: Notes,
    times: Spent,
}

/// The time of all devices and threads together.
#[derive(Default)]
struct Spent {
    views: usize,
    gpu: Duration,
    host: Times,
}

impl<'p> Log<'p> {
    /// Records a view whose files are written, and reports it if those ahead of it are reported.
    fn note(&mut self, view: Written<'p>) -> Result<()> {
        self.args.start.end("first picture");
        let Written { task, frames, contents, certified, rgb8, times } = view;
        let files = task.picture.iter().chain(&task.depths).zip(contents);
        let mut known = files.filter_map(|(output, content)| Some((output, content?)));
        known.try_for_each(|(output, content)| self.record.add(output, content))?;
        if let (Some(video), Some(frame)) = (&mut self.video, rgb8) {
            video.add(task.number, frame)?;
        }
        self.times.gpu += frames.iter().map(|frame| Duration::from_secs_f64(frame.gpu_ms() / 1e3)).sum::<Duration>();
        self.times.host += times;
        self.times.views += 1;
        self.bar.set_counted(self.times.views, self.total, "pictures");
        self.done.insert(task.number, (task, frames, certified));
        while let Some(view) = self.unreported.front().and_then(|next| self.done.remove(next)) {
            self.unreported.pop_front();
            self.report_view(view)?;
        }
        Ok(())
    }

    /// Reports a view.
    fn report_view(&mut self, (task, frames, bound): (Task, Vec<Frame>, Option<f32>)) -> Result<()> {
        let has_frame = |outputs: &&Vec<_>| !outputs.is_empty() || task.is_of_video;
        for (outputs, frame) in [&task.picture, &task.depths].into_iter().filter(has_frame).zip(&frames) {
            let title = if task.is_of_video { format!("frame {}", task.number) } else { names(outputs) };
            self.notes.on_frame(&title, &task.shot.camera, frame);
            if !task.is_of_video {
                report(self.args, task.shot, outputs, frame)?;
            }
            self.frames.push(FrameReport { gpu: Some(frame.into()), ..FrameReport::new(task.shot, outputs) });
        }
        if let (Some(bound), Some(file), Some(drawn)) = (bound, &task.shot.certificate, self.frames.last_mut()) {
            match self.args.certify_rays {
                true => {
                    say!("  certified: no value is further than {bound:.4} from the response along rays (as stored)")?
                }
                false => say!("  {}", certified(bound))?,
            }
            drawn.files.push(FileReport { layer: "certificate".to_owned(), path: text_of(file) });
            drawn.certified_error = Some(bound);
        }
        Ok(())
    }

    /// Reports the views that wait for others, which a failed run never draws.
    fn report_rest(&mut self) -> Result<()> {
        std::mem::take(&mut self.done).into_values().try_for_each(|view| self.report_view(view))
    }

    /// The reports of all frames, in the order of the plan.
    fn finish(self, run: &Run, encoders: usize) -> Result<Vec<FrameReport>> {
        self.record.finish()?;
        self.video.map_or(Ok(()), Encoder::finish)?;
        if let (2.., Some(started)) = (self.total, run.started.get()) {
            self.times.say(started.elapsed(), run.args.timings.then_some(encoders))?;
        }
        Ok(self.frames)
    }
}

impl Spent {
    /// Prints the speed of a run that took `wall`; with `encoders`, how busy the GPU and these threads were.
    fn say(&self, wall: Duration, encoders: Option<usize>) -> Result<()> {
        let (views, seconds) = (self.views, wall.as_secs_f64());
        say!("{views} pictures in {seconds:.2} s, {:.1} a second", views as f64 / seconds)?;
        let Some(encoders) = encoders else { return Ok(()) };
        let part = |time: Duration, threads: usize| 100.0 * time.as_secs_f64() / seconds / threads as f64;
        say!("  {:<12} {:8.3} s, {:.0} %", "GPU", self.gpu.as_secs_f64(), part(self.gpu, 1))?;
        for (name, time) in [("encoding", self.host.encoding), ("writing", self.host.writing)] {
            say!("  {name:<12} {:8.3} s, {:.0} % of {encoders} threads", time.as_secs_f64(), part(time, encoders))?;
        }
        Ok(())
    }
}

fn write(outputs: &[&Output], record: &mut Record, write: impl Fn(&Output) -> Result<()>) -> Result<()> {
    outputs.iter().try_for_each(|output| {
        write(output)?;
        if !record.is_kept() {
            return Ok(());
        }
        record.add(output, Content::of(&output.path).with_context(|| output.path.display().to_string())?)
    })
}

fn names(outputs: &[&Output]) -> String {
    outputs.iter().map(|output| output.path.display().to_string()).collect::<Vec<_>>().join(", ")
}

/// Prints the counts and times of a frame. A listed splat is an instance (in a tile) on the portable path, and an entry
/// (in a bin) on the fast path.
fn report(args: &Args, shot: &Shot, outputs: &[&Output], frame: &Frame) -> Result<()> {
    let totals = &frame.totals;
    let gpu_ms = frame
        .timings
        .iter()
        .find(|t| t.depth == 0)
        .map_or_else(String::new, |t| format!(", {:.2} ms on the device", t.duration_ms));
    let (visible, listed, files) = (totals.visible, totals.listed_kept, names(outputs));
    let unit = match frame.path {
        Path::Portable | Path::Rays => "instances",
        Path::Fast | Path::FastRays => "entries",
    };
    let parts = frame.parts.filter(|p| p.slabs > 1 || p.pages_in_view > 0);
    // What lies behind finished slabs is not counted.
    let least = if parts.is_some_and(|parts| parts.slabs > 1) { "at least " } else { "" };
    say!(
        "{files}  {}  {least}{visible} visible, {listed} {unit}, {} path{gpu_ms}",
        size_text(shot.camera.size_px),
        frame.path
    )?;
    if let Some(SlabReport { slabs, wall_ms, pages_in_view, pages_read, bytes_read }) = parts {
        let pages = match pages_in_view {
            0 => String::new(),
            seen => format!("; {seen} pages in view, {pages_read} read for it ({:.1} MB)", bytes_read as f64 / 1e6),
        };
        let slabs = if slabs == 1 { "1 depth slab".to_owned() } else { format!("{slabs} depth slabs") };
        say!("  in {slabs}, {wall_ms:.1} ms in all{pages}")?;
    }
    if let Some(detail) = frame.detail {
        let LodReport { lod_error, nodes, pages, measured_psnr, standard_error, patches, .. } = detail;
        let limit = match detail.is_coarsest() {
            true => "there are no coarser ones".to_owned(),
            false => format!("error {lod_error:.3} per node"),
        };
        let measured = match measured_psnr {
            Some(db) => format!(", {} to all Gaussians", decibels(db, standard_error)),
            None if args.measure_levels.is_some() => match patches {
                Some([drawn, all]) if drawn < all => format!(", equal to all Gaussians in {drawn} of {all} patches"),
                _ => ", equal to all Gaussians".to_owned(),
            },
            None => String::new(),
        };
        say!(
            "  about {nodes:.0} nodes in {pages} page{} of the levels, {limit}{measured}",
            if pages == 1 { "" } else { "s" }
        )?;
    }
    if args.timings {
        let mut stages: Vec<_> = frame.timings.iter().filter(|t| t.depth > 0).collect();
        stages.sort_by(|a, b| a.start_ms.total_cmp(&b.start_ms));
        for stage in stages {
            say!("  {:<12} {:8.3} ms", stage.name, stage.duration_ms)?;
        }
    }
    Ok(())
}
