//! `smalto convert` to a page file, of scenes that need not fit into memory.

use std::path::Path;

use anyhow::{Context, Result, ensure};

use super::{Edits, Inputs, read};
use crate::cli::scenes::SceneArg;
use crate::cli::{Usage, progress, remark};
use crate::formats::LOD_META;
use crate::lod::Fitter;
use crate::measure::prune::Written;
use crate::options::{Options, Storage};
use crate::pagefile::write::{
    Finished, Job, Settings, Take, write_blocks, write_in_order, write_source_levels, write_whole,
};
use crate::procedural::Procedural;
use crate::scene::{Gaussians, LoadReport, NoLevel, Scene, Transform, Watch};

/// The number formats of a page file.
pub const STORAGES: [(&str, &str, Options); 5] = [
    ("lossless", "32-bit floats: everything that the source holds", Settings::LOSSLESS),
    ("balanced", "16-bit floats, as the preset stores a scene on the GPU", Options::BALANCED),
    ("fast", "As balanced, with the alpha threshold of the preset", Options::FAST),
    ("preview", "As balanced, with the alpha threshold of the preset", Options::PREVIEW),
    (
        "u8",
        "8 bits for spherical harmonics, scales and opacities",
        Options { sh_storage: Storage::U8, shape_storage: Storage::U8, ..Options::BALANCED },
    ),
];

/// What is written with these number formats within `memory` bytes, without levels of detail.
pub fn settings(storage: Option<Options>, memory: Option<u64>) -> Settings {
    let usual = Settings::default();
    let memory = memory.map_or(usual.memory, |bytes| usize::try_from(bytes).unwrap_or(usize::MAX));
    Settings { options: storage.unwrap_or(usual.options), memory, ..usual }
}

/// Writes a page file. Returns how many Gaussians were left out, and the notices of the readers, too.
/// `fitter`: what fits merged nodes, in place of the host.
pub fn convert(
    inputs: Inputs,
    output: &Path,
    settings: Settings,
    fitter: Option<&dyn Fitter>,
) -> Result<(Written, usize, Vec<String>)> {
    let bar = progress::Bar::new("converting");
    let input = SceneArg { scene: inputs.files[0].clone(), reading: inputs.reading };
    let progress = |fraction| bar.set(fraction);
    let job = Job { fitter, progress: &progress, ..Job::new(output, settings, &input.title()) };
    let streamed = if inputs.files.len() == 1 { streamed(inputs, &input, &job)? } else { None };
    let (finished, removed) = match streamed {
        Some(finished) => finished,
        None => whole(inputs, &job)?,
    };
    if finished.resumed > 0 {
        remark(&format!("{} of {} buckets were sorted by an earlier run", finished.resumed, finished.buckets));
    }
    if finished.resumed_levels > 0 {
        remark(&format!("{} parts of the levels were built by an earlier run", finished.resumed_levels));
    }
    let notices = finished.notices.iter().cloned().chain(finished.header.report.notice()).collect();
    Ok((written(output, &finished)?, removed, notices))
}

/// Writes a page file with the levels of a scene.
pub fn keep_levels(input: &SceneArg, output: &Path, settings: Settings) -> Result<(Written, usize, Vec<String>)> {
    let is_none = || {
        let scene = input.scene.display();
        Usage(format!("--keep-levels needs a {LOD_META}, or a .rad with a tree, and {scene} is none"))
    };
    let path = input.path().ok_or_else(is_none)?;
    let levels = input.read_levels(&path).map_err(|error| match error.is::<NoLevel>() {
        true => is_none().into(),
        false => error,
    })?;
    let written = write_job(output, input.title(), settings, |job| write_source_levels(job, &levels))?;
    Ok((written, 0, Vec::new()))
}

fn written(output: &Path, finished: &Finished) -> Result<Written> {
    Ok(Written {
        file: output.display().to_string(),
        format: finished.header.format_of_pages(),
        bytes: output.metadata()?.len(),
        gaussians: finished.header.statistics.count,
        sh_degree: finished.header.layout.sh_degree,
        transparent: 0,
        loss: Vec::new(),
    })
}

/// Writes the pages of a scene in memory. `title` is the name of its source.
pub(in crate::cli) fn write_pages(output: &Path, title: String, scene: &Scene, settings: Settings) -> Result<Written> {
    write_job(output, title, settings, |job| write_whole(job, scene))
}

