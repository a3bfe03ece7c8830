//! `--resume`: the record of a run into a folder. It exists while the run lasts, so after an interruption it lists the
//! complete files and the settings of the run.

use std::collections::BTreeSet;
use std::fs::{self, File, OpenOptions};
use std::io::{ErrorKind, Read, Write};
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail, ensure};
use serde::Serialize;
use serde_json::{Map, Value};

use super::outputs::Output;
use super::{Args, Plan};
use crate::camera::Camera;
use crate::cli::{Usage, remark};
use crate::files::write_whole;
use crate::measure::bench::{SceneReport, Subject, VersionReport};
use crate::options::Options;
use crate::pixels::FileKind;
use crate::rules::Background;
use crate::scene::Gaussians;

/// The name of the record, hidden from programs that read all pictures of a folder. Its first line holds the settings;
/// each further line names a complete file.
const NAME: &str = ".smalto-run.jsonl";

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

/// The files of a run that are complete.
pub(super) struct Record {
    folder: PathBuf,
    done: BTreeSet<PathBuf>,
    /// `None` if the output is not a folder.
    file: Option<File>,
}

impl Record {
    /// Begins the record of `plan`, or continues it with `--resume`. `device` is `None` for the reference.
    pub fn begin(
        args: &Args,
        plan: &Plan,
        gaussians: &Gaussians,
        options: &Options,
        device: Option<&str>,
    ) -> Result<Self> {
        let Some(folder) = plan.outputs.folder() else {
            return Ok(Self { folder: PathBuf::new(), done: BTreeSet::new(), file: None });
        };
        let how = How::of(args, plan, gaussians, options, device)?;
        let path = folder.join(NAME);
        let earlier = read(&path).with_context(|| format!("{} cannot be read", path.display()))?;
        let done = match earlier {
            Some(text) if args.resume => resumed(&text, &how, folder)?,
            None if args.resume => fresh(plan)?,
            Some(_) => {
                let folder = folder.display();
                remark(&format!("note: {folder}: starting over; --resume would continue the unfinished run"));
                BTreeSet::new()
            }
            None => BTreeSet::new(),
        };
        write_whole(&path, |file| {
            write_line(file, &how)?;
            done.iter().try_for_each(|name| write_line(file, name))
        })?;
        let file = OpenOptions::new().append(true).open(&path);
        let file = file.with_context(|| format!("cannot write {}", path.display()))?;
        let mut record = Self { folder: folder.to_owned(), done: BTreeSet::new(), file: Some(file) };
        record.done = done.into_iter().map(|name| folder.join(name)).filter(|path| path.is_file()).collect();
        if args.resume {
            let (done, folder) = (record.done.len(), folder.display());
            let files: usize = plan.shots.iter().map(|shot| shot.outputs.len()).sum();
            remark(&format!("note: {folder}: {done} of {files} files are complete and are skipped"));
        }
        Ok(record)
    }

    pub fn has(&self, output: &Output) -> bool {
        self.done.contains(&output.path)
    }

    /// Records that a file is complete.
    pub fn add(&mut self, output: &Output) -> Result<()> {
        let Some(file) = &mut self.file else { return Ok(()) };
        let name = output.path.strip_prefix(&self.folder)?;
        // One write, so that an incomplete line can only be the last one.
        let mut line = serde_json::to_vec(name)?;
        line.push(b'\n');
        file.write_all(&line).with_context(|| format!("cannot write {}", self.folder.join(NAME).display()))
    }

    /// Removes the record: the run is complete.
    pub fn finish(self) -> Result<()> {
        if self.file.is_some() {
            let path = self.folder.join(NAME);
            fs::remove_file(&path).with_context(|| format!("cannot remove {}", path.display()))?;
        }
        Ok(())
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

fn write_line(file: &mut impl Write, line: &impl Serialize) -> Result<()> {
    serde_json::to_writer(&mut *file, line)?;
    Ok(file.write_all(b"\n")?)
}

/// Reads the record of an unfinished run; `None` if there is none.
fn read(path: &Path) -> Result<Option<String>> {
    let file = match File::open(path) {
        Err(error) if error.kind() == ErrorKind::NotFound => return Ok(None),
        file => file?,
    };
    let mut text = String::new();
    file.take(MOST_BYTES + 1).read_to_string(&mut text)?;
    ensure!(text.len() as u64 <= MOST_BYTES, "the file is longer than {MOST_BYTES} bytes");
    Ok(Some(text))
}

/// The names of the files that an earlier run completed. Fails if that run had other settings.
fn resumed(text: &str, how: &Map<String, Value>, folder: &Path) -> Result<BTreeSet<PathBuf>> {
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
    // The last line may be incomplete; its file is drawn again.
    Ok(lines.filter_map(|line| serde_json::from_str(line).ok()).collect())
}

/// Fails if an output exists although there is no record.
fn fresh(plan: &Plan) -> Result<BTreeSet<PathBuf>> {
    match plan.shots.iter().flat_map(|shot| &shot.outputs).find(|output| output.path.exists()) {
        Some(output) => Err(Usage(format!(
            "--resume: {} exists, but there is no unfinished run; run without --resume to start over",
            output.path.display()
        ))
        .into()),
        None => Ok(BTreeSet::new()),
    }
}
