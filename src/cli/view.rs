//! `smalto view`: opens scenes in a window, or draws the frames of the viewer without one.

use std::path::PathBuf;

use anyhow::Result;
use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};

use super::cameras::along_path;
use super::devices::DeviceArgs;
use super::environment::Environment;
use super::knobs::Knobs;
use super::scenes::{ReadingArgs, SceneArg};
use super::{Usage, complain, knobs, parse_size, remark, say, size_text};
use crate::files::check_writable;
use crate::gpu::Vsync;
use crate::measure::bench::Statistics;
use crate::options::Options;
use crate::pixels::write_rgba8;
use crate::procedural::Procedural;
use crate::render::Residency;
use crate::viewer;
use crate::viewer::{
    Bindings, CompareMode, CompareWith, Digest, PATH_FPS, PageCounts, RecentState, Setup, Summary, WindowSetup,
};

/// Open scenes in a window: fly through them, see the GPU time of every stage, look inside the pipeline
#[derive(clap::Args)]
pub(super) struct Args {
    /// Scene files that `smalto render` reads, model folders of the original 3DGS, projects (NAME.project.json) that
    /// the window saved, or procedural scenes: cactus, room, plain, town, few-large or many-small, with :COUNT for
    /// another number of Gaussians. More files can be dropped on the window
    scenes: Vec<PathBuf>,
    /// Camera file or folder that `smalto render` reads [default: searched next to the first scene and above it]
    #[arg(long, value_name = "FILE|DIR")]
    cameras: Option<PathBuf>,
    /// Folder with the photographs of the cameras, whose names are those of the cameras [default: a folder `images`
    /// beside the camera file or above it]
    #[arg(long, value_name = "DIR")]
    photographs: Option<PathBuf>,
    /// Size of the window in pixels [default: 1280x720 points, which are more pixels where the screen is scaled]
    #[arg(long, value_name = "WxH", value_parser = parse_size)]
    size: Option<[u32; 2]>,
    /// Start in full screen
    #[arg(long)]
    fullscreen: bool,
    /// When a picture is shown: at a refresh of the screen, at once, or the newest at every refresh
    #[arg(long, value_name = "WHEN", default_value = "on", value_parser = vsync_values())]
    vsync: Vsync,
    #[command(flatten)]
    device: DeviceArgs,
    /// Accuracy for speed: exact, balanced, fast or preview. The rules of another renderer, exactly: inria, gsplat or
    /// khr. As balanced, by the stages that run on every device: portable [default: balanced]
    #[arg(long, value_name = "NAME", value_parser = knobs::preset_names())]
    preset: Option<String>,
    /// Compare the picture with another: that of a preset, the float64 `reference`, or a picture file
    #[arg(long, value_name = "PRESET|reference|FILE")]
    compare: Option<String>,
    /// How the two pictures of --compare are shown [default: split]
    #[arg(long, value_name = "MODE", value_parser = compare_modes())]
    compare_by: Option<CompareMode>,
    /// View mode: what is shown in place of colours
    #[arg(long, value_name = "MODE", default_value = "colour", value_parser = view_modes())]
    look: usize,
    /// File of key bindings [default: smalto/viewer.toml in the user's folder of settings]
    #[arg(long, value_name = "FILE")]
    keys: Option<PathBuf>,
    /// Read a scene file again when it changes, and keep the view: watch a training that writes its scene now and then
    #[arg(long, conflicts_with_all = ["offscreen", "screen", "path"])]
    follow: bool,
    /// Write events to standard output, one line of JSON each
    #[arg(long)]
    events: bool,
    /// Open no window: draw this many frames of the viewer, from the cameras of the file in turn, and print their times
    #[arg(
        long,
        value_name = "FRAMES",
        value_parser = clap::value_parser!(u32).range(4..),
        conflicts_with_all = ["fullscreen", "vsync"]
    )]
    offscreen: Option<u32>,
    /// With --offscreen: the frames go along this camera path (docs/side-files.md), one every 60th of a second as on a
    /// screen; in the town, street, roof or air
    #[arg(long, value_name = "FILE|street|roof|air", requires = "offscreen")]
    #[arg(conflicts_with_all = ["cameras", "fullscreen", "vsync"])]
    path: Option<PathBuf>,
    /// Keep this many frames a second, by their GPU times: scenes with levels of detail are drawn with fewer nodes, and
    /// others at a lower scale while the view moves. What is written has neither
    #[arg(id = "rate", long = "fps", value_name = "RATE", value_parser = parse_fps)]
    fps: Option<f64>,
    /// With --offscreen: write the last frame, with its panels, as PNG
    #[arg(long, value_name = "FILE")]
    screen: Option<PathBuf>,
    /// Start with the panels hidden
    #[arg(long)]
    no_panels: bool,
    #[command(flatten)]
    knobs: Knobs,
    #[command(flatten)]
    reading: ReadingArgs,
}

