//! Writes the streamed SOG of PlayCanvas: a tree whose leaves name their Gaussians for every level of detail, in SOG
//! folders of one level each.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

use anyhow::{Context, Result, ensure};
use glam::{DMat3, DQuat, DVec3};
use serde::{Deserialize, Serialize};

use super::LOD_META;
use super::folder::{in_locked, remove_unit};
use super::write::{META, files};
use crate::files::{make_folder, read_whole, write_new, write_tree};
use crate::formats::loss::Loss;
use crate::formats::read::read_back;
use crate::formats::write::SceneFile;
use crate::scene::{Gaussians, Watch};

/// The folder of the SOG folders; another number is added where the name is taken.
const TREE: &str = "levels";
/// Most Gaussians of one SOG folder, which viewers load as a whole. splat-transform makes folders of this size.
const MOST: usize = 1 << 19;

/// A scene with levels of detail, in parts that have all of them.
pub struct Streamed<'s> {
    /// Number of parts; neighbours in their order are neighbours in space.
    pub parts: usize,
    /// Number of levels; 0 is the finest.
    pub levels: usize,
    pub is_antialiased: bool,
    /// The Gaussians of a part at a level.
    pub nodes: &'s dyn Fn(usize, usize) -> Result<Gaussians>,
    /// Gets the fraction that is written.
    pub progress: &'s dyn Fn(f64),
}

/// The levels that were written.
pub struct WrittenLevels {
    /// Gaussians by level.
    pub counts: Vec<usize>,
    /// The size of all files.
    pub bytes: u64,
    /// Gaussians of the finest level that were left out because the format rounds their opacity to 0.
    pub transparent: usize,
    /// The loss of the finest level.
    pub loss: Vec<Loss>,
}

#[derive(Clone, Copy, Serialize)]
struct Bound {
    min: [f32; 3],
    max: [f32; 3],
}

/// Position of the Gaussians of a leaf at a level.
#[derive(Serialize)]
struct Range {
    file: usize,
    offset: usize,
    count: usize,
}

#[derive(Serialize)]
#[serde(untagged)]
enum Node {
    Inner { bound: Bound, children: [Box<Node>; 2] },
    Leaf { bound: Bound, lods: BTreeMap<usize, Range> },
}

#[derive(Serialize)]
struct Asset {
    generator: &'static str,
}

#[derive(Serialize)]
#[serde(rename_all = "camelCase")]
struct LodMeta<'m> {
    version: u32,
    asset: Asset,
    /// Gaussians of all levels.
    count: usize,
    counts: &'m [usize],
    lod_levels: usize,
    filenames: Vec<String>,
    tree: Node,
}

/// The files of a streamed SOG.
#[derive(Default, Deserialize)]
#[serde(default)]
struct Names {
    filenames: Vec<String>,
    environment: Option<String>,
}

/// Writes a streamed SOG as the file `lod-meta.json` in a folder, which is made if needed, and folders of textures
/// beside it. Every file is read back before it counts. An older streamed SOG in the folder stays readable until the
/// new one takes its place; then its files are removed.
///
/// # Errors
/// If a file cannot be written, another run writes into the folder, or no Gaussian has an opacity that the format can
/// hold; those of `streamed`.
pub fn write_streamed_sog(folder: &Path, streamed: &Streamed) -> Result<WrittenLevels> {
    in_locked(folder, || {
        let old: Names = read_whole(&folder.join(LOD_META))
            .map_or_else(|_| Names::default(), |json| serde_json::from_slice(&json).unwrap_or_default());
        let mut names = (0..u32::MAX).map(|n| if n == 0 { TREE.to_owned() } else { format!("{TREE}.{n}") });
        let tree = names.find(|name| fs::symlink_metadata(folder.join(name)).is_err());
        let tree = tree.context("no name is free for the folder of levels")?;
        let written = write_tree(folder, &tree, LOD_META, |parts| {
            make_folder(&parts.join(&tree))?;
            let (unit, filenames) = (Vec::new(), Vec::new());
            Writer { folder, parts, tree: &tree, streamed, unit, filenames, bytes: 0 }.write()
        })?;
        old.filenames.iter().chain(&old.environment).for_each(|name| remove_unit(folder, name));
        Ok(written)
    })
}

struct Writer<'w> {
    /// The folder of the output.
    folder: &'w Path,
    /// The folder inside that is filled first.
    parts: &'w Path,
    tree: &'w str,
    streamed: &'w Streamed<'w>,
    /// The Gaussians of the next SOG folder: leaf after leaf.
    unit: Vec<Gaussians>,
    /// The `meta.json` of each SOG folder, from the folder of `lod-meta.json`.
    filenames: Vec<String>,
    bytes: u64,
}

