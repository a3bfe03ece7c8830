//! `smalto view`: opens scenes in a window, or draws the frames of the viewer without one.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::{Context, Result, bail};
use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};
use glam::DVec3;

use super::cameras::{EyeArgs, LensArgs, along_path, parse_angle, parse_point};
use super::devices::{DevicesArgs, first_and_others};
use super::environment::Environment;
use super::headings::{ACCURACY, CAMERAS, MEASURING};
use super::knobs::Knobs;
use super::render::parse_background;
use super::scenes::{ReadingArgs, SceneArg};
use super::{Usage, complain, knobs, remark, say, size_text, values};
use crate::cli::drawable::read_places;
use crate::files::check_writable;
use crate::gpu::Vsync;
use crate::measure::bench::Statistics;
use crate::options::Options;
use crate::pixels::write_rgba8;
use crate::procedural::Procedural;
use crate::render::Residency;
use crate::rules::Background;
use crate::scene::Focus;
use crate::viewer;
use crate::viewer::{
    Bindings, CompareMode, CompareWith, Digest, Fault, PATH_FPS, PageCounts, RecentState, Setup, Start, Summary,
    WindowSetup,
};

/// Open scenes in a window: fly through them, see the GPU time of every stage, look inside the pipeline
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  smalto view garden.ply
  smalto view plush.spz cactus:100K --cameras cameras.json
  smalto view plush.spz --compare fast --compare-by difference
  smalto view model.ply --follow
  smalto view garden.smalto --splats 3M --target-fps 60")]
