//! `smalto render`: draws pictures of a scene to files.

mod draw;
mod outputs;
mod plan;
mod resume;
mod video;

use std::path::PathBuf;

use anyhow::{Context, Result};

use super::{BudgetArgs, DeviceArgs, FilmArgs, Knobs, SceneArg, SplitArg, Usage, knobs, one_of, parse_size, say};
use crate::options::Options;
use crate::pixels::FileKind;
use crate::rules::Background;
use outputs::{Layer, Names, Shot};
use plan::{Plan, plan};

/// Render a scene to PNG, EXR or .npy
#[derive(clap::Args)]
pub(super) struct Args {
    #[command(flatten)]
    scene: SceneArg,
    /// Picture file, or folder for several pictures (00000.png and so on) [default: the scene's name with .png, or
    /// `renders`]. A .png has 8 bits per channel; .exr and .npy hold 32-bit floats, premultiplied by alpha
    #[arg(short, long, value_name = "FILE|DIR")]
    output: Option<PathBuf>,
    /// Kind of the files [default: by the name of the file; png in a folder]
    #[arg(long, value_name = "KIND", value_parser = one_of(FILE_KINDS))]
    format: Option<FileKind>,
    /// Layers to write, separated by commas. A single layer goes to --output itself. Several layers get a folder each
    /// (renders/colour/00000.png, renders/depth/00000.exr) or, if --output is a file, their name in the file name
    /// (a.png, a.depth.exr). Depths are the view z of the means of splats, in world units. Depths and counts have one
    /// float channel, and are .exr if pictures are PNG. They include only the splats that the preset blends
    #[arg(long, value_name = "LAYERS", value_delimiter = ',', default_value = "colour")]
    layers: Vec<Layer>,
    /// Names of pictures in a folder [default: index]. Folders in image names are created below --output
    #[arg(long, value_name = "BY")]
    names: Option<Names>,
    /// Picture size in pixels [default: the camera's, or 1280x720]
    #[arg(long, value_name = "WxH", value_parser = parse_size)]
    size: Option<[u32; 2]>,
    /// Camera file: cameras.json of the original 3DGS, transforms.json of nerfstudio, instant-ngp or Blender's data
    /// sets, or a sparse model of COLMAP (its folder, the folder above it, images.bin or images.txt) [default: found
    /// next to the scene or in a folder above it]
    #[arg(long, value_name = "FILE|DIR")]
    cameras: Option<PathBuf>,
    #[command(flatten)]
    split: SplitArg,
    /// Cameras of the file: a position, an image name, a list like 0,5,9, a range like 0..10 (both ends included), or
    /// `all` [default: 0]
    #[arg(long, value_name = "N|NAME|LIST|all")]
    camera: Option<String>,
    #[command(flatten)]
    film: FilmArgs,
    /// Number the pictures from 0 without gaps, and print the ffmpeg command that makes a video of them
    #[arg(long, conflicts_with = "names")]
    video: bool,
    /// Continue an interrupted run of the same command into a folder: complete files are skipped
    #[arg(long, conflicts_with_all = ["certificate", "dump"])]
    resume: bool,
    /// Background: three numbers from 0 to 1, or `transparent`
    #[arg(long, value_name = "R,G,B|transparent", default_value = "0,0,0", value_parser = parse_background)]
    background: Background,
    #[command(flatten)]
    device: DeviceArgs,
    /// Accuracy for speed: exact, balanced, fast or preview. The rules of another renderer, exactly: inria, gsplat or
    /// khr. As balanced, on the portable path: portable [default: balanced]
    #[arg(long, value_name = "NAME", value_parser = knobs::preset_names())]
    #[arg(conflicts_with_all = ["max_error", "min_psnr"])]
    preset: Option<String>,
    /// Use only what works on every device: the portable path
    #[arg(long)]
    portable: bool,
    /// Render on the CPU in float64: the reference with which the GPU is compared. Slow
    #[arg(long, conflicts_with_all = ["device", "portable", "timings", "dump"])]
    reference: bool,
    /// Print the GPU time of every stage of the frame
    #[arg(long)]
    timings: bool,
    /// Also write the certificate: for every pixel, an upper bound on the difference of its channels to the picture
    /// without thresholds, cuts and stops, of the scene as stored on the GPU and in the same order. An .exr or .npy
    /// file, or a folder for several pictures
    #[arg(long, value_name = "FILE|DIR", conflicts_with = "reference")]
    certificate: Option<PathBuf>,
    /// Write the buffers that each stage changed to this folder, as .npy
    #[arg(long, value_name = "DIR")]
    dump: Option<PathBuf>,
    #[command(flatten)]
    knobs: Knobs,
    #[command(flatten)]
    budget: BudgetArgs,
}

const FILE_KINDS: [(&str, &str, FileKind); 4] = [
    ("png", "8 bits per channel", FileKind::Png),
    ("png16", "16 bits per channel", FileKind::Png16),
    ("exr", "32-bit floats, premultiplied by alpha", FileKind::Exr),
    ("npy", "The same as a NumPy array of rows of pixels", FileKind::Npy),
];

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
    if args.budget.budget()?.is_some() && (args.knobs.trades() || args.reference) {
        return Err(
            Usage("--max-error and --min-psnr cannot be combined with knob flags or --reference".to_owned()).into()
        );
    }
    if !args.reference {
        args.knobs.check_gpu()?;
    }
    // The device is opened first: it fails at once, and reading a scene may take long.
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
