//! The record of a run into a folder, for `--resume`: the settings of the run and the files that are complete. While
//! the run lasts, it is locked, so that no second run writes the same files. Each shard has a record of its own.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{Seek, Write};
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, anyhow, ensure};

use super::Args;
use super::outputs::Output;
use super::plan::Plan;
use super::records::{COMPLETE, Content, Line, Recorded, complete, name, read, read_all};
use super::settings::Settings;
use crate::cli::{Usage, remark};
use crate::files::{append_own, check_absent, check_binary_writable, describe, lock};
use crate::options::Options;
use crate::pixels::Pixels;
use crate::scene::Unreadable;

/// The files of a run that are complete.
pub(super) struct Record {
    folder: PathBuf,
    /// The file of the record.
    path: PathBuf,
    /// Sizes in bytes by paths relative to the folder.
    done: BTreeMap<PathBuf, u64>,
    /// `None` if the output is not a folder. Open, it is locked.
    file: Option<File>,
    /// The last line is [`COMPLETE`].
    is_ended: bool,
}

impl Record {
    /// Begins the record of `plan`, or continues it with `--resume`. `scene` is the hash of the scene; `device` is
    /// `None` for the reference.
    ///
    /// Fails if another run writes into the folder, or a file of the plan cannot be written.
    pub fn begin(args: &Args, plan: &Plan, scene: &str, options: &Options, device: Option<&str>) -> Result<Self> {
        let Some(folder) = plan.outputs.folder() else {
            let (folder, path) = (PathBuf::new(), PathBuf::new());
            let record = Self { folder, path, done: BTreeMap::new(), file: None, is_ended: false };
            record.check_outputs(args, plan)?;
            return Ok(record);
        };
        let settings = Settings::of(args, plan, scene, options, device)?;
        let path = folder.join(name(args.shard));
        let mut file = append_own(&path).with_context(|| format!("cannot write {}", path.display()))?;
        lock(&file).with_context(|| folder.display().to_string())?;
        file.rewind()?;
        let earlier = read(&mut file).map_err(|problem| Unreadable::new(&path, &problem))?;
        let is_complete = earlier.lines().last() == Some(COMPLETE);
        let is_resumed = args.resume && !earlier.is_empty();
        let mut record = Self {
            folder: folder.to_owned(),
            path,
            done: BTreeMap::new(),
            file: Some(file),
            is_ended: is_resumed && is_complete,
        };
        if let Err(error) =
            record.resume(args, plan, &settings, &earlier).and_then(|()| record.check_outputs(args, plan))
        {
            if earlier.is_empty() {
                _ = std::fs::remove_file(&record.path);
            }
            return Err(error);
        }
        if !is_resumed {
            if !earlier.is_empty() && !is_complete {
                let folder = folder.display();
                remark(&format!("note: {folder}: starting over; --resume would continue the unfinished run"));
            }
            record.restart(&settings)?;
        } else if !earlier.ends_with('\n') {
            record.append(&[])?;
        }
        if args.resume {
            record.announce(plan);
        }
        Ok(record)
    }

    /// Finds what is complete, with `--resume`. `earlier` is the text of the own record.
    fn resume(&mut self, args: &Args, plan: &Plan, settings: &Settings, earlier: &str) -> Result<()> {
        if !args.resume {
            return Ok(());
        }
        if !earlier.is_empty() {
            let damaged = || Unreadable {
                path: self.path.display().to_string(),
                problem: "is damaged: run without --resume to start over".to_owned(),
            };
            let own = Recorded::parse(earlier).ok_or_else(damaged)?;
            check_same(settings, &own, &self.folder)?;
        }
        let records = read_all(&self.folder)?;
        if earlier.is_empty() {
            check_fresh(plan, &records, settings, &self.folder)?;
        }
        let outputs: Vec<&Output> = plan.files().collect();
        self.done = complete(&records, settings, &self.folder, &outputs);
        Ok(())
    }