pub(super) struct Args {
    /// Scene files, folders, projects or procedural scenes, as for `smalto render`
    ///
    /// Projects (NAME.project.json) are saved by the window. More files can be dropped on it.
    scenes: Vec<PathBuf>,
    /// Camera file [default: found next to the first scene or above it]
    #[arg(long, help_heading = CAMERAS, value_name = "FILE|DIR")]
    cameras: Option<PathBuf>,
    #[command(flatten)]
    lens: LensArgs,
    /// Draw the first scene at every place of a list (docs/side-files.md)
    ///
    /// Only the fast path draws them. Lists can be dropped on the window, too.
    #[arg(long, help_heading = CAMERAS, value_name = "FILE")]
    place: Option<PathBuf>,
    /// Begin at this camera: 7, -1 or an image name [default: first]
    ///
    /// A position is a number from 0 on, or from -1 for the last backwards. An image name is written with or without
    /// its ending.
    #[arg(long, help_heading = CAMERAS, value_name = "CAMERA", allow_hyphen_values = true)]
    #[arg(conflicts_with_all = ["eye", "path"])]
    camera: Option<String>,
    /// Begin at this point, in world units
    ///
    /// With --up, the point is one of the turned scene.
    #[arg(long, help_heading = CAMERAS, value_name = "X,Y,Z", allow_hyphen_values = true, value_parser = parse_point)]
    #[arg(conflicts_with = "path")]
    eye: Option<DVec3>,
    /// The point that --eye looks at [default: the middle of the scene]
    #[arg(long, help_heading = CAMERAS, value_name = "X,Y,Z", allow_hyphen_values = true, value_parser = parse_point)]
    #[arg(requires = "eye", conflicts_with_all = ["camera", "path"])]
    target: Option<DVec3>,
    /// The direction that --eye sees upwards, like 0,0,1 [default: 0,-1,0]
    #[arg(long, help_heading = CAMERAS, value_name = "X,Y,Z", allow_hyphen_values = true, value_parser = parse_point)]
    #[arg(requires = "eye", conflicts_with_all = ["camera", "path"])]
    camera_up: Option<DVec3>,
    /// Horizontal field of view of --eye, in degrees [default: 50]
    ///
    /// Up to 179, or what --lens sees.
    #[arg(long, help_heading = CAMERAS, value_name = "DEGREES", value_parser = parse_angle)]
    #[arg(requires = "eye", conflicts_with_all = ["camera", "path"])]
    fov: Option<f64>,
    /// Folder with the photographs of the cameras, by their names
    ///
    /// By default, a folder `images` beside the camera file or above it.
    #[arg(long, help_heading = CAMERAS, value_name = "DIR")]
    photographs: Option<PathBuf>,
    /// Size of the window in pixels
    ///
    /// By default that of the last window; at first 1280x720 points, which are more pixels where the screen is scaled.
    #[arg(long, help_heading = WINDOW, value_name = "WxH", value_parser = values::size)]
    size: Option<[u32; 2]>,
    /// R,G,B (0 to 1), #rrggbb, black, grey or white
    #[arg(long, help_heading = WINDOW, value_name = "COLOUR", default_value = "0,0,0", value_parser = opaque)]
    background: Background,
    /// Start in full screen
    #[arg(long, help_heading = WINDOW)]
    fullscreen: bool,
    /// When a picture is shown: on, off or mailbox
    ///
    /// on: one picture at every refresh of the screen, never torn (FIFO). off: every picture at once; it may be torn
    /// (IMMEDIATE). mailbox: the newest picture at every refresh, never torn (MAILBOX).
    #[arg(long, help_heading = WINDOW, value_name = "WHEN", default_value = "on", value_parser = vsync_values())]
    #[arg(hide_possible_values = true)]
    vsync: Vsync,
    /// Keep this many frames a second, by their GPU times
    ///
    /// Scenes with levels of detail are drawn with fewer nodes, and others at a lower scale while the view moves.
    /// Written pictures have neither.
    #[arg(long, help_heading = WINDOW, value_name = "RATE", value_parser = values::number(1.0..=10_000.0))]
    target_fps: Option<f64>,
    /// View mode, in place of colours; --help lists them
    #[arg(long, help_heading = WINDOW, value_name = "MODE", default_value = "colour", value_parser = view_modes())]
    #[arg(hide_possible_values = true)]
    #[arg(long_help = looks())]
    look: usize,
    /// Compare with a preset, the float64 `reference`, or a picture file
    #[arg(long, help_heading = WINDOW, value_name = "WITH")]
    compare: Option<String>,
    /// split, flicker or difference: how --compare is shown [default: split]
    #[arg(long, help_heading = WINDOW, value_name = "MODE", value_parser = compare_modes())]
    #[arg(hide_possible_values = true)]
    compare_by: Option<CompareMode>,
    /// Start with the panels hidden
    #[arg(long, help_heading = WINDOW)]
    no_panels: bool,
    /// File of key bindings
    ///
    /// By default smalto/viewer.toml in the user's folder of settings.
    #[arg(long, help_heading = WINDOW, value_name = "FILE")]
    keys: Option<PathBuf>,
    /// Read a scene file again when it changes, and keep the view
    ///
    /// For a training that writes its scene now and then.
    #[arg(long, help_heading = WINDOW, conflicts_with_all = ["offscreen", "screen", "path"])]
    follow: bool,
    /// exact, balanced (default), fast, preview, inria, gsplat, khr, portable
    ///
    /// The first four are accuracy for speed. inria, gsplat and khr draw exactly by the rules of another renderer.
    /// portable is balanced by the stages that run on every device.
    #[arg(long, help_heading = ACCURACY, value_name = "NAME", value_parser = knobs::preset_names())]
    #[arg(hide_possible_values = true)]
    preset: Option<String>,
    #[command(flatten)]
    knobs: Knobs,
    #[command(flatten)]
    reading: ReadingArgs,
    #[command(flatten)]
    device: DevicesArgs,
    /// Write events to standard output, one line of JSON each
    #[arg(long, help_heading = MEASURING)]
    events: bool,
    /// Local socket on which a program controls the window
    ///
    /// Messages are lines of JSON, described in docs/control.md.
    #[cfg(unix)]
    #[arg(long, help_heading = MEASURING, value_name = "PATH", conflicts_with_all = ["offscreen", "screen", "path"])]
    control: Option<PathBuf>,
    /// Open no window: draw this many frames, and print their times
    ///
    /// The views are the cameras of the file in turn, or that of --camera or --eye.
    #[arg(long, help_heading = MEASURING, value_name = "FRAMES", value_parser = values::whole::<u32>(4..=1_000_000))]
    #[arg(conflicts_with_all = ["fullscreen", "vsync"])]
    offscreen: Option<u32>,
    /// With --offscreen: frames along a camera path
    ///
    /// The path is one that `smalto render` takes. There is a frame every 60th of a second, as on a screen.
    #[arg(long, help_heading = MEASURING, value_name = "PATH", requires = "offscreen")]
    #[arg(conflicts_with_all = ["cameras", "fullscreen", "vsync"])]
    path: Option<PathBuf>,
    /// With --offscreen: write the last frame, with its panels, as PNG
    #[arg(long, help_heading = MEASURING, value_name = "FILE")]
    screen: Option<PathBuf>,
}

const WINDOW: &str = "Window";

