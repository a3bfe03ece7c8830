//! `smalto lod`: levels of detail of a scene, with their errors, or one of them as a scene.

use std::path::{Path, PathBuf};

use anyhow::Result;
use clap::builder::NonEmptyStringValueParser;

use super::pages::{self, STORAGES};
use super::target::{is_same, kept_degree};
use super::{Edits, Inputs, Target, WritingArgs, formats, say_written, write_scene};
use crate::cli::devices::open_instead_of_host;
use crate::cli::headings::{DEVICE, OUTPUT};
use crate::cli::scenes::{ReadingArgs, SceneArg};
use crate::cli::sink::Sink;
use crate::cli::values::whole;
use crate::cli::{Usage, one_of, progress, remark};
use crate::files::{Checkpoint, is_stdout};
use crate::formats::{LOD_META, SceneFile, Streamed, WrittenLevels, write_streamed_sog};
use crate::lod::Fitter;
use crate::measure::prune::Written;
use crate::options::Options;
use crate::pagefile::write::{Settings, subtrees};
use crate::pagefile::{PageFile, nodes_of, static_level};
use crate::render::DeviceFitter;
use crate::scene::{NoLevel, Scene, Watch};

/// Build levels of detail of a scene: a page file that is drawn within a splat budget or an error, or one level
#[derive(clap::Args)]
#[command(
    after_help = "\
Examples:
  smalto lod garden.ply -o garden.smalto --storage balanced
  smalto lod garden.smalto --splats 500K -o small.ply
  smalto lod garden.ply -o levels/lod-meta.json",
    after_long_help = "\
Without --level and --splats the file holds all Gaussians of the scene, and nodes that stand for several of them, each
with the error that this makes, measured on small pictures from six directions. It is drawn as the scene is, unless
--lod-error, --lod-psnr or --splats ask for less. With one of them the file is a scene with fewer Gaussians, the same
for all views. A lod-meta.json is a streamed SOG with all levels, for the viewers of PlayCanvas (docs/levels.md)."
)]
pub(in crate::cli) struct Args {
    /// Scene file, folder, procedural scene or - as for `smalto render`
    #[arg(value_name = "SCENE")]
    scene: PathBuf,
    /// The file to write: .smalto, or lod-meta.json (a streamed SOG)
    ///
    /// A streamed SOG takes the folder of the file. With --level or --splats, the file has any format that `smalto
    /// convert` writes.
    #[arg(short, long, help_heading = OUTPUT, value_name = "FILE")]
    output: PathBuf,
    /// Write a scene with half as many Gaussians, N times over
    #[arg(long, help_heading = OUTPUT, value_name = "N", value_parser = whole::<u32>(0..=32))]
    level: Option<u32>,
    /// Write a scene with at most this many Gaussians, like 500K
    #[arg(long, help_heading = OUTPUT, value_name = "COUNT", conflicts_with = "level")]
    #[arg(value_parser = whole::<u32>(1..=u64::from(u32::MAX)))]
    splats: Option<u32>,
    /// Keep the levels of a lod-meta.json or a .rad with a tree
    ///
    /// New levels, which are not made then, are better: each part of the scene is drawn at one of its levels, as a
    /// whole. The errors of the levels are measured. The whole scene must fit into host memory.
    #[arg(long, help_heading = OUTPUT, conflicts_with_all = ["lod", "host_memory"])]
    keep_levels: bool,
    /// Rounds that fit the shapes of nodes [default: 0]
    ///
    /// 12 rounds gain 0.3 to 2.2 dB at the same number of nodes. Levels then take 1.5 to 2.2 times as long with a GPU,
    /// and about four times without (docs/levels.md).
    #[arg(long, help_heading = OUTPUT, value_name = "COUNT", conflicts_with = "keep_levels")]
    #[arg(value_parser = whole::<u32>(0..=100))]
    fit_rounds: Option<u32>,
    /// Device that fits nodes: a number, part of a name, or host: the processor
    ///
    /// The number is that in the list of `smalto doctor`. By default a GPU, if there is one. The file has the same
    /// bytes.
    #[arg(long, help_heading = DEVICE, value_name = "DEVICE", value_parser = NonEmptyStringValueParser::new())]
    #[arg(conflicts_with = "keep_levels")]
    device: Option<String>,
    /// Format of the level [default: by the name of the file]
    #[arg(long, help_heading = OUTPUT, value_name = "FORMAT", value_parser = one_of(formats()))]
    #[arg(hide_possible_values = true)]
    format: Option<Target>,
    /// Number formats of a .smalto file: lossless, balanced, fast or preview
    ///
    /// As for `smalto convert`, lossless by default.
    #[arg(long, help_heading = OUTPUT, value_name = "NAME", value_parser = one_of(storages()))]
    #[arg(hide_possible_values = true)]
    storage: Option<Options>,
    #[command(flatten)]
    writing: WritingArgs,
    #[command(flatten)]
    reading: ReadingArgs,
}

