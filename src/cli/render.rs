//! `smalto render`: pictures of a scene, to files.

use std::fs;
use std::path::PathBuf;
use std::time::Instant;

use anyhow::{Context, Result};
use glam::DVec3;

use super::{
    BudgetArgs, DeviceArgs, FilmArgs, Knobs, SceneArg, SplitArg, Usage, certified, complain, dump, knobs,
    named_or_found, parse_size, progress, remark, say, size_text,
};
use crate::camera::{Camera, NamedCamera};
use crate::files::check_writable;
use crate::gpu::Commands;
use crate::options::{Background, Options};
use crate::pixels::{FileKind, Pixels};
use crate::reference;
use crate::render::{Frame, GpuScene, Still};
use crate::scene::{Focus, Gaussians, Requirements};

/// Render a scene to PNG, EXR or .npy
#[derive(clap::Args)]
pub(super) struct Args {
    #[command(flatten)]
    scene: SceneArg,
    /// Picture file, or folder for several as PNG [default: the scene's name with .png, or `renders`]. A .png has 8 bits
    /// a channel; .exr and .npy hold the 32-bit floats, alpha multiplied in
    #[arg(short, long, value_name = "FILE|DIR")]
    output: Option<PathBuf>,
    /// Picture size in pixels [default: the camera's own, or 1280x720]
    #[arg(long, value_name = "WxH", value_parser = parse_size)]
    size: Option<[u32; 2]>,
    /// Camera file: cameras.json of the original 3DGS, transforms.json of nerfstudio, instant-ngp or Blender's sets, or a
    /// sparse model of COLMAP (its folder, the one above it, or images.bin or .txt) [default: found beside the scene or above it]
    #[arg(long, value_name = "FILE|DIR")]
    cameras: Option<PathBuf>,
    #[command(flatten)]
    split: SplitArg,
    /// Which camera of the file: its position in it, its image name, or `all` [default: 0]
    #[arg(long, value_name = "N|NAME|all")]
    camera: Option<String>,
    #[command(flatten)]
    film: FilmArgs,
    /// What lies behind the scene: three numbers from 0 to 1, or `transparent`
    #[arg(long, value_name = "R,G,B|transparent", default_value = "0,0,0", value_parser = parse_background)]
    background: Background,
    #[command(flatten)]
    device: DeviceArgs,
    /// Accuracy against speed: exact, balanced, fast or preview; or as inria, gsplat or khr draw [default:
    /// balanced]
    #[arg(long, value_name = "NAME", conflicts_with_all = ["max_error", "min_psnr"], value_parser = knobs::preset_names())]
    preset: Option<String>,
    /// Use only what runs on every device, with no path chosen for this one
    #[arg(long)]
    portable: bool,
    /// Render on the CPU in float64 instead, exactly by the rules: the reference that the GPU is measured against. Slow
    #[arg(long, conflicts_with_all = ["device", "portable", "timings", "dump"])]
    reference: bool,
    /// Print the GPU time of every stage
    #[arg(long)]
    timings: bool,
    /// Also write, for every pixel, how far its channels are at most from the picture in which nothing is left out, by no
    /// threshold, cut or stop, of the scene as the GPU keeps it in the order in which it is sorted. An .exr or .npy file,
    /// or a folder for several pictures
    #[arg(long, value_name = "FILE|DIR", conflicts_with = "reference")]
    certificate: Option<PathBuf>,
    /// Write every buffer that a stage wrote, after that stage, to this folder as .npy
    #[arg(long, value_name = "DIR")]
    dump: Option<PathBuf>,
    #[command(flatten)]
    knobs: Knobs,
    #[command(flatten)]
    budget: BudgetArgs,
}

fn parse_background(text: &str) -> Result<Background> {
    if text == "transparent" {
        return Ok(Background::Transparent);
    }
    let numbers: Option<Vec<f32>> = text.split(',').map(|n| n.trim().parse().ok()).collect();
    let colour: Option<[f32; 3]> = numbers.and_then(|n| n.try_into().ok());
    let colour = colour.filter(|c| c.iter().all(|v| (0.0..=1.0).contains(v)));
    Ok(Background::Colour(colour.context("expected R,G,B from 0 to 1, like 1,1,1, or transparent")?))
}

/// The reference keeps 40 bytes a pixel.
const REFERENCE_SIDE: u32 = 16384;

/// Pictures to make, and how near the near plane has to be for them.
struct Plan {
    shots: Vec<Shot>,
    nearest: f32,
}