/// Writes a page file with a progress bar.
fn write_job(
    output: &Path,
    title: String,
    settings: Settings,
    write: impl FnOnce(&Job) -> Result<Finished>,
) -> Result<Written> {
    let bar = progress::Bar::new("writing pages");
    let progress = |fraction| bar.set(fraction);
    let job = Job { progress: &progress, ..Job::new(output, settings, &title) };
    written(output, &write(&job)?)
}

/// Writes the pages of a scene that is read block by block. `None` if its format is read as a whole.
fn streamed(inputs: Inputs, input: &SceneArg, job: &Job) -> Result<Option<(Finished, usize)>> {
    // The number of Gaussians must be known, so a town of which a part is left out is made as a whole.
    let Inputs { reading, edits, .. } = inputs;
    let is_whole = edits.crop.is_none() && edits.min_opacity.is_none() && reading.reading()?.level.is_none();
    if let Some(town) = input.procedural().transpose()?.filter(|made| made.is_town() && is_whole) {
        return town_in_order(inputs, town, job).map(Some);
    }
    let Some(path) = input.path() else { return Ok(None) };
    let reading = reading.reading()?;
    if reading.level.is_some() || !reading.comes_in_blocks(&path) {
        return Ok(None);
    }
    let blocks = |take: &mut Take| {
        let watch = Watch::NONE;
        let mut take = |block: Gaussians, of: usize| take(edits.applied(block)?, of);
        reading.read_blocks(&path, &watch, &mut take)?.context("the file was changed while it was read")
    };
    let Edits { transform: _, crop, min_opacity, sh_degree } = edits;
    let changes = format!("{reading:?} {crop:?} {min_opacity:?} {sh_degree:?}");
    let finished = write_blocks(job, &path, &blocks, &changes)?;
    let header = &finished.header;
    let report = header.report;
    input.remark(&Scene { report, notices: finished.notices.clone(), ..Scene::empty(&header.format) });
    let removed = report.read.saturating_sub(report.dropped() + header.statistics.count);
    Ok(Some((finished, removed)))
}

/// Gaussians of a town that are made at a time: whole pages, enough for all cores.
const MADE: usize = 1 << 20;

/// Writes the pages of a town, whose Gaussians come in the order of their places, without holding it.
fn town_in_order(inputs: Inputs, town: Procedural, job: &Job) -> Result<(Finished, usize)> {
    let reading = inputs.reading.reading()?;
    let blocks = |take: &mut Take| {
        let mut report = LoadReport::default();
        for first in (0..town.count()).step_by(MADE) {
            let (block, made) = town.fill(first..town.count().min(first + MADE))?;
            let Scene { gaussians, report: placed, .. } = reading.placed(Scene::made(town.name(), block, made))?;
            report = report.and(&placed);
            take(inputs.edits.applied(gaussians)?, town.count())?;
        }
        Ok(Scene { report, ..Scene::empty(&format_of(inputs, &format!("procedural {}", town.name()))?) })
    };
    let finished = write_in_order(job, &blocks)?;
    let removed = town.count() - finished.header.statistics.count;
    Ok((finished, removed))
}

/// Writes the pages of a scene that is read as a whole.
fn whole(inputs: Inputs, job: &Job) -> Result<(Finished, usize)> {
    let scene = read(inputs)?;
    let before = scene.gaussians.len();
    let gaussians = inputs.edits.applied(scene.gaussians)?;
    ensure!(!gaussians.is_empty(), "none of {before} Gaussians is left");
    let removed = before - gaussians.len();
    let format = format_of(inputs, &scene.format)?;
    Ok((write_whole(job, &Scene { gaussians, format, ..scene })?, removed))
}

/// The format that a page file notes of its source. A procedural scene that was changed has no cameras of its own.
fn format_of(Inputs { reading, edits, .. }: Inputs, format: &str) -> Result<String> {
    let reading = reading.reading()?;
    let is_placed = reading.flip != [false; 3] || reading.transform != Transform::IDENTITY;
    let is_changed = is_placed || edits.crop.is_some() || edits.min_opacity.is_some();
    Ok(if is_changed { format!("{format}, changed") } else { format.to_owned() })
}
