//! `smalto render`: draws pictures of a scene to files.
//!
//! - `plan` - the cameras and files of a run, checked before anything is drawn
//! - `camera_list` - the value of `--camera`
//! - `outputs` - the files of a picture: layers, kinds, names
//! - `start` - the start of a run: the scene is read while the device is opened
//! - `draw` - draws and writes the pictures of a plan, on the GPU or with the reference
//! - `notes` - notes on pictures: empty, cut by the near plane, drawn in depth slabs
//! - `queue` - the views that are left to draw
//! - `device` - the work of one device: takes views and hands on their pixels
//! - `encode` - encodes pictures on all cores
//! - `buffer_pool` - host memory of frames
//! - `video` - `--video`
//! - `shard` - `--shard K/N`
//! - `settings` - everything that determines the pictures of a run
//! - `resume` - the record of one run, for `--resume`
//! - `records` - all records in a folder of pictures
//! - `verify` - `--verify`: missing and wrong files
//! - `report` - the report, as it is written to JSON

mod buffer_pool;
mod camera_list;
mod device;
mod draw;
mod encode;
mod notes;
mod outputs;
mod plan;
mod queue;
mod records;
mod report;
mod resume;
mod settings;
mod shard;
mod start;
mod verify;
mod video;

use std::path::PathBuf;
use std::sync::atomic::Ordering;

use anyhow::{Context, Result};

use crate::cli::budget::BudgetArgs;
use crate::cli::cameras::{EyeArgs, FilmArgs, SplitArg};
use crate::cli::devices::{DevicesArgs, names_of, say_memory};
use crate::cli::drawable::read_places;
use crate::cli::knobs::Knobs;
use crate::cli::scenes::SceneArg;
use crate::cli::sink::Sink;
use crate::cli::{REPORTS_TO_STDOUT, Usage, knobs, one_of, parse_size, say};
use crate::files::is_stdout;
use crate::measure::bench::VersionReport;
use crate::options::Options;
use crate::pixels::{Compression, FileKind};
use crate::rules::Background;
pub(super) use camera_list::{SelectedCamera, select_cameras};
use outputs::{Layer, Names};
use plan::{Plan, Source, plan};
pub(super) use report::Report;
use shard::Shard;
use start::Start;
pub(super) use verify::{Incomplete, Report as VerifyReport};