/// One picture to make.
struct Shot {
    camera: Camera,
    output: PathBuf,
    certificate: Option<PathBuf>,
}

pub(super) fn run(args: &Args) -> Result<()> {
    args.knobs.check()?;
    if args.budget.budget()?.is_some() && (args.knobs.trades() || args.reference) {
        return Err(Usage("a budget chooses the knobs itself, and those of the GPU alone".to_owned()).into());
    }
    if !args.reference {
        args.knobs.check_gpu()?;
    }
    // The device first: what is missing there is known at once, a scene may take a while.
    let device = if args.reference { None } else { Some(args.device.open()?) };
    let scene = args.scene.read()?;
    let Plan { shots, nearest } = plan(args, &scene.gaussians)?;
    let preset = args.preset.as_deref().and_then(Options::preset).unwrap_or_default();
    let preset = Options { portable: args.portable || preset.portable, ..preset };
    let options = args.knobs.options(&preset, scene.is_antialiased, nearest);
    let exact = args.knobs.options(&preset.untraded(), scene.is_antialiased, nearest);
    if let Some(why) = options.uncertifiable().filter(|_| args.certificate.is_some()) {
        return Err(Usage(format!("--certificate: {why}")).into());
    }
    match device {
        None => {
            for shot in &shots {
                let started = Instant::now();
                let pixels =
                    reference::render(&scene.gaussians, &shot.camera, &exact.rules, args.background).to_pixels();
                write(args, shot, &pixels)?;
                say!(
                    "{}  {}  float64 reference, {:.1} s",
                    shot.output.display(),
                    size_text(shot.camera.size_px),
                    started.elapsed().as_secs_f64()
                )?;
            }
        }
        Some(device) => {
            let views: Vec<Camera> = shots.iter().map(|shot| shot.camera.clone()).collect();
            let (gaussians, needs) = (&scene.gaussians, Requirements::of(&scene.gaussians));
            let options =
                args.budget.choose(&device, (gaussians, &needs), &views, (exact, args.background), options)?;
            let certifies = args.certificate.is_some();
            let upload = if certifies { GpuScene::certifiable } else { GpuScene::with };
            let gpu_scene = upload(&device, gaussians, &needs, &options)?;
            drop(scene);
            let still = if certifies { Still::certified } else { Still::new };
            let mut still = still(&device, &options, &gpu_scene)?;
            if let Some(notice) = still.notice() {
                remark(&format!("note: {notice}"));
            }
            let bar = progress::Bar::new("rendering");
            for (done, shot) in shots.iter().enumerate() {
                let prepare = |cmd: &mut Commands| {
                    if args.dump.is_some() {
                        cmd.capture_scopes();
                    }
                };
                let (frame, results) = still.render_with(&shot.camera, args.background, prepare)?;
                if let Some(folder) = &args.dump {
                    dump::write(folder, results.captures())?;
                }
                write(args, shot, &still.pixels()?)?;
                report(args, shot, &frame)?;
                if let (Some(file), Some(certificate)) = (&shot.certificate, still.certificate()?) {
                    certificate.write(file, false)?;
                    say!("  {}", certified(certificate.largest()))?;
                }
                bar.set((done + 1) as f64 / shots.len() as f64);
            }
            complain(&device)?;
        }
    }
    Ok(())
}

