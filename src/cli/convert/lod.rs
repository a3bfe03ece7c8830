//! `smalto lod`: levels of detail of a scene, with their errors.

use std::path::PathBuf;

use anyhow::Result;

use super::pages::{self, STORAGES};
use super::{Edits, Inputs, Target, say_written};
use crate::cli::{ReadingArgs, Sink, Usage, one_of};
use crate::options::Options;

/// Build levels of detail of a scene: a page file that is drawn within an error or a number of Gaussians
#[derive(clap::Args)]
#[command(after_help = "\
The file holds all Gaussians of the scene, and nodes that stand for several of them, each with the error that this
makes, measured on small pictures from six directions. It is drawn as the scene is, unless --lod-error, --lod-psnr or
--splats ask for less (docs/levels.md).")]
pub(in crate::cli) struct Args {
    /// Scene file, folder, procedural scene or - as for `smalto render`
    #[arg(value_name = "SCENE")]
    scene: PathBuf,
    /// The file to write (.smalto)
    #[arg(short, long, value_name = "FILE")]
    output: PathBuf,
    /// Number formats of the file [default: lossless]
    #[arg(long, value_name = "NAME", value_parser = one_of(storages()))]
    storage: Option<Options>,
    /// Megabytes of memory in which the Gaussians of the scene are sorted [default: 2048]
    #[arg(long, value_name = "MB", value_parser = clap::value_parser!(u32).range(1..=1 << 20))]
    memory: Option<u32>,
    /// Write the report as JSON; - prints it instead of the table
    #[arg(long, value_name = "FILE|-")]
    json: Option<Sink>,
    #[command(flatten)]
    reading: ReadingArgs,
}

/// The number formats that opacities above 1 fit into.
fn storages() -> [(&'static str, &'static str, Options); 4] {
    let [lossless, balanced, fast, preview, _] = STORAGES;
    [lossless, balanced, fast, preview]
}

pub(in crate::cli) fn run(args: &Args) -> Result<()> {
    let Args { scene, output, storage, memory, json, reading } = args;
    if output.extension().is_none_or(|ending| !ending.eq_ignore_ascii_case("smalto")) {
        return Err(Usage(format!("{}: levels of detail are written to .smalto files", output.display())).into());
    }
    let files = [scene.clone()];
    Target::Pages.check(output, files.iter().map(PathBuf::as_path), false, json.as_ref())?;
    let inputs = Inputs { files: &files, reading: *reading, edits: &Edits::default() };
    let (written, removed) = pages::convert(inputs, output, pages::settings(*storage, *memory, true))?;
    say_written(written, removed, json.as_ref())
}