fn parse_fps(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(fps) if (1.0..=10_000.0).contains(&fps) => Ok(fps),
        _ => Err("frames a second are a number from 1 to 10000".to_owned()),
    }
}

/// The fading of levels of detail where it is not given, powers of two of an error.
const FADE: f32 = 0.5;

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

pub(super) fn run(args: &Args) -> Result<()> {
    args.knobs.check_gpu()?;
    for scene in &args.scenes {
        let procedural = scene.to_str().and_then(Procedural::parse);
        procedural.transpose().map_err(|problem| Usage(format!("{}: {problem:#}", scene.display())))?;
    }
    let preset = args.preset.as_deref().and_then(Options::preset).unwrap_or_default();
    let compares_with = args.compare.as_ref().map(|with| match Options::preset(with) {
        Some(options) => CompareWith::Options(options),
        None if with == "reference" => CompareWith::Reference,
        None => CompareWith::File(with.into()),
    });
    let mut options = args.knobs.options(&preset, false, f32::INFINITY);
    if !args.knobs.has("lod-fade") {
        options.lod_fade = FADE;
    }
    let setup = Setup {
        scenes: args.scenes.clone(),
        reading: args.reading.reading()?,
        cameras: args.cameras.clone(),
        photographs: args.photographs.clone(),
        options,
        antialiased_is_explicit: args.knobs.has("antialiased"),
        near_is_explicit: args.knobs.has("near"),
        bindings: bindings(args)?,
        recent_file: args.offscreen.is_none().then(RecentState::default_file).flatten(),
        vsync: args.vsync,
        hides_panels: args.no_panels,
        compares_with,
        compare_mode: args.compare_by.unwrap_or(CompareMode::Split),
        view_mode: args.look,
        fps: args.fps,
        watches_files: args.follow,
        prints_events: args.events,
        remark,
    };
    if let Some(frames) = args.offscreen {
        return offscreen(args, setup, frames);
    }
    let (device, validation) = args.device.choice()?;
    let environment = Environment::read()?;
    let fault =
        environment.fault.map(|text| text.parse().map_err(|problem| Usage(format!("SMALTO_FAULT: {problem:#}"))));
    let fault = fault.transpose()?;
    viewer::run(WindowSetup {
        viewer: setup,
        size: args.size,
        is_full_screen: args.fullscreen,
        device,
        validation,
        memory: args.device.memory_limit(),
        shaders: environment.shaders,
        with_pipeline_cache: super::pipeline_cache::with_pipeline_cache,
        fault,
    })
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
            along_path(path, Some(&PATH_FPS.into()), || scene.town(), size)?.0
        }
        (Some(_), None) => return Err(Usage("--path needs a scene".to_owned()).into()),
        (None, _) => Vec::new(),
    };
    let device = args.device.open()?;
    let Summary { interval_ms, late, path, gpu, pages, first_frame_ms, latency_ms, screen } =
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
    complain(&device)
}
