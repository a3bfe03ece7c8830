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
//! - `bands` - pictures that are drawn band by band
//! - `encode` - encodes pictures on all cores
//! - `buffer_pool` - host memory of frames
//! - `video` - `--video`
//! - `shard` - `--shard K/N`
//! - `settings` - everything that determines the pictures of a run
//! - `resume` - the record of one run, for `--resume`
//! - `records` - all records in a folder of pictures
//! - `verify` - `--verify`: missing and wrong files
//! - `report` - the report, as it is written to JSON

mod bands;
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
use crate::cli::cameras::{EyeArgs, FilmArgs, LensArgs, SplitArg};
use crate::cli::devices::{DevicesArgs, say_memory};
use crate::cli::drawable::read_places;
use crate::cli::headings::{ACCURACY, CAMERAS, DEVICE, LEVELS, MANY, OUTPUT, REPORTS};
use crate::cli::knobs::Knobs;
use crate::cli::levels::{Measurement, parse_measurement};
use crate::cli::scenes::SceneArg;
use crate::cli::sink::Sink;
use crate::cli::{REPORTS_TO_STDOUT, Usage, knobs, one_of, say, values};
use crate::files::is_stdout;
use crate::gpu::names_of;
use crate::measure::bench::VersionReport;
use crate::options::Options;
use crate::pixels::{Compression, FileKind};
use crate::rules::Background;
use bands::Share;
pub(super) use camera_list::{SelectedCamera, select_cameras};
use outputs::{Layer, Names};
use plan::{Plan, Source, plan};
pub(super) use report::Report;
use shard::Shard;
use start::Start;
pub(super) use verify::{Incomplete, Report as VerifyReport};

/// Render a scene to PNG, EXR or .npy
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  smalto render garden.ply -o garden.png --size 1920x1080
  smalto render garden.ply --camera all --split test --names image -o views/
  smalto render garden.ply --orbit 90 --video turn.mp4
  smalto render garden.ply --eye 1,-2,-3 --target 0,0,0 --background white
  smalto render garden.smalto --splats 500K -o fast.png

