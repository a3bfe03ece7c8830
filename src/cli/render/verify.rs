//! `--verify`: says which files of a command are missing or wrong, without a device.

use std::cell::OnceCell;
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use anyhow::{Result, anyhow};
use rayon::prelude::*;
use schemars::JsonSchema;
use serde::Serialize;

use super::outputs::{Output, Shot};
use super::plan::plan;
use super::records::{Content, Recorded, read_all};
use super::settings::{SceneKey, Settings};
use super::{Args, options};
use crate::cli::drawable::{Drawable, read_places};
use crate::cli::scenes::SceneArg;
use crate::cli::{Usage, progress, remark, say, size_text};
use crate::files::text_of;
use crate::host_memory::OutOfMemory;
use crate::measure::bench::VersionReport;
use crate::pixels::Pixels;

/// Files of a command are missing or wrong.
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
pub(in crate::cli) struct Incomplete(String);

/// The report of `smalto render --verify`.
#[derive(Serialize, JsonSchema)]
pub(in crate::cli) struct Report {
    /// "smalto verify 1".
    format: String,
    smalto: VersionReport,
    /// Number of all files of the command.
    files: usize,
    /// The files that are wrong, in the order of the cameras.
    wrong: Vec<WrongFile>,
}

#[derive(Serialize, JsonSchema)]
struct WrongFile {
    path: String,
    /// colour, alpha, depth, median-depth or counts.
    layer: String,
    /// Position of the camera in its file.
    camera: usize,
    problem: Problem,
    /// The problem in words.
    detail: String,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
enum Problem {
    /// There is no file.
    Missing,
    /// The file is shorter than it was.
    Truncated,
    /// The file cannot be read or decoded, or has other bytes than it had.
    Damaged,
    /// The picture has another size in pixels.
    Size,
    /// A run with other settings drew it.
    Settings,
    /// No record names it.
    Unrecorded,
}

/// Number of files after which the progress is shown: many for every thread.
const AT_ONCE: usize = 1024;

impl Report {
    const FORMAT: &str = "smalto verify 1";
}

impl Problem {
    /// What is said of the files with this problem in the summary.
    fn title(self) -> &'static str {
        match self {
            Self::Missing => "missing",
            Self::Truncated => "truncated",
            Self::Damaged => "damaged",
            Self::Size => "of another size",
            Self::Settings => "of other settings",
            Self::Unrecorded => "in no record",
        }
    }
}

/// Checks the files of the command. Fails if any is wrong.
pub(super) fn verify(args: &Args) -> Result<()> {
    let places = args.place.as_deref();
    let scene = LazyScene { arg: &args.scene, wants_levels: args.knobs.wants_levels(), places, read: OnceCell::new() };
    let plan = plan(args, &|| Ok(scene.get()?.source.focus()))?;
    let Some(folder) = plan.outputs.folder() else {
        return Err(Usage("--verify needs a folder as --output".to_owned()).into());
    };
    let records = read_all(folder)?;
    let key = scene.key(&records)?;
    let (_, options) = options(args, key.is_antialiased, plan.nearest);
    let settings = Settings::of(args, &plan, &key.hash, &options, None)?.without_device();
    let claims = Claims::of(&records, &settings);
    let all: Vec<(&Shot, &Output)> =
        plan.shots.iter().flat_map(|shot| shot.outputs.iter().map(move |output| (shot, output))).collect();
    let wrong = wrong(&all, &claims, folder)?;
    wrong.iter().try_for_each(|wrong| say!("{}: {}", wrong.path, wrong.detail))?;
    let outcome = summary(&wrong, all.len());
    if let Some(sink) = &args.json {
        let (format, smalto) = (Report::FORMAT.to_owned(), VersionReport::current());
        sink.write_json(&Report { format, smalto, files: all.len(), wrong })?;
    }
    let summary = outcome?;
    claims.note_devices();
    say!("{summary}")?;
    plan.command.as_ref().map_or(Ok(()), |command| say!("{command}"))
}

fn summary(wrong: &[WrongFile], all: usize) -> Result<String, Incomplete> {
    if wrong.is_empty() {
        return Ok(format!("all {all} files are complete"));
    }
    let mut counts: BTreeMap<Problem, usize> = BTreeMap::new();
    wrong.iter().for_each(|wrong| *counts.entry(wrong.problem).or_default() += 1);
    let counts: Vec<String> = counts.iter().map(|(problem, count)| format!("{count} {}", problem.title())).collect();
    let is_all_missing = wrong.iter().all(|wrong| wrong.problem == Problem::Missing);
    let advice = if is_all_missing { "--resume draws them" } else { "remove them, and --resume draws them again" };
    Err(Incomplete(format!("{} of {all} files are wrong: {}; {advice}", wrong.len(), counts.join(", "))))
}