impl Writer<'_> {
    fn write(&mut self) -> Result<WrittenLevels> {
        let Streamed { parts, levels, .. } = *self.streamed;
        let mut leaves: Vec<(Option<Bound>, BTreeMap<usize, Range>)> = Vec::new();
        leaves.resize_with(parts, || (None, BTreeMap::new()));
        let (mut counts, mut loss, mut left_out, mut transparent) = (Vec::new(), Vec::new(), Vec::new(), 0);
        for level in 0..levels {
            counts.push(0);
            let (first, mut lost) = (self.filenames.len(), Vec::new());
            for (part, (bound, lods)) in leaves.iter_mut().enumerate() {
                let nodes = (self.streamed.nodes)(part, level)?;
                let arranged = SceneFile::SogFolder.arranged(&nodes)?;
                if level == 0 {
                    transparent += nodes.len() - arranged.len();
                    left_out.push((nodes.len(), Loss::left_out(&nodes, arranged.sh_degree())));
                }
                let count = arranged.len();
                // A viewer takes a range without Gaussians for a fault.
                if count == 0 {
                    continue;
                }
                if self.in_unit() + count > MOST {
                    lost.extend(self.finish_unit(level, first)?);
                }
                lods.insert(level, Range { file: self.filenames.len(), offset: self.in_unit(), count });
                *bound = bound.take().into_iter().chain(Bound::around(&arranged)).reduce(Bound::and);
                counts[level] += count;
                self.unit.push(arranged);
                // Each level has half as many Gaussians as the one below.
                let left = 0.5_f64.powi(level as i32);
                (self.streamed.progress)(1.0 - left + left / 2.0 * (part + 1) as f64 / parts as f64);
            }
            lost.extend(self.finish_unit(level, first)?);
            if level == 0 {
                loss = [Loss::joined(&lost), Loss::joined(&left_out)].concat();
            }
        }
        let leaf = |(bound, lods): (Option<Bound>, _)| bound.map(|bound| Node::Leaf { bound, lods });
        let tree = tree_of(leaves.into_iter().filter_map(leaf).collect());
        let tree = tree.context("the format rounds the opacity of all Gaussians to 0")?;
        let (count, filenames) = (counts.iter().sum(), std::mem::take(&mut self.filenames));
        let asset = Asset { generator: "smalto" };
        let meta = LodMeta { version: 1, asset, count, counts: &counts, lod_levels: levels, filenames, tree };
        self.file(&self.parts.join(LOD_META), &serde_json::to_vec(&meta)?)?;
        Ok(WrittenLevels { counts, bytes: self.bytes, transparent, loss })
    }

    fn in_unit(&self) -> usize {
        self.unit.iter().map(Gaussians::len).sum()
    }

    /// Writes the Gaussians that were collected as a SOG folder, and reads it back. Their number and what they lost is
    /// returned, if any. `first` is the number of folders of finer levels.
    fn finish_unit(&mut self, level: usize, first: usize) -> Result<Option<(usize, Vec<Loss>)>> {
        if self.unit.is_empty() {
            return Ok(None);
        }
        let gaussians = Gaussians::joined(self.unit.iter())?;
        self.unit.clear();
        let folder = format!("{}/{level}_{}", self.tree, self.filenames.len() - first);
        let path = self.parts.join(&folder);
        make_folder(&path)?;
        for (name, bytes) in files(&gaussians, self.streamed.is_antialiased, 0)? {
            self.file(&path.join(name), &bytes)?;
        }
        let back = read_back(&path.join(META), &Watch::NONE);
        let back = back.with_context(|| format!("cannot write {}", self.folder.join(&folder).display()))?.gaussians;
        let (count, found) = (gaussians.len(), back.len());
        ensure!(found == count, "{found} of {count} Gaussians of {folder} could be read back");
        self.filenames.push(format!("{folder}/{META}"));
        Ok(Some((count, Loss::between(&gaussians, &back))))
    }

    fn file(&mut self, path: &Path, bytes: &[u8]) -> Result<()> {
        self.bytes += bytes.len() as u64;
        let output = self.folder.join(path.strip_prefix(self.parts).unwrap_or(path));
        write_new(path, bytes).with_context(|| format!("cannot write {}", output.display()))
    }
}

impl Bound {
    /// The box around the ellipsoids of one standard deviation. None for no Gaussian.
    fn around(gaussians: &Gaussians) -> Option<Self> {
        let one = |i: usize| {
            let [w, x, y, z] = gaussians.rotations()[i].map(f64::from);
            let axes = DMat3::from_quat(DQuat::from_xyzw(x, y, z, w));
            let axes = axes * DMat3::from_diagonal(gaussians.scales()[i].map(f64::from).into());
            let mean = DVec3::from(gaussians.means()[i].map(f64::from));
            // An ellipsoid reaches as far along an axis of the world as the row of its matrix is long.
            let half = DVec3::new(axes.row(0).length(), axes.row(1).length(), axes.row(2).length());
            Self { min: (mean - half).as_vec3().to_array(), max: (mean + half).as_vec3().to_array() }
        };
        (0..gaussians.len()).map(one).reduce(Self::and)
    }

    fn and(self, other: Self) -> Self {
        let each = |pick: fn(f32, f32) -> f32, a: [f32; 3], b: [f32; 3]| std::array::from_fn(|i| pick(a[i], b[i]));
        Self { min: each(f32::min, self.min, other.min), max: each(f32::max, self.max, other.max) }
    }
}

impl Node {
    fn bound(&self) -> Bound {
        match self {
            Self::Inner { bound, .. } | Self::Leaf { bound, .. } => *bound,
        }
    }
}

/// A balanced tree over leaves in the order of their places. None for no leaf.
fn tree_of(mut leaves: Vec<Node>) -> Option<Node> {
    if leaves.len() < 2 {
        return leaves.pop();
    }
    let right = tree_of(leaves.split_off(leaves.len().div_ceil(2)))?;
    let left = tree_of(leaves)?;
    Some(Node::Inner { bound: left.bound().and(right.bound()), children: [left, right].map(Box::new) })
}
