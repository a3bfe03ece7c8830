//! Reads the streamed SOG of PlayCanvas. The leaves of the tree in `lod-meta.json` name their Gaussians in SOG files
//! for every level of detail. One whole level is read, with the environment that belongs to all levels.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use anyhow::{Context, Result, ensure};
use serde::Deserialize;

use super::files::Files;
use super::unit::{Unit, decode_all};
use crate::formats::input::Input;
use crate::formats::linked_file::inside;
use crate::scene::{Cancelled, NoLevel, Scene, SceneLevel, Watch};

/// Largest `lod-meta.json` in bytes.
pub(crate) const MAX_BYTES: u64 = 1 << 28;

#[derive(Deserialize)]
struct Written {
    #[serde(rename = "lodLevels")]
    levels: Option<u32>,
    filenames: Vec<String>,
    environment: Option<String>,
    tree: Node,
}

#[derive(Deserialize)]
struct Node {
    #[serde(default)]
    children: Vec<Node>,
    /// The Gaussians of a leaf by level, 0 the finest.
    #[serde(default)]
    lods: BTreeMap<u32, Range>,
}

#[derive(Deserialize)]
struct Range {
    file: usize,
    count: u64,
}

impl Node {
    fn leaves<'n>(&'n self, visit: &mut impl FnMut(&'n BTreeMap<u32, Range>)) {
        visit(&self.lods);
        self.children.iter().for_each(|child| child.leaves(visit));
    }
}

pub(crate) fn read(input: &mut Input, json: &[u8], folder: &Path, level: Option<u32>, watch: &Watch) -> Result<Scene> {
    let written: Written = serde_json::from_slice(json).context("lod-meta.json is not that of a streamed SOG")?;
    let mut levels = BTreeMap::<u32, u64>::new();
    written.tree.leaves(&mut |lods| {
        for (level, range) in lods {
            let count = levels.entry(*level).or_default();
            *count = count.saturating_add(range.count);
        }
    });
    let finest = *levels.keys().next().context("the tree in lod-meta.json has no Gaussians")?;
    // Levels are numbered from 0.
    let last = levels.keys().next_back().map_or(0, |last| u64::from(*last) + 1);
    let claimed = written.levels.map_or(0, u64::from);
    ensure!(claimed <= last, "lod-meta.json claims {claimed} levels, its tree has {last}");
    let level = level.unwrap_or(finest);
    let numbers = || levels.keys().map(u32::to_string).collect::<Vec<_>>().join(", ");
    let is_there = levels.contains_key(&level);
    ensure!(is_there, NoLevel::of(format!("there is no level {level} in lod-meta.json, only {}", numbers())));
    // Number of Gaussians of the level in each file.
    let mut counts = BTreeMap::<usize, u64>::new();
    written.tree.leaves(&mut |lods| {
        if let Some(range) = lods.get(&level) {
            let count = counts.entry(range.file).or_default();
            *count = count.saturating_add(range.count);
        }
    });
    let (mut units, mut names) = (Vec::new(), BTreeSet::new());
    for (file, count) in counts {
        ensure!(!(watch.is_cancelled)(), Cancelled);
        let name = written.filenames.get(file);
        let name = name.with_context(|| format!("lod-meta.json names file {file} of {}", written.filenames.len()))?;
        ensure!(names.insert(name), "lod-meta.json names {name} twice");
        let unit = open(folder, name, watch)?;
        ensure!(
            unit.meta.count as u64 == count,
            "{name} has {} Gaussians, of which lod-meta.json assigns {count} to level {level}; files of several levels \
             are not supported",
            unit.meta.count
        );
        units.push(unit);
    }
    let mut environment = 0;
    if let Some(name) = &written.environment {
        let unit = open(folder, name, watch)?;
        environment = unit.meta.count as u64;
        units.push(unit);
    }
    let levels =
        levels.iter().map(|(level, count)| SceneLevel { level: *level, gaussians: count.saturating_add(environment) });
    let of = written.levels.map_or_else(String::new, |levels| format!(" of {levels}"));
    let scene = decode_all(input, units, format!("streamed SOG, level {level}{of}"), watch)?;
    Ok(Scene { levels: levels.collect(), ..scene })
}

/// Opens a SOG file below the folder: a `meta.json` or an archive.
fn open(folder: &Path, name: &str, watch: &Watch) -> Result<Unit> {
    let path = inside(folder, name)?;
    let unit = || {
        if name.ends_with(".sog") {
            let quiet = Watch { progress: &|_| {}, ..*watch };
            return Unit::open(Files::archive(&mut Input::open(&path, &quiet)?)?, "meta.json");
        }
        let (folder, json) =
            name.rsplit_once('/').map_or((folder.to_owned(), name), |(f, json)| (folder.join(f), json));
        Unit::open(Files::Folder(folder), json)
    };
    unit().with_context(|| name.to_owned())
}