/// The number formats that opacities above 1 fit into.
fn storages() -> [(&'static str, &'static str, Options); 4] {
    let [lossless, balanced, fast, preview, _] = STORAGES;
    [lossless, balanced, fast, preview]
}

pub(in crate::cli) fn run(args: &Args) -> Result<()> {
    let Args { scene, output, storage, writing: WritingArgs { json, .. }, level, splats, format, .. } = args;
    if level.is_some() || splats.is_some() {
        return one_level(args);
    }
    if format.is_some() {
        return Err(Usage("--format needs --level or --splats: levels are written to .smalto files".to_owned()).into());
    }
    if output.file_name().is_some_and(|name| name == LOD_META) {
        return streamed_sog(args);
    }
    if output.extension().is_none_or(|ending| !ending.eq_ignore_ascii_case("smalto")) {
        let one = "and one of them to any format with --level or --splats";
        let all = format!("levels of detail are written to .smalto files or {LOD_META}, {one}");
        return Err(Usage(format!("{}: {all}", output.display())).into());
    }
    let files = [scene.clone()];
    Target::Pages.check(output, files.iter().map(PathBuf::as_path), false, json.as_ref())?;
    let (written, removed, notices) = write_levels(args, output, *storage)?;
    say_written(written, removed, notices, json.as_ref())
}

/// Writes a page file with levels: those of the source, or new ones.
fn write_levels(args: &Args, output: &Path, storage: Option<Options>) -> Result<(Written, usize, Vec<String>)> {
    let Args { scene, reading, keep_levels, writing: WritingArgs { host_memory, .. }, fit_rounds, .. } = args;
    let usual = pages::settings(storage, *host_memory);
    let settings = Settings { has_levels: true, fit_rounds: fit_rounds.unwrap_or(0), ..usual };
    if *keep_levels {
        return pages::keep_levels(&SceneArg { scene: scene.clone(), reading: *reading }, output, settings);
    }
    let fitter = fitter(args.device.as_deref())?;
    let files = [scene.clone()];
    let inputs = Inputs { files: &files, reading: *reading, edits: &Edits::default() };
    let written = pages::convert(inputs, output, settings, fitter.as_ref().map(|fitter| fitter as &dyn Fitter))?;
    if let Some(failure) = fitter.and_then(|fitter| fitter.take_failure()) {
        remark(&format!("some nodes were fitted on the processor: {failure:#}"));
    }
    Ok(written)
}

/// What fits nodes in place of the processor: the named device, or a GPU that makes the same bits.
fn fitter(device: Option<&str>) -> Result<Option<DeviceFitter>> {
    let Some(opened) = open_instead_of_host(device)? else { return Ok(None) };
    match DeviceFitter::new(&opened) {
        Err(error) if device.is_none() => {
            remark(&format!("nodes are fitted on the processor: {error:#}"));
            Ok(None)
        }
        made => made.map(Some),
    }
}

/// Writes one level of a scene.
fn one_level(args: &Args) -> Result<()> {
    let Args { scene, output, storage, writing: WritingArgs { host_memory, json }, reading, .. } = args;
    if output.file_name().is_some_and(|name| name == LOD_META) {
        return Err(Usage(format!("{LOD_META} holds all levels: leave out --level and --splats")).into());
    }
    let target = Target::of(output, args.format, None)?;
    if storage.is_some() && target != Target::Pages {
        return Err(Usage("--storage needs a .smalto file to write".to_owned()).into());
    }
    target.check(output, [scene.as_path()], false, json.as_ref())?;
    let input = SceneArg { scene: scene.clone(), reading: *reading };
    let has_wanted = |file: &PageFile| match args.keep_levels {
        true => file.header().has_source_levels(),
        false => file.levels().is_some(),
    };
    let scene = with_levels(args, has_wanted, |file| level_of(args, file))?;
    let written = match target {
        Target::Pages => pages::write_pages(output, input.title(), &scene, pages::settings(*storage, *host_memory))?,
        Target::Scene(kind) => write_scene(output, kind, scene.gaussians, scene.is_antialiased)?,
    };
    say_written(written, 0, Vec::new(), json.as_ref())
}