smalto render --help has every option in full; docs/commands.md has more examples.")]
pub(super) struct Args {
    #[command(flatten)]
    scene: SceneArg,
    /// Picture file, or folder for several [default: the scene's name]
    ///
    /// A .png has 8 bits per channel; .exr and .npy hold 32-bit floats, premultiplied by alpha. Pictures in a folder
    /// are 00000.png and so on, by default in `renders`. `-` is standard output, in the --format.
    #[arg(short, long, help_heading = OUTPUT, value_name = "FILE|DIR")]
    output: Option<PathBuf>,
    /// png, png16, exr or npy [default: by the name of the file]
    ///
    /// Pictures in a folder are png by default. png has 8 bits per channel, png16 has 16; exr and npy hold 32-bit
    /// floats, premultiplied by alpha. Needed for names without an ending, like /dev/stdout.
    #[arg(long, help_heading = OUTPUT, value_name = "KIND", hide_possible_values = true)]
    #[arg(value_parser = one_of(FILE_KINDS))]
    format: Option<FileKind>,
    /// Picture size in pixels [default: the camera's, or 1280x720]
    #[arg(long, help_heading = OUTPUT, value_name = "WxH", value_parser = values::size)]
    size: Option<[u32; 2]>,
    /// R,G,B (0 to 1), #rrggbb, white, grey or transparent
    ///
    /// Three numbers, hexadecimal digits, black, grey, white, or transparent.
    #[arg(long, help_heading = OUTPUT, value_name = "COLOUR", default_value = "0,0,0", value_parser = parse_background)]
    #[arg(allow_hyphen_values = true)]
    background: Background,
    /// colour, alpha, depth, median-depth, counts
    ///
    /// Separated by commas. A single layer is written to --output itself. Several layers have a folder each
    /// (renders/colour/00000.png, renders/depth/00000.exr) or, if --output is a file, their name in the file name
    /// (a.png, a.depth.exr). Depths are the view z of the means of splats, through a lens their distance, in world
    /// units. Depths and counts have one float channel, and are .exr if pictures are PNG. They include only the splats
    /// that the preset blends.
    #[arg(long, help_heading = OUTPUT, value_name = "LAYERS", value_delimiter = ',', default_value = "colour")]
    #[arg(hide_possible_values = true)]
    layers: Vec<Layer>,
    /// Compression of PNG and EXR: fast or small
    ///
    /// small makes PNG some 10 % smaller in 25 times the time, and EXR some 25 % smaller in 15 times. With fast, EXR is
    /// not compressed. The values in the files are the same.
    #[arg(long, help_heading = OUTPUT, value_name = "HOW", default_value = "fast", hide_possible_values = true)]
    #[arg(value_parser = one_of(COMPRESSIONS))]
    compression: Compression,
    /// Refuse to replace existing files
    ///
    /// With --resume, this does not concern what the run itself completed.
    #[arg(long, help_heading = OUTPUT)]
    no_clobber: bool,
    /// Camera file [default: found next to the scene or in a folder above it]
    ///
    /// cameras.json of the original 3DGS, transforms.json of nerfstudio, instant-ngp or Blender's data sets,
    /// camera_path.json of nerfstudio, or a sparse model of COLMAP (its folder, the folder above it, images.bin or
    /// images.txt).
    #[arg(long, help_heading = CAMERAS, value_name = "FILE|DIR")]
    cameras: Option<PathBuf>,
    /// Positions or image names: 7, -1, DSC0795, 0..10, all [default: first]
    ///
    /// A position is a number from 0 on, or from -1 for the last backwards. An image name is written with or without
    /// its ending. A range like 0..10 has both ends; 3.. and ..5 are ranges, too. Several are separated by commas, like
    /// 0,5,-1.
    #[arg(long, help_heading = CAMERAS, value_name = "CAMERAS", allow_hyphen_values = true, conflicts_with = "eye")]
    camera: Option<String>,
    #[command(flatten)]
    split: SplitArg,
    #[command(flatten)]
    eye: EyeArgs,
    #[command(flatten)]
    lens: LensArgs,
    /// Draw the scene at every place of a list (docs/side-files.md)
    ///
    /// The list is JSON like {"places": [{"position": [0, 0, 5], "rotation": [1, 0, 0, 0], "scale": 2}]}. All places
    /// share the memory of one. Only the fast path draws them.
    #[arg(long, help_heading = CAMERAS, value_name = "FILE", conflicts_with_all = ["max_error", "min_psnr"])]
    place: Option<PathBuf>,
    #[command(flatten)]
    film: FilmArgs,
    /// Make a video: .mp4, .mkv, .mov or .webm; without a name, print how
    ///
    /// The installed ffmpeg makes it. Without a name, or without ffmpeg, the pictures are numbered from 0 without gaps,
    /// and the ffmpeg command that makes the video is printed.
    #[arg(long, help_heading = MANY, value_name = "VIDEO", num_args = 0..=1, conflicts_with = "names")]
    #[arg(value_parser = video::parse_file)]
    video: Option<Option<PathBuf>>,
    /// Names of pictures in a folder: index or image [default: index]
    ///
    /// Folders in image names are created below --output.
    #[arg(long, help_heading = MANY, value_name = "BY", hide_possible_values = true)]
    names: Option<Names>,
    /// Continue an interrupted run of the same command into a folder
    ///
    /// Complete files are skipped. After a complete run, nothing is left to do.
    #[arg(long, help_heading = MANY, conflicts_with_all = ["certificate", "dump"])]
    resume: bool,
    /// Draw the part K of N of the cameras (docs/cluster.md)
    ///
    /// K is from 1 to N. One run on each of N machines draws all cameras, into one folder or several. The files have
    /// the names that they have in one run. Each shard has its own record, so that --resume continues it by itself.
    #[arg(long, help_heading = MANY, value_name = "K/N", conflicts_with_all = ["dump", "max_error", "min_psnr"])]
    shard: Option<Shard>,
    /// Draw nothing, list missing and wrong files; exit code 6 if there are any
    ///
    /// A file of this command, of any shard and layer, may be missing, truncated, damaged or of other settings. No
    /// device is needed.
    #[arg(long, help_heading = MANY)]
    #[arg(conflicts_with_all = ["resume", "no_clobber", "certificate", "dump", "timings", "device", "share"])]
    #[arg(conflicts_with_all = ["max_error", "min_psnr"])]
    verify: bool,
    /// exact, balanced (default), fast, preview, inria, gsplat, khr, portable
    ///
    /// The first four are accuracy for speed. inria, gsplat and khr draw exactly by the rules of another renderer.
    /// portable is balanced by the stages that run on every device.
    #[arg(long, help_heading = ACCURACY, value_name = "NAME", hide_possible_values = true)]
    #[arg(value_parser = knobs::preset_names(), conflicts_with_all = ["max_error", "min_psnr"])]
    preset: Option<String>,
    #[command(flatten)]
    budget: BudgetArgs,
    /// Render on the CPU in float64, slowly: what the GPU is compared with
    ///
    /// The reference draws by the rules of the picture and takes --sh-degree. All other options that trade accuracy for
    /// speed are refused with it.
    #[arg(long, help_heading = ACCURACY, conflicts_with = "place")]
    #[arg(conflicts_with_all = ["device", "share", "portable", "timings", "dump", "max_error", "min_psnr"])]
    reference: bool,
    /// Use the portable path, with any preset
    ///
    /// It runs on every device. `--preset portable` is `--preset balanced --portable`.
    #[arg(long, help_heading = ACCURACY, hide_short_help = true, conflicts_with = "place")]
    portable: bool,
    #[command(flatten)]
    knobs: Knobs,
    /// Measure the PSNR of levels of detail; =sample estimates it
    ///
    /// The PSNR is that of the picture by levels of detail against the one of all Gaussians. Without a value, every
    /// picture is drawn with all Gaussians, too. =sample draws about 64 patches of 64x64 pixels with all Gaussians, and
    /// =sample:N about N; the PSNR is then an estimate with a standard error. Each view is waited for.
    #[arg(long, help_heading = LEVELS, hide_short_help = true, value_name = "sample[:N]")]
    #[arg(value_parser = parse_measurement, num_args = 0..=1, require_equals = true, default_missing_value = "whole")]
    #[arg(conflicts_with_all = ["reference", "certificate", "dump", "verify", "max_error", "min_psnr"])]
    measure_levels: Option<Measurement>,
    #[command(flatten)]
    device: DevicesArgs,
    /// What several devices share: auto, frame or views [default: auto]
    ///
    /// views: each device draws whole pictures. frame: each picture is drawn in bands of rows, by all devices. auto:
    /// whole pictures, but bands of a page file of 50 million Gaussians or more if there are fewer pictures than
    /// devices. The files have the same bytes.
    #[arg(long, help_heading = DEVICE, value_name = "HOW", default_value = "auto", hide_default_value = true)]
    #[arg(hide_possible_values = true, value_parser = bands::parse_share())]
    share: Share,
    /// Print GPU times of stages, the phases of the start, and the load of threads
    #[arg(long, help_heading = REPORTS)]
    timings: bool,
    /// Write a report as JSON; - prints it instead of the text
    ///
    /// It has files, cameras, counts and times (docs/schemas/render.schema.json); with --verify, the files that are
    /// wrong (docs/schemas/verify.schema.json).
    #[arg(long, help_heading = REPORTS, value_name = "FILE|-")]
    json: Option<Sink>,
    /// Also write a bound on the error of every pixel
    ///
    /// The certificate bounds the difference of each channel from a picture that leaves nothing out: no threshold, cut
    /// or stop. Storage on the GPU and the order of splats are taken as they are. An .exr or .npy file, or a folder for
    /// several pictures.
    #[arg(long, help_heading = REPORTS, hide_short_help = true, value_name = "FILE|DIR")]
    #[arg(conflicts_with_all = ["reference", "place"])]
    certificate: Option<PathBuf>,
    /// Bound the distance from the response along rays in the certificate
    ///
    /// The picture is drawn as without --certificate, on any path and by any response. The certificate bounds its
    /// distance from the complete sum along rays, with the errors of the projection and of the order of splats.
    #[arg(long, help_heading = REPORTS, hide_short_help = true, requires = "certificate")]
    // With what --certificate conflicts with, clap would not ask for --certificate.
    #[arg(conflicts_with_all = ["reference", "place", "resume", "verify", "measure_levels"])]
    certify_rays: bool,
    /// Write the buffers that each stage of a single picture changed to this folder, as .npy
    #[arg(long, help_heading = REPORTS, hide_short_help = true, value_name = "DIR")]
    #[arg(conflicts_with_all = ["video", "path"])]
    dump: Option<PathBuf>,
    #[arg(skip)]
    start: Start,
}

impl Args {
    /// True if the options name one view, whatever the scene and the camera file have.
    fn is_of_one_picture(&self) -> bool {
        let is_one_camera = self.camera.as_ref().is_none_or(|camera| camera.parse::<i64>().is_ok());
        is_one_camera && self.video.is_none() && !self.film.is_given()
    }
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

pub(super) fn parse_background(text: &str) -> Result<Background> {
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
