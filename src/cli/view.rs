//! `smalto view`: a window on scenes.

use std::path::PathBuf;

use anyhow::Result;
use clap::builder::PossibleValuesParser;

use super::{DeviceArgs, Knobs, ReadingArgs, Usage, complain, knobs, parse_size, remark, say, size_text};
use crate::measure::bench::Statistics;
use crate::cli::environment::Environment;
use crate::files::check_writable;
use crate::gpu::Vsync;
use crate::options::Options;
use crate::pixels::write_rgba8;
use crate::scene::Procedural;
use crate::viewer::{self, Bindings, CompareWith, Digest, Opening, Setup, Summary, Way};

/// Open a window on scenes: fly through them, see what every stage costs, look inside the pipeline
#[derive(clap::Args)]
pub(super) struct Args {
    /// Scene files as of `smalto render`, model folders of the original 3DGS, or procedural scenes: cactus,
    /// few-large or many-small, with :COUNT for another number of Gaussians. More can be dropped on the window
    scenes: Vec<PathBuf>,
    /// Camera file or folder, as `smalto render` takes it [default: found beside the first scene or above it]
    #[arg(long, value_name = "FILE|DIR")]
    cameras: Option<PathBuf>,
    /// Size of the window in pixels
    #[arg(long, value_name = "WxH", value_parser = parse_size, default_value = "1280x720")]
    size: [u32; 2],
    /// Begin in full screen
    #[arg(long)]
    fullscreen: bool,
    /// When a picture is shown: at a refresh of the screen, at once, or the newest at every refresh
    #[arg(long, value_name = "WHEN", default_value = "on")]
    vsync: Vsync,
    #[command(flatten)]
    device: DeviceArgs,
    /// Accuracy against speed: exact, balanced, fast or preview; or as inria, gsplat or khr draw [default: balanced]
    #[arg(long, value_name = "NAME", value_parser = knobs::preset_names())]
    preset: Option<String>,
    /// Hold the picture against another: of a preset, of the float64 `reference`, or a picture file
    #[arg(long, value_name = "PRESET|reference|FILE")]
    compare: Option<String>,
    /// How the two are shown
    #[arg(long, value_name = "WAY", default_value = "split")]
    compare_by: Way,
    /// What is shown in place of colours
    #[arg(long, value_name = "LOOK", default_value = "colour", value_parser = PossibleValuesParser::new(viewer::sight_names()))]
    look: String,
    /// File that says which key does what [default: smalto/viewer.toml in the user's folder of settings]
    #[arg(long, value_name = "FILE")]
    keys: Option<PathBuf>,
    /// Tell what happens on standard output, a line of JSON each
    #[arg(long)]
    events: bool,
    /// No window: draw this many frames of the viewer, from the file's cameras in turn, and say how long they took
    #[arg(long, value_name = "FRAMES", value_parser = clap::value_parser!(u32).range(4..), conflicts_with_all = ["fullscreen", "vsync"])]
    offscreen: Option<u32>,
    /// With --offscreen: write the last frame, panels included, as PNG
    #[arg(long, value_name = "FILE", requires = "offscreen")]
    screen: Option<PathBuf>,
    /// Begin with the panels hidden
    #[arg(long)]
    no_panels: bool,
    #[command(flatten)]
    knobs: Knobs,
    #[command(flatten)]
    reading: ReadingArgs,
}

pub(super) fn run(args: &Args) -> Result<()> {
    args.knobs.check()?;
    args.knobs.check_gpu()?;
    for scene in &args.scenes {
        let procedural = scene.to_str().and_then(Procedural::parse);
        procedural.transpose().map_err(|problem| Usage(format!("{}: {problem:#}", scene.display())))?;
    }
    let preset = args.preset.as_deref().and_then(Options::preset).unwrap_or_default();
    let by = |preset: &Options| args.knobs.options(preset, false, f32::INFINITY);
    let compares_with = args.compare.as_ref().map(|with| match Options::preset(with) {
        Some(options) => CompareWith::Options(options),
        None if with == "reference" => CompareWith::Reference,
        None => CompareWith::File(with.into()),
    });
    let setup = Setup {
        scenes: args.scenes.clone(),
        reading: args.reading.reading()?,
        cameras: args.cameras.clone(),
        options: by(&preset),
        antialiased_by_hand: args.knobs.antialiased.is_some(),
        near_by_hand: args.knobs.near.is_some(),
        bindings: bindings(args)?,
        vsync: args.vsync,
        hides_panels: args.no_panels,
        compares_with,
        way: args.compare_by,
        sight: viewer::sight_names().position(|name| name == args.look).expect("it is one of them"),
        tells_events: args.events,
    };
    if let Some(frames) = args.offscreen {
        return offscreen(args, setup, frames);
    }
    let (device, validation) = args.device.choice();
    let fault = Environment::read()
        .fault
        .map(|text| text.parse().map_err(|problem| Usage(format!("SMALTO_FAULT: {problem:#}"))));
    let fault = fault.transpose()?;
    viewer::run(Opening { setup, size: args.size, is_full_screen: args.fullscreen, device, validation, fault })
}

fn bindings(args: &Args) -> Result<Bindings, Usage> {
    let default = Bindings::default_file().filter(|file| file.is_file());
    let Some(file) = args.keys.clone().or(default) else { return Ok(Bindings::default()) };
    Bindings::read(&file).map_err(|problem| Usage(format!("{}: {problem:#}", file.display())))
}

fn offscreen(args: &Args, setup: Setup, frames: u32) -> Result<()> {
    if let Some(file) = &args.screen {
        check_writable(file)?;
    }
    let device = args.device.open()?;
    let size = args.size;
    let Summary { interval_ms, gpu, first_frame_ms, latency_ms, screen } =
        viewer::run_offscreen(setup, &device, size, frames)?;
    if let Some(file) = &args.screen {
        write_rgba8(file, size, &screen)?;
    }
    say!("{}  {frames} frames, first after {first_frame_ms:.0} ms", size_text(size))?;
    let Statistics { mean, median, p95, .. } = interval_ms;
    say!("  from frame to frame   mean {mean:.3} ms, median {median:.3} ms, p95 {p95:.3} ms")?;
    say!("  input to submission   mean {latency_ms:.3} ms")?;
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
