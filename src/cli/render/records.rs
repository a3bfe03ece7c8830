//! The records in a folder of pictures. Each run has its own, and so has each shard, so that they can run at the same
//! time. Of what is drawn, all records with the same settings speak together.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{ErrorKind, Read};
use std::path::{Path, PathBuf};

use anyhow::{Result, anyhow, ensure};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::outputs::Output;
use super::settings::Settings;
use super::shard::Shard;
use crate::files::{describe, hash_of, read_own};
use crate::scene::Unreadable;

/// How the names of records begin and end. They are hidden from programs that read all pictures of a folder.
const NAME: [&str; 2] = [".smalto-run", ".jsonl"];

/// The last line of the record of a complete run.
pub(super) const COMPLETE: &str = "\"complete\"";

/// Longest record that is read: enough for a million files.
const MOST_BYTES: u64 = 1 << 28;

/// A line about a complete file.
#[derive(Serialize, Deserialize)]
pub(super) struct Line {
    /// Relative to the folder of the run.
    pub file: PathBuf,
    #[serde(flatten)]
    pub content: Content,
}

/// The content of a file when it was complete.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub(super) struct Content {
    pub bytes: u64,
    /// BLAKE3
    pub hash: String,
}

/// A record. The first line has the settings, each further line names a complete file, and the last line of a complete
/// run is [`COMPLETE`].
pub(super) struct Recorded {
    pub settings: Settings,
    pub files: BTreeMap<PathBuf, Content>,
}

/// The name of the record of a whole run or of a shard.
pub(super) fn name(shard: Option<Shard>) -> String {
    let [start, end] = NAME;
    let shard = shard.map_or_else(String::new, |shard| format!(".{}", shard.to_string().replace('/', "-of-")));
    format!("{start}{shard}{end}")
}

/// The text of a record.
pub(super) fn read(file: &mut File) -> Result<String> {
    let mut text = String::new();
    let read = file.take(MOST_BYTES + 1).read_to_string(&mut text);
    read.map_err(|error| anyhow!("cannot be read: {}", describe(&error)))?;
    ensure!(text.len() as u64 <= MOST_BYTES, "the file is longer than {MOST_BYTES} bytes");
    Ok(text)
}

/// All readable records in a folder; none if there is no such folder.
///
/// # Errors
/// If the folder or a record cannot be read.
pub(super) fn read_all(folder: &Path) -> Result<Vec<Recorded>> {
    let mut found = Vec::new();
    let entries = match folder.read_dir() {
        Err(error) if error.kind() == ErrorKind::NotFound => return Ok(found),
        entries => entries.map_err(|error| anyhow!("{}: {}", folder.display(), describe(&error)))?,
    };
    for entry in entries {
        let name = entry?.file_name();
        let is_record = |name: &str| name.starts_with(NAME[0]) && name.ends_with(NAME[1]);
        if name.to_str().is_some_and(is_record) {
            let path = folder.join(name);
            let text = read_own(&path).and_then(|mut file| read(&mut file));
            found.extend(Recorded::parse(&text.map_err(|problem| Unreadable::new(&path, &problem))?));
        }
    }
    Ok(found)
}

impl Recorded {
    /// Parses a record; `None` if its first line is damaged.
    pub fn parse(text: &str) -> Option<Self> {
        let mut lines = text.lines();
        let settings = serde_json::from_str(lines.next()?).ok()?;
        // A line may be incomplete; its file is drawn again. Of two lines about a file, the later one holds.
        let files = lines.filter_map(|line| serde_json::from_str::<Line>(line).ok());
        Some(Self { settings, files: files.map(|line| (line.file, line.content)).collect() })
    }
}

impl Content {
    /// The content of a file now.
    ///
    /// # Errors
    /// A clause without the file's name if it cannot be read.
    pub fn of(path: &Path) -> Result<Self> {
        let (bytes, hash) = hash_of(path, || Ok(()))?;
        Ok(Self { bytes, hash })
    }
}

/// Those of the outputs that runs with these settings completed, with their sizes in bytes. Where several runs have
/// written into the folder, the content of a file decides whether it is still theirs: another run may have been stopped
/// before it recorded what it wrote.
pub(super) fn complete(
    records: &[Recorded],
    settings: &Settings,
    folder: &Path,
    outputs: &[&Output],
) -> BTreeMap<PathBuf, u64> {
    let same: Vec<_> = records.iter().filter(|record| settings.differences(&record.settings).is_empty()).collect();
    let is_whole = |output: &Output, content: &Content| {
        let is_long = output.path.metadata().is_ok_and(|data| data.len() == content.bytes);
        is_long && (records.len() == 1 || Content::of(&output.path).is_ok_and(|now| now == *content))
    };
    let find = |output: &&Output| {
        let name = output.within(folder);
        let content =
            same.iter().filter_map(|record| record.files.get(name)).find(|content| is_whole(output, content))?;
        Some((name.to_owned(), content.bytes))
    };
    outputs.par_iter().filter_map(find).collect()
}