/// The fading of levels of detail where it is not given, powers of two of an error.
const FADE: f32 = 0.5;
/// The powers of two by which hidden nodes are coarser.
const OCCLUSION: f32 = 2.0;

fn compare_modes() -> impl TypedValueParser<Value = CompareMode> {
    let values = [
        ("split", "Side by side, at a line that can be dragged"),
        ("flicker", "One after the other"),
        ("difference", "Their difference, amplified"),
    ];
    PossibleValuesParser::new(values.map(|(name, help)| PossibleValue::new(name).help(help))).map(|name| match &*name {
        "flicker" => CompareMode::Flicker,
        "difference" => CompareMode::Difference,
        _ => CompareMode::Split,
    })
}

/// The help text of --look.
fn looks() -> String {
    let names: Vec<_> = viewer::view_mode_names().collect();
    format!("View mode: what is shown in place of colours: {}", names.join(", "))
}

fn view_modes() -> impl TypedValueParser<Value = usize> {
    let parse = |name: String| viewer::view_mode(&name).ok_or("there is no such view mode");
    PossibleValuesParser::new(viewer::view_mode_names()).try_map(parse)
}

fn vsync_values() -> impl TypedValueParser<Value = Vsync> {
    let values = [
        ("on", "One picture at every refresh of the screen, never torn: FIFO"),
        ("off", "Every picture at once; it may be torn: IMMEDIATE"),
        ("mailbox", "The newest picture at every refresh, never torn: MAILBOX"),
    ];
    PossibleValuesParser::new(values.map(|(name, help)| PossibleValue::new(name).help(help))).map(|name| match &*name {
        "off" => Vsync::Off,
        "mailbox" => Vsync::Mailbox,
        _ => Vsync::On,
    })
}

/// The fault that the environment simulates.
pub(super) fn fault(environment: &Environment) -> Result<Option<Fault>, Usage> {
    let fault = environment.fault.as_ref().map(|text| text.parse());
    fault.transpose().map_err(|problem: anyhow::Error| Usage(format!("SMALTO_FAULT: {problem:#}")))
}

pub(super) fn run(args: &Args) -> Result<()> {
    args.knobs.check_gpu()?;
    for scene in &args.scenes {
        procedural(scene)?;
    }
    let compares_with = args.compare.as_ref().map(|with| match Options::preset(with) {
        Some(options) => CompareWith::Options(options),
        None if with == "reference" => CompareWith::Reference,
        None => CompareWith::File(with.into()),
    });
    let setup = Setup {
        scenes: args.scenes.clone(),
        reading: args.reading.reading()?,
        reading_options: args.reading.options(),
        cameras: args.cameras.clone(),
        places: args.place.clone().zip(read_places(args.place.as_deref())?),
        start: start(args)?,
        background: args.background,
        lenses: args.lens.choice(),
        photographs: args.photographs.clone(),
        searches_photographs: true,
        options: options(args.preset.as_deref(), &args.knobs),
        antialiased_is_explicit: args.knobs.has("antialiased"),
        near_is_explicit: args.knobs.has("near"),
        bindings: bindings(args)?,
        recent_file: args.offscreen.is_none().then(RecentState::default_file).flatten(),
        vsync: args.vsync,
        hides_panels: args.no_panels,
        compares_with,
        compare_mode: args.compare_by.unwrap_or(CompareMode::Split),
        view_mode: args.look,
        fps: args.target_fps,
        watches_files: args.follow,
        prints_events: args.events,
        other_devices: Vec::new(),
        remark,
    };
    if let Some(frames) = args.offscreen {
        return offscreen(args, setup, frames);
    }
    let (device, validation, other_devices) = args.device.first_and_others()?;
    let setup = Setup { other_devices, ..setup };
    let environment = Environment::read()?;
    let fault = fault(&environment)?;
    viewer::run(WindowSetup {
        viewer: setup,
        size: args.size,
        is_full_screen: args.fullscreen,
        device,
        validation,
        memory: args.device.memory_limit(),
        shaders: environment.shaders,
        with_pipeline_cache: super::pipeline_cache::with_pipeline_cache,
        #[cfg(unix)]
        control: args.control.clone(),
        #[cfg(not(unix))]
        control: None,
        fault,
    })
}

/// The options of a viewer, in which levels of detail fade and what is hidden is coarser.
pub(super) fn options(preset: Option<&str>, knobs: &Knobs) -> Options {
    let preset = preset.and_then(Options::preset).unwrap_or_default();
    let mut options = knobs.options(&preset, false, f32::INFINITY);
    if !knobs.has("lod-fade") {
        options.lod_fade = FADE;
    }
    if !knobs.has("lod-occlusion") {
        options.lod_occlusion = OCCLUSION;
    }
    options
}

