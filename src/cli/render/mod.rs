//! `smalto render`: pictures of a scene, to files.

mod draw;
mod outputs;
mod plan;
mod resume;
mod video;

use std::path::PathBuf;

use anyhow::{Context, Result};

use super::{BudgetArgs, DeviceArgs, FilmArgs, Knobs, SceneArg, SplitArg, Usage, knobs, parse_size, say};
use crate::options::Options;
use crate::rules::Background;
use crate::pixels::FileKind;
use outputs::{Layer, Names};
use plan::{Plan, Shot, plan};

/// Render a scene to PNG, EXR or .npy
#[derive(clap::Args)]
pub(super) struct Args {
    #[command(flatten)]
    scene: SceneArg,
    /// Picture file, or folder for several [default: the scene's name with .png, or `renders`]. A .png has 8 bits a
    /// channel; .exr and .npy hold the 32-bit floats, alpha multiplied in. In a folder pictures are 00000.png and so on
    #[arg(short, long, value_name = "FILE|DIR")]
    output: Option<PathBuf>,
    /// What files are written [default: what the file's name says; png in a folder]
    #[arg(long, value_name = "KIND")]
    format: Option<FileKind>,
    /// What is written of a picture, as a list. One layer goes to --output itself. Of several, in a folder each has a
    /// folder of its name (renders/colour/00000.png, renders/depth/00000.exr); beside a file, all but the colour have
    /// their name in theirs (a.png, a.depth.exr). Depths are the view z of the splats' means, in world units; depths
    /// and counts are floats in one channel, .exr where pictures are PNG. All are of what the preset blends: `exact` stops
    /// latest
    #[arg(long, value_name = "LAYERS", value_delimiter = ',', default_value = "colour")]
    layers: Vec<Layer>,
    /// How pictures in a folder are named [default: index]. Folders in names of images are made below --output
    #[arg(long, value_name = "BY")]
    names: Option<Names>,
    /// Picture size in pixels [default: the camera's own, or 1280x720]
    #[arg(long, value_name = "WxH", value_parser = parse_size)]
    size: Option<[u32; 2]>,
    /// Camera file: cameras.json of the original 3DGS, transforms.json of nerfstudio, instant-ngp or Blender's sets, or a
    /// sparse model of COLMAP (its folder, the one above it, or images.bin or .txt) [default: found beside the scene or above it]
    #[arg(long, value_name = "FILE|DIR")]
    cameras: Option<PathBuf>,
    #[command(flatten)]
    split: SplitArg,
    /// Which camera of the file: its position in it, its image name, a list like 0,5,9, a range like 0..10 (both ends
    /// included), or `all` [default: 0]
    #[arg(long, value_name = "N|NAME|LIST|all")]
    camera: Option<String>,
    #[command(flatten)]
    film: FilmArgs,
    /// Write the chosen cameras as frames, numbered from 0 without gaps, and print the ffmpeg command that makes a film
    /// of them
    #[arg(long, conflicts_with = "names")]
    video: bool,
    /// Go on with an interrupted run of the same command into a folder: what it completed is skipped
    #[arg(long, conflicts_with_all = ["certificate", "dump"])]
    resume: bool,
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
    let plan = plan(args, &scene.gaussians)?;
    let preset = args.preset.as_deref().and_then(Options::preset).unwrap_or_default();
    let preset = Options { portable: args.portable || preset.portable, ..preset };
    let options = args.knobs.options(&preset, scene.is_antialiased, plan.nearest);
    let exact = args.knobs.options(&preset.untraded(), scene.is_antialiased, plan.nearest);
    if let Some(why) = options.uncertifiable().filter(|_| args.certificate.is_some()) {
        return Err(Usage(format!("--certificate: {why}")).into());
    }
    match device {
        None => draw::by_reference(args, &plan, &scene.gaussians, &exact)?,
        Some(device) => draw::by_gpu(args, &plan, &device, scene, (exact, options))?,
    }
    plan.video.map_or(Ok(()), |command| say!("{command}"))
}