/// Render a scene to PNG, EXR or .npy
#[derive(clap::Args)]
pub(super) struct Args {
    #[command(flatten)]
    scene: SceneArg,
    /// Picture file, or folder for several pictures (00000.png and so on) [default: the scene's name with .png, or
    /// `renders`]. A .png has 8 bits per channel; .exr and .npy hold 32-bit floats, premultiplied by alpha. `-` is
    /// standard output, in the --format
    #[arg(short, long, value_name = "FILE|DIR")]
    output: Option<PathBuf>,
    /// Kind of the files [default: by the name of the file; png in a folder]. Needed for names without an ending, like
    /// /dev/stdout
    #[arg(long, value_name = "KIND", value_parser = one_of(FILE_KINDS))]
    format: Option<FileKind>,
    /// Compression of PNG and EXR files. The values in them are the same
    #[arg(long, value_name = "HOW", default_value = "fast", value_parser = one_of(COMPRESSIONS))]
    compression: Compression,
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
    /// Draw the scene at every place of a list (docs/side-files.md): JSON like {"places": [{"position": [0, 0, 5],
    /// "rotation": [1, 0, 0, 0], "scale": 2}]}. All places share the memory of one. Needs the fast path
    #[arg(long, value_name = "FILE", conflicts_with_all = ["max_error", "min_psnr"])]
    place: Option<PathBuf>,
    #[command(flatten)]
    split: SplitArg,
    /// Cameras of the file: a position from 0 on, or from -1 for the last backwards; an image name, with or without its
    /// ending; a range like 0..10 (both ends included), 3.. or ..5; a list of these like 0,5,-1; or `all` [default: the
    /// first]
    #[arg(long, value_name = "N|NAME|LIST|all", allow_hyphen_values = true, conflicts_with = "eye")]
    camera: Option<String>,
    #[command(flatten)]
    eye: EyeArgs,
    #[command(flatten)]
    film: FilmArgs,
    /// Make a video of the pictures with the ffmpeg that is installed: an .mp4, .mkv, .mov or .webm. Without its name,
    /// or without ffmpeg: number the pictures from 0 without gaps, and print the ffmpeg command that makes it
    #[arg(long, value_name = "VIDEO", num_args = 0..=1, conflicts_with = "names", value_parser = video::parse_file)]
    video: Option<Option<PathBuf>>,
    /// Continue an interrupted run of the same command into a folder: complete files are skipped. After a complete run,
    /// nothing is left to do
    #[arg(long, conflicts_with_all = ["certificate", "dump"])]
    resume: bool,
    /// Draw only the part K of N of the cameras, with K from 1 to N: one run on each of N machines draws all of them,
    /// into one folder or several (docs/cluster.md). The files have the names that they have in one run. Each shard has
    /// a record of its own, so that --resume continues it by itself
    #[arg(long, value_name = "K/N", conflicts_with_all = ["dump", "max_error", "min_psnr"])]
    shard: Option<Shard>,
    /// Draw nothing, and say which files of this command, of all shards and layers, are missing, truncated, damaged or
    /// of other settings. Exit code 6 if there are any. It needs no device
    #[arg(long, conflicts_with_all = ["resume", "no_clobber", "certificate", "dump", "timings", "device"])]
    #[arg(conflicts_with_all = ["max_error", "min_psnr"])]
    verify: bool,
    /// Draw every picture by levels of detail a second time, by all Gaussians, and report the PSNR between the two.
    /// Each view is waited for
    #[arg(long, conflicts_with_all = ["reference", "certificate", "dump", "verify", "max_error", "min_psnr"])]
    measure_levels: bool,
    /// Refuse to replace existing files. With --resume, this does not concern what the run itself completed
    #[arg(long)]
    no_clobber: bool,
    /// Background: three numbers from 0 to 1, #rrggbb, black, grey, white, or `transparent`
    #[arg(long, value_name = "R,G,B|#RRGGBB|NAME", default_value = "0,0,0", value_parser = parse_background)]
    #[arg(allow_hyphen_values = true)]
    background: Background,
    #[command(flatten)]
    device: DevicesArgs,
    /// Accuracy for speed: exact, balanced, fast or preview. The rules of another renderer, exactly: inria, gsplat or
    /// khr. As balanced, by the stages that run on every device, like --portable: portable [default: balanced]
    #[arg(long, value_name = "NAME", value_parser = knobs::preset_names())]
    #[arg(conflicts_with_all = ["max_error", "min_psnr"])]
    preset: Option<String>,
    /// Use only what works on every device: the portable path
    #[arg(long, conflicts_with = "place")]
    portable: bool,
    /// Render on the CPU in float64: the reference with which the GPU is compared. Slow. It draws by the rules of the
    /// picture and takes --sh-degree; what else trades accuracy for speed cannot be combined with it
    #[arg(long, conflicts_with_all = ["device", "portable", "timings", "dump", "max_error", "min_psnr"])]
    #[arg(conflicts_with = "place")]
    reference: bool,
    /// Print the GPU time of every stage of the frame, the phases from the command to the first picture and, with
    /// several pictures, how busy the GPU and the threads were
    #[arg(long)]
    timings: bool,
    /// Write a report as JSON (docs/schemas/render.schema.json): files, cameras, counts, times; - prints it instead of
    /// the text. With --verify, the files that are wrong (docs/schemas/verify.schema.json)
    #[arg(long, value_name = "FILE|-")]
    json: Option<Sink>,
    /// Also write the certificate: for every pixel, an upper bound on the difference of its channels to the picture
    /// without thresholds, cuts and stops, of the scene as stored on the GPU and in the same order. An .exr or .npy
    /// file, or a folder for several pictures
    #[arg(long, value_name = "FILE|DIR", conflicts_with_all = ["reference", "place"])]
    certificate: Option<PathBuf>,
    /// Write the buffers that each stage of a single picture changed to this folder, as .npy
    #[arg(long, value_name = "DIR", conflicts_with_all = ["video", "path"])]
    dump: Option<PathBuf>,
    #[command(flatten)]
    knobs: Knobs,
    #[command(flatten)]
    budget: BudgetArgs,
    #[arg(skip)]
    start: Start,
}

const FILE_KINDS: [(&str, &str, FileKind); 4] = [
    ("png", "8 bits per channel", FileKind::Png),
    ("png16", "16 bits per channel", FileKind::Png16),
    ("exr", "32-bit floats, premultiplied by alpha", FileKind::Exr),
    ("npy", "The same as a NumPy array of rows of pixels", FileKind::Npy),
];

const COMPRESSIONS: [(&str, &str, Compression); 2] = [
    ("fast", "As fast as it goes; EXR is not compressed", Compression::Fast),
    ("small", "Some 10 % smaller PNG in 25 times the time, some 25 % smaller EXR in 15 times", Compression::Small),
];

