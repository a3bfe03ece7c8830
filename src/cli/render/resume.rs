//! The record of a run into a folder, for `--resume`: the settings of the run and the files that are complete. While
//! the run lasts, it is locked, so that no second run writes into the folder.

use std::collections::BTreeMap;
use std::fs::{File, OpenOptions};
use std::io::{Read, Seek, Write};
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, anyhow, bail, ensure};
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};

use super::outputs::Output;
use super::{Args, Plan};
use crate::camera::Camera;
use crate::cli::{Usage, remark};
use crate::files::{check_absent, check_binary_writable, describe, lock};
use crate::measure::bench::{SceneReport, Subject, VersionReport};
use crate::options::Options;
use crate::pixels::FileKind;
use crate::rules::Background;
use crate::scene::Gaussians;

/// The name of the record, hidden from programs that read all pictures of a folder. Its first line holds the settings;
/// each further line names a complete file, and the last line of a complete run is [`COMPLETE`].
const NAME: &str = ".smalto-run.jsonl";

/// The last line of the record of a complete run.
const COMPLETE: &str = "\"complete\"";

/// Longest record that is read: enough for a million files.
const MOST_BYTES: u64 = 1 << 28;

/// Everything that determines the pictures.
#[derive(Serialize)]
struct How {
    program: VersionReport,
    scene: String,
    cameras: String,
    files: String,
    options: Options,
    background: Option<[f32; 3]>,
    format: FileKind,
    device: Option<String>,
}

/// A complete file. One of another size was damaged since, and is drawn again.
#[derive(Serialize, Deserialize)]
struct Line {
    /// Relative to the folder of the run.
    file: PathBuf,
    bytes: u64,
}

/// The files of a run that are complete.
pub(super) struct Record {
    folder: PathBuf,
    /// Sizes in bytes by paths relative to the folder.
    done: BTreeMap<PathBuf, u64>,
    /// `None` if the output is not a folder. Open, it is locked.
    file: Option<File>,
    /// The last line is [`COMPLETE`].
    is_ended: bool,
}

impl Record {
    /// Begins the record of `plan`, or continues it with `--resume`. `device` is `None` for the reference.
    ///
    /// Fails if another run writes into the folder, or a file of the plan cannot be written.
    pub fn begin(
        args: &Args,
        plan: &Plan,
        gaussians: &Gaussians,
        options: &Options,
        device: Option<&str>,
    ) -> Result<Self> {
        let Some(folder) = plan.outputs.folder() else {
            let record = Self { folder: PathBuf::new(), done: BTreeMap::new(), file: None, is_ended: false };
            record.check_outputs(args, plan)?;
            return Ok(record);
        };
        let how = How::of(args, plan, gaussians, options, device)?;
        let path = folder.join(NAME);
        let file = OpenOptions::new().read(true).append(true).create(true).open(&path);
        let mut file = file.map_err(|error| anyhow!("cannot write {}: {}", path.display(), describe(&error)))?;
        lock(&file).with_context(|| folder.display().to_string())?;
        let earlier = read(&mut file).with_context(|| format!("{} cannot be read", path.display()))?;
        let is_complete = earlier.lines().last() == Some(COMPLETE);
        let is_resumed = args.resume && !earlier.is_empty();
        let done = if is_resumed { resumed(&earlier, &how, folder)? } else { BTreeMap::new() };
        let mut record =
            Self { folder: folder.to_owned(), done, file: Some(file), is_ended: is_resumed && is_complete };
        let is_fresh = if args.resume && earlier.is_empty() { check_fresh(plan) } else { Ok(()) };
        if let Err(error) = is_fresh.and_then(|()| record.check_outputs(args, plan)) {
            if earlier.is_empty() {
                _ = std::fs::remove_file(&path);
            }
            return Err(error);
        }
        if !is_resumed {
            if !earlier.is_empty() && !is_complete {
                let folder = folder.display();
                remark(&format!("note: {folder}: starting over; --resume would continue the unfinished run"));
            }
            record.restart(&how)?;
        } else if !earlier.ends_with('\n') {
            record.append(&[])?;
        }
        if args.resume {
            let files = plan.shots.iter().flat_map(|shot| &shot.outputs);
            let (all, folder) = (files.clone().count(), folder.display());
            match files.filter(|output| record.has(output)).count() {
                done if done == all => {
                    remark(&format!("note: {folder}: nothing left to do, all {all} files are complete"))
                }
                done => remark(&format!("note: {folder}: {done} of {all} files are complete and are skipped")),
            }
        }
        Ok(record)
    }

    /// True if the file is complete and has the size that it had then.
    pub fn has(&self, output: &Output) -> bool {
        let name = output.path.strip_prefix(&self.folder).unwrap_or(&output.path);
        let data = output.path.metadata();
        self.done.get(name).is_some_and(|bytes| data.is_ok_and(|data| data.is_file() && data.len() == *bytes))
    }

    /// Records that a file is complete.
    pub fn add(&mut self, output: &Output) -> Result<()> {
        if self.file.is_none() {
            return Ok(());
        }
        let file = output.path.strip_prefix(&self.folder)?.to_owned();
        let bytes = output.path.metadata().map_or(0, |data| data.len());
        self.append(&serde_json::to_vec(&Line { file, bytes })?)
    }