fn plan(args: &Args, gaussians: &Gaussians) -> Result<Plan> {
    let cameras = cameras(args)?;
    let wants_all = args.camera.as_deref() == Some("all") || args.film.is_wanted();
    let stem = args.scene.stem();
    let mut nearest = f32::INFINITY;
    let chosen: Vec<(usize, Camera)> = match (&cameras, &args.camera) {
        (None, None) => {
            let (camera, distance) = automatic(gaussians, args.size);
            nearest = distance as f32 / 100.0;
            vec![(0, camera)]
        }
        (None, Some(camera)) => {
            return Err(Usage(format!(
                "--camera {camera} needs a camera file: there is none beside the scene or above it, and no --cameras"
            ))
            .into());
        }
        (Some(all), _) if wants_all => all.iter().map(|c| c.camera.clone()).enumerate().collect(),
        (Some(all), None) => vec![(0, all[0].camera.clone())],
        (Some(all), Some(wanted)) => vec![pick(all, wanted)?],
    };
    let default = PathBuf::from(if wants_all { "renders".to_owned() } else { format!("{stem}.png") });
    let output = args.output.clone().unwrap_or(default);
    let is_folder = wants_all || output.is_dir() || output.as_os_str().to_string_lossy().ends_with('/');
    if !is_folder {
        FileKind::of(&output).map_err(|problem| Usage(format!("--output {problem}")))?;
    }
    if wants_all && args.dump.is_some() {
        return Err(Usage("--dump writes the buffers of one picture, not of --camera all or --path".to_owned()).into());
    }
    let certificate = |index: usize| match &args.certificate {
        Some(folder) if wants_all || folder.is_dir() => Some(folder.join(format!("{index:05}.exr"))),
        file => file.clone(),
    };
    let shot = |(index, camera): (usize, Camera)| Shot {
        camera: args.size.map_or_else(|| camera.clone(), |size| camera.resized(size)),
        output: if is_folder { output.join(format!("{index:05}.png")) } else { output.clone() },
        certificate: certificate(index),
    };
    check_certificate(args, wants_all)?;
    let shots: Vec<_> = chosen.into_iter().map(shot).collect();
    if let Some(shot) =
        shots.iter().find(|s| args.reference && s.camera.size_px.into_iter().max() > Some(REFERENCE_SIDE))
    {
        return Err(Usage(format!(
            "--reference draws up to {REFERENCE_SIDE} pixels a side, not {}",
            size_text(shot.camera.size_px)
        ))
        .into());
    }
    let folders = [is_folder.then_some(&output), args.certificate.as_ref().filter(|_| wants_all)];
    for folder in folders.into_iter().flatten() {
        fs::create_dir_all(folder).with_context(|| format!("cannot make the folder {}", folder.display()))?;
    }
    if let Some(shot) = shots.iter().find(|shot| shot.certificate.as_ref() == Some(&shot.output)) {
        return Err(Usage(format!("{} is to be the picture and its certificate", shot.output.display())).into());
    }
    Ok(Plan { shots, nearest })
}

/// Bounds are floats, and most are less than a step of 8 bits.
fn check_certificate(args: &Args, wants_all: bool) -> Result<()> {
    let Some(file) = args.certificate.as_ref().filter(|file| !wants_all && !file.is_dir()) else {
        return Ok(());
    };
    match FileKind::of(file) {
        Ok(FileKind::Exr | FileKind::Npy) => Ok(check_writable(file)?),
        _ => Err(Usage(format!("--certificate {}: bounds are written as .exr or .npy", file.display())).into()),
    }
}

fn cameras(args: &Args) -> Result<Option<Vec<NamedCamera>>> {
    if let Some(frames) = args.film.read()? {
        return Ok(Some(frames));
    }
    match named_or_found(args.cameras.as_deref(), &args.scene) {
        Some(file) => Ok(Some(args.split.read(&file)?)),
        None => Ok(args.split.check_no_file().map(|()| None)?),
    }
}

fn pick(cameras: &[NamedCamera], wanted: &str) -> Result<(usize, Camera)> {
    // A number as one writes it is a position; 0007 is a name.
    let by_position = (0..cameras.len()).find(|index| index.to_string() == wanted);
    let by_name = || cameras.iter().position(|c| c.name == wanted);
    let index = by_position.or_else(by_name).ok_or_else(|| {
        let last = cameras.len() - 1;
        Usage(format!(
            "there is no camera {wanted}: they are 0 to {last}, from '{}' to '{}'",
            cameras[0].name, cameras[last].name
        ))
    })?;
    Ok((index, cameras[index].camera.clone()))
}

/// A view of the whole scene, and the distance to its middle.
fn automatic(gaussians: &Gaussians, size: Option<[u32; 2]>) -> (Camera, f64) {
    let focus = Focus::of(gaussians);
    let centre = DVec3::from(focus.centre);
    let camera = Camera::framing(centre, focus.radius, size.unwrap_or([1280, 720]));
    let distance = camera.position.distance(centre);
    (camera, distance)
}

fn write(args: &Args, shot: &Shot, pixels: &Pixels) -> Result<()> {
    pixels.write(&shot.output, args.background == Background::Transparent)
}

fn report(args: &Args, shot: &Shot, frame: &Frame) -> Result<()> {
    let totals = &frame.totals;
    let gpu_ms = frame
        .timings
        .iter()
        .find(|t| t.depth == 0)
        .map_or_else(String::new, |t| format!(", {:.2} ms on the GPU", t.duration_ms));
    let (visible, instances) = (totals.visible, totals.instances_kept);
    if visible == 0 {
        remark(&format!("note: {}: no Gaussian is in view", shot.output.display()));
    }
    say!(
        "{}  {}  {visible} visible, {instances} instances{gpu_ms}",
        shot.output.display(),
        size_text(shot.camera.size_px)
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
