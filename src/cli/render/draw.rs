//! Draws and writes the pictures of a plan, on the GPU or with the reference.

use std::time::Instant;

use anyhow::Result;

use super::outputs::Output;
use super::report::{FileReport, FrameReport};
use super::resume::Record;
use super::{Args, Plan, Shot};
use crate::cli::{Usage, certified, complain, dump, progress, remark, say, size_text};
use crate::gpu::{Commands, Device};
use crate::options::Options;
use crate::reference;
use crate::render::{Frame, GpuScene, Inspection, Look, Path, Renderer, Work, depths};
use crate::scene::{Gaussians, Requirements, Scene};

/// The content of one frame: the picture, or its depths and counts.
#[derive(Clone, Copy, PartialEq)]
enum Pass {
    Picture,
    Depths,
}

impl Pass {
    /// The files of a shot that this pass fills and that are not complete yet.
    fn outputs<'s>(self, shot: &'s Shot, record: &Record) -> Vec<&'s Output> {
        let is_picture = self == Self::Picture;
        shot.outputs.iter().filter(|output| output.layer.is_of_picture() == is_picture && !record.has(output)).collect()
    }

    fn inspection(self) -> Inspection {
        let look = if self == Self::Picture { Look::Colour } else { Look::Work(Work::Depths) };
        Inspection { look, ..Inspection::default() }
    }
}

/// Draws with the reference. All layers of a shot come from one rendering.
pub(super) fn by_reference(
    args: &Args,
    plan: &Plan,
    gaussians: &Gaussians,
    exact: &Options,
) -> Result<Vec<FrameReport>> {
    let mut frames = Vec::new();
    let mut record = Record::begin(args, plan, gaussians, exact, None)?;
    for shot in &plan.shots {
        let [pictures, layers] = [Pass::Picture, Pass::Depths].map(|pass| pass.outputs(shot, &record));
        if pictures.is_empty() && layers.is_empty() {
            continue;
        }
        let started = Instant::now();
        let rendering = reference::render(gaussians, &shot.camera, &exact.rules, args.background);
        if !pictures.is_empty() {
            let pixels = rendering.to_pixels();
            write(&pictures, &mut record, |output| output.write_picture(&pixels, args.background))?;
        }
        if !layers.is_empty() {
            let depths = rendering.depths();
            write(&layers, &mut record, |output| output.write_depths(&depths))?;
        }
        let (outputs, seconds) = ([pictures, layers].concat(), started.elapsed().as_secs_f64());
        let (files, size) = (names(&outputs), size_text(shot.camera.size_px));
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
    device: &Device,
    scene: Scene,
    (exact, options): (Options, Options),
) -> Result<(Options, Vec<FrameReport>)> {
    let (gaussians, needs) = (&scene.gaussians, Requirements::of(&scene.gaussians));
    let views: Vec<_> = plan.shots.iter().map(|shot| shot.camera.clone()).collect();
    let options = args.budget.choose(device, (gaussians, &needs), &views, (exact, args.background), options)?;
    if let Some(layer) = plan.outputs.depths().next().filter(|_| options.scale != 1.0) {
        return Err(Usage(format!("--layers {} needs --scale 1", layer.name())).into());
    }
    let mut record = Record::begin(args, plan, gaussians, &options, Some(&device.capabilities().name))?;
    if record.is_complete(plan) {
        record.finish()?;
        return Ok((options, Vec::new()));
    }
    args.start.end("layout");
    let certifies = args.certificate.is_some();
    let upload = if certifies { GpuScene::certifiable } else { GpuScene::with };
    let gpu_scene = upload(device, gaussians, &needs, &options)?;
    // Returning the memory of a large scene takes the system long.
    rayon::spawn(|| drop(scene));
    args.start.end("upload");
    let create = if certifies { Renderer::certified } else { Renderer::new };
    let mut renderer = create(device, &options, &gpu_scene)?;
    args.start.end_with("pipelines", renderer.trial_time().map(|time| ("trial", time)));
    if let Some(notice) = renderer.notice() {
        remark(&format!("note: {notice}"));
    }
    let bar = progress::Bar::new("rendering");
    // All shots of one pass come before the next pass, so that the pipelines are created once per pass.
    let all =
        [Pass::Picture, Pass::Depths].into_iter().flat_map(|pass| plan.shots.iter().map(move |shot| (pass, shot)));
    let left: Vec<_> = all.filter(|(pass, shot)| !pass.outputs(shot, &record).is_empty()).collect();
    let mut frames = Vec::new();
    for (done, (pass, shot)) in left.iter().enumerate() {
        let outputs = pass.outputs(shot, &record);
        renderer.set_inspection(pass.inspection())?;
        frames.push(draw(args, &mut renderer, (*pass, shot), &outputs, &mut record)?);
        args.start.end("first picture");
        bar.set((done + 1) as f64 / left.len() as f64);
    }
    complain(device)?;
    record.finish()?;
    Ok((options, frames))
}

fn draw(
    args: &Args,
    renderer: &mut Renderer,
    (pass, shot): (Pass, &Shot),
    outputs: &[&Output],
    record: &mut Record,
) -> Result<FrameReport> {
    let prepare = |cmd: &mut Commands| {
        if args.dump.is_some() {
            cmd.capture_scopes();
        }
    };
    let (frame, results) = renderer.render_with(&shot.camera, args.background, prepare)?;
    if let Some(folder) = &args.dump {
        dump::write(folder, results.captures())?;
    }
    let pixels = renderer.pixels()?;
    match pass {
        Pass::Picture => write(outputs, record, |output| output.write_picture(&pixels, args.background))?,
        Pass::Depths => {
            let depths = depths(&pixels);
            write(outputs, record, |output| output.write_depths(&depths))?;
        }
    }
    report(args, shot, outputs, &frame)?;
    let mut drawn = FrameReport { gpu: Some((&frame).into()), ..FrameReport::new(shot, outputs) };
    if let (Some(file), Some(certificate)) = (&shot.certificate, renderer.certificate()?) {
        certificate.write(file, false)?;
        say!("  {}", certified(certificate.largest()))?;
        drawn.files.push(FileReport { layer: "certificate".to_owned(), path: file.display().to_string() });
        drawn.certified_error = Some(certificate.largest());
    }
    Ok(drawn)
}

fn write(outputs: &[&Output], record: &mut Record, write: impl Fn(&Output) -> Result<()>) -> Result<()> {
    outputs.iter().try_for_each(|output| {
        write(output)?;
        record.add(output)
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
        .map_or_else(String::new, |t| format!(", {:.2} ms on the GPU", t.duration_ms));
    let (visible, listed, files) = (totals.visible, totals.listed_kept, names(outputs));
    let unit = match frame.path {
        Path::Portable => "instances",
        Path::Fast => "entries",
    };
    if visible == 0 {
        remark(&format!("note: {files}: no Gaussian is in view"));
    }
    say!(
        "{files}  {}  {visible} visible, {listed} {unit}, {} path{gpu_ms}",
        size_text(shot.camera.size_px),
        frame.path
    )?;
    if args.timings {
        let mut stages: Vec<_> = frame.timings.iter().filter(|t| t.depth > 0).collect();
        stages.sort_by(|a, b| a.start_ms.total_cmp(&b.start_ms));
        for stage in stages {
            say!("  {:<12} {:8.3} ms", stage.name, stage.duration_ms)?;
        }
    }
    Ok(())
}
