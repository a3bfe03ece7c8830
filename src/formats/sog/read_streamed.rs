//! Reads the streamed SOG of PlayCanvas. The leaves of the tree in `lod-meta.json` name their Gaussians in SOG files
//! for every level of detail. One whole level is read, or all levels of all leaves, with the environment that belongs
//! to all levels.

use std::collections::{BTreeMap, BTreeSet};
use std::ops;
use std::path::Path;

use anyhow::{Context, Result, ensure};
use serde::Deserialize;

use super::files::Files;
use super::unit::{Unit, decode_all};
use crate::formats::input::Input;
use crate::formats::linked_file::inside;
use crate::formats::{Leaf, SourceLevels};
use crate::scene::{Cancelled, NoLevel, Scene, SceneLevel, Watch};

/// Largest `lod-meta.json` in bytes.
pub(crate) const MAX_BYTES: u64 = 1 << 28;
/// Most levels of a leaf.
const MOST_LEVELS: usize = 1000;

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
    #[serde(default)]
    offset: u64,
    count: u64,
}

/// The Gaussians of one leaf and level in a file.
struct Piece {
    leaf: usize,
    /// Number of finer levels of the leaf.
    place: usize,
    offset: u64,
    count: u64,
}

impl Node {
    fn leaves<'n>(&'n self, visit: &mut impl FnMut(&'n BTreeMap<u32, Range>)) {
        visit(&self.lods);
        self.children.iter().for_each(|child| child.leaves(visit));
    }
}

impl Written {
    /// The name of a file, which may be asked for once.
    fn name<'w>(&'w self, file: usize, names: &mut BTreeSet<&'w str>) -> Result<&'w str> {
        let name = self.filenames.get(file);
        let name = name.with_context(|| format!("lod-meta.json names file {file} of {}", self.filenames.len()))?;
        ensure!(names.insert(name), "lod-meta.json names {name} twice");
        Ok(name)
    }
}

fn parsed(json: &[u8]) -> Result<Written> {
    serde_json::from_slice(json).context("lod-meta.json is not that of a streamed SOG")
}

/// Reads all levels.
pub(crate) fn read_levels(input: &mut Input, json: &[u8], folder: &Path, watch: &Watch) -> Result<SourceLevels> {
    let written = parsed(json)?;
    let (mut leaves, mut pieces_of_files) = (0, BTreeMap::<usize, Vec<Piece>>::new());
    written.tree.leaves(&mut |lods| {
        let lods = lods.values().filter(|range| range.count > 0);
        for (place, Range { file, offset, count }) in lods.enumerate() {
            leaves = if place == 0 { leaves + 1 } else { leaves };
            let piece = Piece { leaf: leaves - 1, place, offset: *offset, count: *count };
            pieces_of_files.entry(*file).or_default().push(piece);
        }
    });
    ensure!(leaves > 0, "the tree in lod-meta.json has no Gaussians");
    let levels = pieces_of_files.values().flatten().map(|piece| piece.place + 1).max().unwrap_or(0);
    ensure!(levels <= MOST_LEVELS, "a leaf in lod-meta.json has {levels} levels, expected at most {MOST_LEVELS}");
    let (mut units, mut names) = (Vec::new(), BTreeSet::new());
    for (file, mut pieces) in pieces_of_files {
        ensure!(!(watch.is_cancelled)(), Cancelled);
        let name = written.name(file, &mut names)?;
        let unit = open(folder, name, watch)?;
        pieces.sort_by_key(|piece| piece.offset);
        let after = |end: u64, piece: &Piece| if piece.offset == end { end.checked_add(piece.count) } else { None };
        let are_all = pieces.iter().try_fold(0, after) == Some(unit.meta.count as u64);
        ensure!(are_all, "lod-meta.json does not assign each of the {} Gaussians of {name} once", unit.meta.count);
        units.push((unit, pieces));
    }
    if let Some(name) = &written.environment {
        let unit = open(folder, name, watch)?;
        let piece = Piece { leaf: leaves, place: 0, offset: 0, count: unit.meta.count as u64 };
        leaves += 1;
        units.push((unit, vec![piece]));
    }
    let sh_degree = units.iter().map(|(unit, _)| unit.sh_degree).max().unwrap_or(0);
    let is_antialiased = units.iter().any(|(unit, _)| unit.meta.is_antialiased);
    let [of_scene, of_coarser] = [true, false].map(|is_finest| {
        let pieces = units.iter().flat_map(|(_, pieces)| pieces).filter(|piece| (piece.place == 0) == is_finest);
        pieces.map(|piece| piece.count as usize).sum::<usize>()
    });
    let (mut finest, mut coarser) = (input.builder(sh_degree, of_scene)?, input.builder(sh_degree, of_coarser)?);
    let (mut found, mut before) = (vec![BTreeMap::new(); leaves], 0);
    for (unit, pieces) in units {
        let texels = unit.decoded(input, &finest)?;
        for Piece { leaf, place, offset, count } in pieces {
            let builder = if place == 0 { &mut finest } else { &mut coarser };
            let (begin, [offset, count]) = (builder.len(), [offset, count].map(|number| number as usize));
            let progress = |done| (watch.progress)((before + done) as f64 / (of_scene + of_coarser) as f64);
            texels.add(offset..offset + count, input, builder, progress)?;
            before += count;
            found[leaf].insert(place, begin..builder.len());
        }
    }
    let leaf = |mut of_places: BTreeMap<usize, ops::Range<usize>>| Leaf {
        finest: of_places.remove(&0).unwrap_or_default(),
        coarser: of_places.into_values().filter(|range| !range.is_empty()).collect(),
    };
    // Gaussians that cannot be drawn are left out, and nothing stands for a leaf without others.
    let mut leaves: Vec<Leaf> = found.into_iter().map(leaf).filter(|leaf| !leaf.finest.is_empty()).collect();
    let (mut coarser, mut notices) = (coarser.finish().0, Vec::new());
    let used: Vec<u32> =
        leaves.iter().flat_map(|leaf| leaf.coarser.iter().cloned().flatten()).map(|index| index as u32).collect();
    if used.len() < of_coarser {
        notices.push(format!(
            "{} Gaussians of coarser levels are left out: they, or those that they stand for, cannot be drawn",
            of_coarser - used.len()
        ));
    }
    if used.len() < coarser.len() {
        coarser = coarser.selected(&used)?;
        let mut next = 0;
        for range in leaves.iter_mut().flat_map(|leaf| &mut leaf.coarser) {
            *range = next..next + range.len();
            next = range.end;
        }
    }
    let (gaussians, report) = finest.finish();
    let scene = Scene { gaussians, report, is_antialiased, notices, ..Scene::empty("streamed SOG") };
    Ok(SourceLevels { scene, coarser, leaves })
}

pub(crate) fn read(input: &mut Input, json: &[u8], folder: &Path, level: Option<u32>, watch: &Watch) -> Result<Scene> {
    let written = parsed(json)?;
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
        let name = written.name(file, &mut names)?;
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