/// The procedural scene of this name; `None` for a file.
pub(super) fn procedural(scene: &Path) -> Result<Option<Procedural>, Usage> {
    let parsed = scene.to_str().and_then(Procedural::parse).transpose();
    parsed.map_err(|problem| Usage(format!("{}: {problem:#}", scene.display())))
}

/// A background that a window can have.
pub(super) fn opaque(text: &str) -> Result<Background> {
    match parse_background(text)? {
        Background::Transparent => bail!("a window has a colour behind its scenes"),
        colour => Ok(colour),
    }
}

/// The first view, where an option gives it.
fn start(args: &Args) -> Result<Option<Start>, Usage> {
    if let Some(camera) = &args.camera {
        return Ok(Some(Start::Camera(camera.clone())));
    }
    let Args { eye, target, camera_up, fov, .. } = *args;
    let (eye, lens) = (EyeArgs::of(eye, target, camera_up, fov), args.lens.clone());
    Ok(eye.is_given()?.then(|| {
        let camera = move |focus: Focus, size: [u32; 2]| {
            let found = eye.camera(|| focus, size, &lens)?;
            found.context("--eye was given")
        };
        Start::Eye(Arc::new(camera))
    }))
}

fn bindings(args: &Args) -> Result<Bindings, Usage> {
    let default = Bindings::default_file().filter(|file| file.is_file());
    let Some(file) = args.keys.clone().or(default) else { return Ok(Bindings::default()) };
    Bindings::read(&file).map_err(|problem| Usage(format!("{}: {problem:#}", file.display())))
}

fn offscreen(args: &Args, setup: Setup, frames: u32) -> Result<()> {
    let size = args.size.unwrap_or(viewer::DEFAULT_SIZE);
    if let Some(file) = &args.screen {
        check_writable(file)?;
    }
    let path = match (&args.path, args.scenes.first()) {
        (Some(path), Some(scene)) => {
            let scene = SceneArg { scene: scene.clone(), reading: args.reading };
            let mut cameras = along_path(path, Some(&PATH_FPS.into()), || scene.town(), size)?.0;
            cameras.iter_mut().for_each(|named| args.lens.apply(&mut named.camera));
            cameras
        }
        (Some(_), None) => return Err(Usage("--path needs a scene".to_owned()).into()),
        (None, _) => Vec::new(),
    };
    let (device, other_devices) = first_and_others(args.device.open(usize::MAX)?);
    let setup = Setup { other_devices: other_devices.clone(), ..setup };
    let Summary { interval_ms, late, path, gpu, pages, first_frame_ms, layout_ms, latency_ms, screen } =
        viewer::run_offscreen(setup, &device, size, frames, path)?;
    if let Some(file) = &args.screen {
        write_rgba8(file, size, &screen)?;
    }
    say!("{}  {frames} frames, first after {first_frame_ms:.0} ms", size_text(size))?;
    let Statistics { mean, median, p95, .. } = interval_ms;
    say!("  from frame to frame   mean {mean:.3} ms, median {median:.3} ms, p95 {p95:.3} ms")?;
    if let Some(late) = late {
        say!("  late                  {late} frames were not ready after 1/{PATH_FPS:.0} s")?;
    }
    if let Some(Statistics { mean, p95, .. }) = layout_ms {
        say!("  layout of the panels  mean {mean:.3} ms, p95 {p95:.3} ms of the processor")?;
    }
    say!("  input to submission   mean {latency_ms:.3} ms")?;
    if let Some(path) = path {
        say!("  path                  {path}")?;
    }
    if let Some(PageCounts { missing: [mean, most], whole, residency }) = pages {
        let Residency { resident, capacity, .. } = residency;
        say!("  pages of levels       {resident} in memory at the end, {capacity} fit")?;
        say!(
            "  pages drawn coarser   mean {mean:.0}, at most {most:.0}; {:.1} % of the frames lacked none",
            1e2 * whole
        )?;
    }
    match gpu {
        Some(Digest { stages, whole }) => {
            say!("  GPU time of a frame   median {:.3} ms, p95 {:.3} ms", whole.median, whole.p95)?;
            for (stage, times) in stages {
                say!("    {stage:<14} {:8.3} ms", times.median)?;
            }
        }
        None => remark("note: nothing was drawn"),
    }
    other_devices.iter().chain([&device]).try_for_each(complain)
}