fn parse_background(text: &str) -> Result<Background> {
    let named = [("black", [0; 3]), ("grey", [128; 3]), ("gray", [128; 3]), ("white", [255; 3])];
    let bytes = named.iter().find(|(name, _)| *name == text).map(|(_, bytes)| *bytes).or_else(|| hexadecimal(text));
    if text == "transparent" {
        return Ok(Background::Transparent);
    }
    let numbers: Option<Vec<f32>> = text.split(',').map(|n| n.trim().parse().ok()).collect();
    let colour: Option<[f32; 3]> = numbers.and_then(|n| n.try_into().ok());
    let colour = colour.filter(|c| c.iter().all(|v| (0.0..=1.0).contains(v)));
    let colour = bytes.map(|bytes| bytes.map(|byte| f32::from(byte) / 255.0)).or(colour);
    let expected = "expected R,G,B from 0 to 1, like 1,1,1, or #rrggbb, black, grey, white or transparent";
    Ok(Background::Colour(colour.context(expected)?))
}

/// The three bytes of #rrggbb.
fn hexadecimal(text: &str) -> Option<[u8; 3]> {
    let digits = text.strip_prefix('#').filter(|d| d.len() == 6 && d.bytes().all(|b| b.is_ascii_hexdigit()))?;
    let number = u32::from_str_radix(digits, 16).ok()?;
    let [_, red, green, blue] = number.to_be_bytes();
    Some([red, green, blue])
}

pub(super) fn run(args: &Args) -> Result<()> {
    let budget = args.budget.budget()?;
    args.json.as_ref().map_or(Ok(()), Sink::check)?;
    let mut files = args.output.iter().chain(&args.certificate);
    if files.any(|file| is_stdout(file)) {
        REPORTS_TO_STDOUT.store(true, Ordering::Relaxed);
    }
    if args.reference {
        check_reference(args)?;
    } else {
        args.knobs.check_gpu()?;
    }
    if args.verify {
        return verify::verify(args);
    }
    let file = args.scene.file();
    let instances = read_places(args.place.as_deref())?;
    let (devices, scene) = start::devices_and_scene(args)?;
    let scene = scene.placed(instances);
    let source = file.map(|file| Source { file, is_antialiased: scene.source.is_antialiased });
    let plan = Plan { source, ..plan(args, &|| Ok(scene.source.focus()))? };
    plan.make_folders()?;
    let (exact, options) = options(args, scene.source.is_antialiased, plan.nearest);
    if let Some(why) = options.uncertifiable().filter(|_| args.certificate.is_some()) {
        return Err(Usage(format!("--certificate: {why}")).into());
    }
    let preset = args.preset.clone().or_else(|| (!args.reference && budget.is_none()).then(|| "balanced".to_owned()));
    let device = (!args.reference).then(|| names_of(&devices));
    let report = args.json.as_ref().map(|sink| (sink, scene.report()));
    let (options, frames) = if args.reference {
        (options, draw::by_reference(args, &plan, &scene, &options)?)
    } else {
        draw::by_gpu(args, &plan, &devices, scene, (exact, options))?
    };
    plan.command.as_ref().map_or(Ok(()), |command| say!("{command}"))?;
    let video = plan.video.map(|video| video.file.display().to_string()).or(plan.command);
    if args.timings {
        args.start.say()?;
        devices.iter().try_for_each(say_memory)?;
    }
    let Some((sink, scene)) = report else { return Ok(()) };
    let (format, smalto, start) = (Report::FORMAT.to_owned(), VersionReport::current(), args.start.phases());
    sink.write_json(&Report { format, smalto, scene, preset, device, options, start, frames, video })
}

/// The options of a run without a budget, and those with the same rules and no knob turned. The reference has no knob
/// but the degree.
fn options(args: &Args, is_antialiased: bool, nearest: f32) -> (Options, Options) {
    let preset = args.preset.as_deref().and_then(Options::preset).unwrap_or_default();
    let preset = Options { portable: args.portable || preset.portable, ..preset };
    let options = args.knobs.options(&preset, is_antialiased, nearest);
    let exact = args.knobs.options(&preset.untraded(), is_antialiased, nearest);
    let degree = options.sh_degree;
    (exact, if args.reference { Options { sh_degree: degree, ..exact } } else { options })
}

/// Fails if the preset is one of accuracy, of which the reference has none.
fn check_reference(args: &Args) -> Result<(), Usage> {
    let is_drawn = |preset: &Options| *preset == preset.untraded() && !preset.portable;
    match args.preset.as_deref().and_then(|name| Some((name, Options::preset(name)?))) {
        Some((name, preset)) if !is_drawn(&preset) => Err(Usage(format!(
            "--reference cannot be combined with --preset {name}, which trades accuracy for speed or chooses a GPU path"
        ))),
        _ => Ok(()),
    }
}