    /// Says how many files are complete.
    fn announce(&self, plan: &Plan) {
        let files = plan.files();
        let (all, folder) = (files.clone().count(), self.folder.display());
        match files.filter(|output| self.has(output)).count() {
            _ if all == 0 => {}
            done if done == all => {
                remark(&format!("note: {folder}: nothing left to do, all {all} files have their recorded sizes"));
            }
            done => remark(&format!("note: {folder}: {done} of {all} files have their recorded sizes and are skipped")),
        }
    }

    /// True if the file is complete and has the size that it had then.
    pub fn has(&self, output: &Output) -> bool {
        let data = output.path.metadata();
        self.done
            .get(output.within(&self.folder))
            .is_some_and(|bytes| data.is_ok_and(|data| data.is_file() && data.len() == *bytes))
    }

    /// True if there is a record of this run.
    pub fn is_kept(&self) -> bool {
        self.file.is_some()
    }

    /// Records that a file is complete.
    pub fn add(&mut self, output: &Output, content: Content) -> Result<()> {
        if !self.is_kept() {
            return Ok(());
        }
        self.append(&serde_json::to_vec(&Line { file: output.within(&self.folder).to_owned(), content })?)
    }

    /// Records that the run is complete.
    pub fn finish(mut self) -> Result<()> {
        if self.file.is_none() || self.is_ended { Ok(()) } else { self.append(COMPLETE.as_bytes()) }
    }

    fn restart(&mut self, settings: &Settings) -> Result<()> {
        if let Some(file) = &self.file {
            file.set_len(0).map_err(|error| self.failed(&error))?;
        }
        self.append(&serde_json::to_vec(settings)?)
    }

    /// Adds a line in one write, so that an incomplete line can only be the last one.
    fn append(&mut self, line: &[u8]) -> Result<()> {
        self.is_ended = false;
        let written = self.file.as_mut().map_or(Ok(()), |file| file.write_all(&[line, b"\n"].concat()));
        written.map_err(|error| self.failed(&error))
    }

    fn failed(&self, error: &std::io::Error) -> anyhow::Error {
        anyhow!("cannot write {}: {}", self.path.display(), describe(error))
    }

    /// Fails before anything is drawn if a file cannot be written, or exists and `--no-clobber` keeps it.
    fn check_outputs(&self, args: &Args, plan: &Plan) -> Result<()> {
        let left = || plan.files().filter(|output| !self.has(output));
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

/// Fails if a run had other settings.
fn check_same(settings: &Settings, run: &Recorded, folder: &Path) -> Result<(), Usage> {
    let other = settings.differences(&run.settings);
    if other.is_empty() {
        return Ok(());
    }
    let (folder, other) = (folder.display(), other.join(", "));
    Err(Usage(format!(
        "--resume: the run in {folder} had other settings ({other}); run without --resume to start over"
    )))
}

/// Fails if an output exists that no run with these settings completed or may have drawn.
fn check_fresh(plan: &Plan, records: &[Recorded], settings: &Settings, folder: &Path) -> Result<(), Usage> {
    let has_run = records.iter().any(|run| settings.differences(&run.settings).is_empty());
    let all = plan.shots.iter().flat_map(|shot| shot.outputs.iter().map(move |output| (shot, output)));
    for (shot, output) in all.filter(|(_, output)| output.path.exists()) {
        let of_runs = || records.iter().filter(|record| record.files.contains_key(output.within(folder)));
        match of_runs().find(|record| settings.differences(&record.settings).is_empty()).or_else(|| of_runs().next()) {
            Some(run) => check_same(settings, run, folder)?,
            // A run was stopped before it recorded this picture, which is drawn again.
            None if has_run && Pixels::read(&output.path).is_ok_and(|old| old.size == shot.camera.size_px) => {}
            None => {
                let file = output.path.display();
                let why = "exists, but there is no record of a run; run without --resume to start over";
                return Err(Usage(format!("--resume: {file} {why}")));
            }
        }
    }
    Ok(())
}