/// The files that are wrong. All threads read files at once.
fn wrong(all: &[(&Shot, &Output)], claims: &Claims, folder: &Path) -> Result<Vec<WrongFile>> {
    let check = |(shot, output): &(&Shot, &Output)| {
        let named = |(problem, detail)| {
            let (path, layer) = (text_of(&output.path), output.layer.name());
            WrongFile { path, layer, camera: shot.index, problem, detail }
        };
        Ok(claims.problem(output, folder, shot.camera.size_px)?.map(named))
    };
    let (bar, mut wrong) = (progress::Bar::new("verifying"), Vec::new());
    for (number, part) in all.chunks(AT_ONCE).enumerate() {
        bar.set((number * AT_ONCE) as f64 / all.len() as f64);
        let found: Result<Vec<Option<WrongFile>>> = part.par_iter().map(check).collect();
        wrong.extend(found?.into_iter().flatten());
    }
    Ok(wrong)
}

/// What the records of a folder say of its files.
struct Claims<'r> {
    /// Of runs with the settings of the command.
    same: Vec<&'r Recorded>,
    /// Of other runs, each with the settings that differ.
    other: Vec<(&'r Recorded, String)>,
}

impl<'r> Claims<'r> {
    fn of(records: &'r [Recorded], settings: &Settings) -> Self {
        let mut claims = Self { same: Vec::new(), other: Vec::new() };
        for record in records {
            match settings.differences(&record.settings) {
                differing if differing.is_empty() => claims.same.push(record),
                differing => claims.other.push((record, differing.join(", "))),
            }
        }
        claims
    }

    /// What is wrong with a file, if anything.
    ///
    /// # Errors
    /// [`OutOfMemory`] if there is no memory to decode it.
    fn problem(&self, output: &Output, folder: &Path, size_px: [u32; 2]) -> Result<Option<(Problem, String)>> {
        let (path, name) = (&output.path, output.within(folder));
        let found = |problem: Problem, detail: String| Ok(Some((problem, detail)));
        if !path.exists() {
            return found(Problem::Missing, "missing".to_owned());
        }
        let content = match Content::of(path) {
            Ok(content) => content,
            Err(why) => return found(Problem::Damaged, format!("damaged: {why:#}")),
        };
        let ours: Vec<&Content> = self.same.iter().filter_map(|record| record.files.get(name)).collect();
        let is_ours = ours.contains(&&content);
        let theirs = self.other.iter().find(|(record, _)| record.files.get(name) == Some(&content));
        if let Some((_, why)) = theirs.filter(|_| !is_ours) {
            return found(Problem::Settings, format!("of other settings ({why})"));
        }
        if is_ours {
            return Ok(None);
        }
        let longer = ours.iter().find(|claim| content.bytes < claim.bytes);
        match (Pixels::read(path), longer) {
            (Err(why), None) if why.is::<OutOfMemory>() && ours.is_empty() => {
                Err(why.context(path.display().to_string()))
            }
            (Ok(pixels), _) if pixels.size != size_px => {
                let [size, expected] = [pixels.size, size_px].map(size_text);
                found(Problem::Size, format!("of {size} pixels, not {expected}"))
            }
            (Err(_), Some(claim)) => {
                found(Problem::Truncated, format!("truncated: {} of {} bytes", content.bytes, claim.bytes))
            }
            (Err(why), None) => found(Problem::Damaged, format!("damaged: {why:#}")),
            (Ok(_), _) if ours.is_empty() => found(Problem::Unrecorded, "in no record of these settings".to_owned()),
            (Ok(_), _) => found(Problem::Damaged, "damaged: its bytes are not those that were written".to_owned()),
        }
    }

    /// Says so if several devices drew the files. Their pictures may differ in the last bits.
    fn note_devices(&self) {
        let devices: BTreeSet<&str> = self.same.iter().filter_map(|record| record.settings.device()).collect();
        if devices.len() > 1 {
            let devices: Vec<&str> = devices.into_iter().collect();
            remark(&format!("note: drawn by {} devices: {}", devices.len(), devices.join(", ")));
        }
    }
}

/// A scene that is read when it is needed.
struct LazyScene<'a> {
    arg: &'a SceneArg,
    wants_levels: bool,
    places: Option<&'a Path>,
    read: OnceCell<Drawable>,
}

impl LazyScene<'_> {
    fn get(&self) -> Result<&Drawable> {
        if self.read.get().is_none() {
            _ = self.read.set(Drawable::read(self.arg, self.wants_levels, None)?.placed(read_places(self.places)?));
        }
        self.read.get().ok_or_else(|| anyhow!("the scene was not kept"))
    }

    /// What settings depend on. The scene is read for it, unless all records are of the scene file as it is now.
    fn key(&self, records: &[Recorded]) -> Result<SceneKey> {
        if records.is_empty() {
            return Ok(SceneKey { hash: String::new(), is_antialiased: false });
        }
        let file = self.arg.file();
        let recorded = |record: &Recorded| record.settings.scene(file.as_ref()?);
        let keys: Option<Vec<SceneKey>> = records.iter().map(recorded).collect();
        let agree = |keys: &Vec<SceneKey>| keys.iter().all(|key| key.hash == keys[0].hash);
        if let Some(key) = keys.filter(agree).and_then(|keys| keys.into_iter().next()) {
            return Ok(key);
        }
        let scene = self.get()?;
        let hash = scene.report().hash;
        Ok(SceneKey { hash, is_antialiased: scene.source.is_antialiased })
    }
}