    /// Records that the run is complete.
    pub fn finish(mut self) -> Result<()> {
        if self.file.is_none() || self.is_ended { Ok(()) } else { self.append(COMPLETE.as_bytes()) }
    }

    fn restart(&mut self, how: &Map<String, Value>) -> Result<()> {
        if let Some(file) = &self.file {
            file.set_len(0).map_err(|error| self.failed(&error))?;
        }
        self.append(&serde_json::to_vec(how)?)
    }

    /// Adds a line in one write, so that an incomplete line can only be the last one.
    fn append(&mut self, line: &[u8]) -> Result<()> {
        self.is_ended = false;
        let written = self.file.as_mut().map_or(Ok(()), |file| file.write_all(&[line, b"\n"].concat()));
        written.map_err(|error| self.failed(&error))
    }

    fn failed(&self, error: &std::io::Error) -> anyhow::Error {
        anyhow!("cannot write {}: {}", self.folder.join(NAME).display(), describe(error))
    }

    /// Fails before anything is drawn if a file cannot be written, or exists and `--no-clobber` keeps it.
    fn check_outputs(&self, args: &Args, plan: &Plan) -> Result<()> {
        let left = || plan.shots.iter().flat_map(|shot| &shot.outputs).filter(|output| !self.has(output));
        if args.no_clobber {
            let certificates = plan.shots.iter().filter_map(|shot| shot.certificate.as_deref());
            left().map(|output| output.path.as_path()).chain(certificates).try_for_each(check_absent)?;
            if let Some(folder) = args.dump.as_deref().filter(|folder| folder.exists()) {
                let is_empty = folder.read_dir().is_ok_and(|mut entries| entries.next().is_none());
                ensure!(is_empty, "--dump {}: it exists, and --no-clobber keeps what exists", folder.display());
            }
        }
        // What does not exist yet can be written if another file there can.
        let mut new = left().filter(|output| !output.path.exists());
        let existing = left().filter(|output| output.path.exists());
        existing.chain(new.next()).try_for_each(|output| check_binary_writable(&output.path))
    }
}

impl How {
    fn of(
        args: &Args,
        plan: &Plan,
        gaussians: &Gaussians,
        options: &Options,
        device: Option<&str>,
    ) -> Result<Map<String, Value>> {
        let views: Vec<Camera> = plan.shots.iter().map(|shot| shot.camera.clone()).collect();
        let scene = SceneReport::of(args.scene.title(), gaussians);
        let subject = Subject::new(&scene, "", options, &views);
        let mut files = blake3::Hasher::new();
        for output in plan.shots.iter().flat_map(|shot| &shot.outputs) {
            let name =
                plan.outputs.folder().map_or(Ok(output.path.as_path()), |folder| output.path.strip_prefix(folder))?;
            files.update(name.as_os_str().as_encoded_bytes()).update(&[0]);
        }
        let how = Self {
            program: VersionReport::current(),
            scene: subject.scene.hash,
            cameras: subject.views_hash,
            files: files.finalize().to_hex().to_string(),
            options: *options,
            background: match args.background {
                Background::Colour(colour) => Some(colour),
                Background::Transparent => None,
            },
            format: plan.outputs.kind(),
            device: device.map(str::to_owned),
        };
        match serde_json::to_value(how)? {
            Value::Object(members) => Ok(members),
            other => bail!("the settings of a run are not a JSON object: {other}"),
        }
    }
}

/// Reads the record of an earlier run; empty if there was none.
fn read(file: &mut File) -> Result<String> {
    file.rewind()?;
    let mut text = String::new();
    file.take(MOST_BYTES + 1).read_to_string(&mut text)?;
    ensure!(text.len() as u64 <= MOST_BYTES, "the file is longer than {MOST_BYTES} bytes");
    Ok(text)
}

/// The files that an earlier run completed. Fails if that run had other settings.
fn resumed(text: &str, how: &Map<String, Value>, folder: &Path) -> Result<BTreeMap<PathBuf, u64>> {
    let mut lines = text.lines();
    let first: Map<String, Value> = lines
        .next()
        .and_then(|line| serde_json::from_str(line).ok())
        .with_context(|| format!("{} is damaged: run without --resume to start over", folder.join(NAME).display()))?;
    let other: Vec<&str> =
        how.iter().filter(|(key, value)| first.get(*key) != Some(value)).map(|(key, _)| key.as_str()).collect();
    if !other.is_empty() {
        let (folder, other) = (folder.display(), other.join(", "));
        return Err(Usage(format!(
            "--resume: the run in {folder} had other settings ({other}); run without --resume to start over"
        ))
        .into());
    }
    // A line may be incomplete; its file is drawn again. Of two lines about a file, the later one holds.
    let files = lines.filter_map(|line| serde_json::from_str::<Line>(line).ok());
    Ok(files.map(|line| (line.file, line.bytes)).collect())
}

/// Fails if an output exists although there is no record.
fn check_fresh(plan: &Plan) -> Result<()> {
    match plan.shots.iter().flat_map(|shot| &shot.outputs).find(|output| output.path.exists()) {
        Some(output) => Err(Usage(format!(
            "--resume: {} exists, but there is no record of a run; run without --resume to start over",
            output.path.display()
        ))
        .into()),
        None => Ok(()),
    }
}