/// Writes all levels as a streamed SOG.
fn streamed_sog(args: &Args) -> Result<()> {
    let Args { scene, output, storage, writing: WritingArgs { json, .. }, .. } = args;
    if storage.is_some() {
        return Err(Usage("--storage needs a .smalto file to write".to_owned()).into());
    }
    if args.keep_levels {
        return Err(Usage(format!("--keep-levels writes a .smalto file; a {LOD_META} gets new levels")).into());
    }
    json.as_ref().map_or(Ok(()), Sink::check)?;
    let folder = output.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    if is_same(scene, output) {
        return Err(Usage(format!("{} is both the input and the output", scene.display())).into());
    }
    let has_made_levels = |file: &PageFile| file.levels().is_some() && !file.header().has_source_levels();
    let written = with_levels(args, has_made_levels, |file| {
        let subtrees = subtrees(file.statistics().count, MOST_PARTS);
        let bar = progress::Bar::new("writing");
        let WrittenLevels { counts, bytes, transparent, loss } = write_streamed_sog(
            folder,
            &Streamed {
                parts: subtrees.len(),
                levels: subtrees.iter().map(Vec::len).max().unwrap_or(0),
                is_antialiased: file.header().is_antialiased,
                nodes: &|part, level| nodes_of(file, &subtrees[part][level]),
                progress: &|fraction| bar.set(fraction),
            },
        )?;
        let levels = if counts.len() == 1 { "1 level".to_owned() } else { format!("{} levels", counts.len()) };
        let format = format!("streamed SOG, {levels}, the coarsest of {}", counts[counts.len() - 1]);
        let sh_degree = kept_degree(output, SceneFile::SogFolder, file.statistics().sh_degree);
        Ok(Written {
            file: output.display().to_string(),
            format,
            bytes,
            gaussians: counts[0],
            sh_degree,
            transparent,
            loss,
        })
    })?;
    say_written(written, 0, Vec::new(), json.as_ref())
}

/// Most parts of a streamed SOG. Viewers look at all of them in every frame.
const MOST_PARTS: usize = 4096;

/// Gives the scene's page file with levels. Where it has not the wanted ones, they are written beside the output, and
/// removed then.
fn with_levels<T>(
    args: &Args,
    has_levels: impl Fn(&PageFile) -> bool,
    give: impl FnOnce(&PageFile) -> Result<T>,
) -> Result<T> {
    let Args { scene, output, reading, .. } = args;
    let input = SceneArg { scene: scene.clone(), reading: *reading };
    if let Some(file) = input.page_file()?.filter(has_levels) {
        let of_new =
            [("--fit-rounds", args.fit_rounds.is_some_and(|rounds| rounds > 0)), ("--device", args.device.is_some())];
        if let Some((option, _)) = of_new.into_iter().find(|(_, is_given)| *is_given) {
            let why = format!("has levels already, and {option} is for new ones: leave it out");
            return Err(Usage(format!("{} {why}", scene.display())).into());
        }
        return give(&file);
    }
    if is_stdout(output) {
        let why = "only a level of a file that has levels goes to standard output: write them with smalto lod first";
        return Err(Usage(why.to_owned()).into());
    }
    let name = output.file_name().unwrap_or_default().to_string_lossy();
    let is_there = |folder: &&Path| folder.as_os_str().is_empty() || folder.is_dir();
    let folder = output.ancestors().skip(1).find(is_there).unwrap_or(Path::new(""));
    let checkpoint = Checkpoint::beside(&folder.join(format!("{name}.levels")), NO_STATE)?;
    let path = checkpoint.path("levels.smalto");
    write_levels(args, &path, None)?;
    give(&PageFile::open(&path)?)
}

/// Levels that are only made for another file are removed at the end.
const NO_STATE: &str = "none";

/// The level that the arguments ask for.
fn level_of(args: &Args, file: &PageFile) -> Result<Scene> {
    let count = file.statistics().count;
    let most = args.splats.map_or_else(|| count >> args.level.unwrap_or(0), |splats| splats as usize);
    let bar = progress::Bar::new("choosing");
    let progress = |fraction| bar.set(fraction);
    let watch = Watch::of_progress(&progress);
    static_level(file, most, &watch).map_err(|error| match error.downcast::<NoLevel>() {
        Ok(NoLevel { problem, .. }) => Usage(format!("{}: {problem}", args.scene.display())).into(),
        Err(error) => error,
    })
}
