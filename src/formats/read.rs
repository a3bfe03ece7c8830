//! Reads scene files. The format is detected from the content; level of detail and axes come from the caller.

use std::path::{Path, PathBuf};

use anyhow::{Result, bail, ensure};

use super::input::Source;
use super::{gltf, ksplat, ply, sog, splat, spz};
use crate::host_memory::OutOfMemory;
use crate::procedural::Procedural;
use crate::scene::{Cancelled, Gaussians, LoadReport, NoLevel, Scene, Transform, Unreadable, Watch};

/// Choices of the caller for reading a file, and corrections of what it states wrongly.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Reading {
    /// Level of detail, 0 the finest, of a file with several. By default the finest.
    pub level: Option<u32>,
    /// Axes x, y, z that are reversed with respect to the format.
    pub flip: [bool; 3],
    /// Applied to the scene after its axes are flipped.
    pub transform: Transform,
}

impl Reading {
    /// Reads a scene file, or the folder of a SOG. The format is detected from the content; only .splat, .ksplat and
    /// .gltf are recognized by name. `progress` gets the fraction read so far, 0 to 1.
    ///
    /// # Errors
    /// [`Unreadable`] if the file is not a scene that can be drawn, [`OutOfMemory`] if it does not fit into memory,
    /// [`NoLevel`] if it lacks the level of detail.
    pub fn read(&self, path: &Path, progress: &dyn Fn(f64)) -> Result<Scene> {
        self.read_watched(path, &Watch { progress, partial: &|_| {}, is_cancelled: &|| false })
    }

    /// Like [`Reading::read`], with partial results and cancelling.
    ///
    /// # Errors
    /// Those of [`Reading::read`], and [`Cancelled`].
    pub fn read_watched(&self, path: &Path, watch: &Watch) -> Result<Scene> {
        let read = read_any(path, self.level, watch)
            .and_then(|scene| Ok(Scene { gaussians: self.placed(scene.gaussians)?, ..scene }));
        read.map_err(|problem| failure(path, problem, watch))
    }

    /// True if [`Reading::read_blocks`] reads a file. False, too, if nothing reads it.
    pub fn comes_in_blocks(&self, path: &Path) -> bool {
        let watch = Watch { progress: &|_| {}, partial: &|_| {}, is_cancelled: &|| false };
        let Ok(mut source) = Source::open(path, &watch) else { return false };
        match source.peek(4) {
            Ok(magic) if magic.starts_with(b"ply") => ply::comes_in_blocks(&mut source),
            _ => is_splat(path),
        }
    }

    /// Reads a scene file of a format that needs no more memory than a block at a time: `.ply` with Gaussians, and
    /// `.splat`. `take` gets the blocks in the order of the file, flipped and transformed, and the number of Gaussians
    /// that the file claims. Returns everything but the Gaussians, or `None` if the format is read as a whole.
    ///
    /// # Errors
    /// Those of [`Reading::read_watched`], and those of `take`.
    pub fn read_blocks(
        &self,
        path: &Path,
        watch: &Watch,
        take: &mut dyn FnMut(Gaussians, usize) -> Result<()>,
    ) -> Result<Option<Scene>> {
        // What `take` refuses is no fault of the file.
        let mut refused = None;
        let mut take = |block: Gaussians, of: usize| {
            let taken = take(self.placed(block)?, of);
            taken.map_err(|problem| {
                refused = Some(problem);
                Cancelled.into()
            })
        };
        let read = read_any_blocks(path, watch, &mut take);
        match refused {
            Some(problem) => Err(problem),
            None => read.map_err(|problem| failure(path, problem, watch)),
        }
    }

    /// Generates a procedural scene.
    ///
    /// # Errors
    /// [`OutOfMemory`], and [`NoLevel`] if a level of detail is requested.
    pub fn make(&self, procedural: Procedural) -> Result<Scene> {
        if self.level.is_some() {
            return Err(NoLevel { path: procedural.name().to_owned(), ..NoLevel::none() }.into());
        }
        let scene = procedural.make()?;
        Ok(Scene { gaussians: self.placed(scene.gaussians)?, ..scene })
    }

    /// Flips and transforms the Gaussians of a scene, or a part of them.
    ///
    /// # Errors
    /// If a mean leaves the range of 32-bit floats, or [`OutOfMemory`].
    pub fn placed(&self, gaussians: Gaussians) -> Result<Gaussians> {
        let flipped = if self.flip == [false; 3] { gaussians } else { gaussians.flipped(self.flip) };
        if self.transform == Transform::IDENTITY { Ok(flipped) } else { flipped.transformed(&self.transform) }
    }
}

/// Reads a scene file with the defaults of [`Reading`]: the finest level, no flip, no transform. Page files are read by
/// the module `storage`.
///
/// # Errors
/// Those of [`Reading::read`].
pub fn read(path: &Path, progress: &dyn Fn(f64)) -> Result<Scene> {
    Reading::default().read(path, progress)
}

/// The path of the scene in a model folder of the original 3DGS: the point cloud of the last iteration. `path` may also
/// be its folder `point_cloud` or the folder of an iteration. Any other path is returned unchanged.
pub fn in_folder(path: &Path) -> PathBuf {
    const FILE: &str = "point_cloud.ply";
    if path.join(FILE).exists() {
        return path.join(FILE);
    }
    let last = |folder: &Path| {
        let iterations = std::fs::read_dir(folder).into_iter().flatten().flatten();
        let number = |folder: &Path| folder.file_name()?.to_str()?.strip_prefix("iteration_")?.parse::<u64>().ok();
        iterations.map(|entry| entry.path()).filter_map(|f| Some((number(&f)?, f))).max()
    };
    let found = last(&path.join("point_cloud")).or_else(|| last(path));
    found.map_or_else(|| path.to_owned(), |(_, folder)| folder.join(FILE))
}

/// The error of a file that could not be read because of `problem`.
fn failure(path: &Path, problem: anyhow::Error, watch: &Watch) -> anyhow::Error {
    // Decoders may wrap or replace the error of a cancelled source.
    if (watch.is_cancelled)() {
        return Cancelled.into();
    }
    let path_of = || path.display().to_string();
    if let Some(NoLevel { problem, .. }) = problem.downcast_ref() {
        return NoLevel { path: path_of(), problem: problem.clone() }.into();
    }
    match problem.downcast::<OutOfMemory>() {
        Ok(too_large) => too_large.into(),
        // Decompressors allocate as they go.
        Err(problem) if lacks_memory(&problem) => {
            let reason = "the host has too little free memory to read it".to_owned();
            OutOfMemory { name: path_of(), bytes: None, reason }.into()
        }
        Err(problem) => Unreadable::new(path, &problem).into(),
    }
}

fn is_splat(path: &Path) -> bool {
    path.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("splat"))
}

/// True if an allocation failed inside of a decompressor.
fn lacks_memory(problem: &anyhow::Error) -> bool {
    let kinds = problem.chain().filter_map(|cause| cause.downcast_ref::<std::io::Error>()).map(std::io::Error::kind);
    kinds.into_iter().any(|kind| kind == std::io::ErrorKind::OutOfMemory)
}

fn read_any(path: &Path, level: Option<u32>, watch: &Watch) -> Result<Scene> {
    let path = &sog::in_folder(path);
    let mut source = Source::open(path, watch)?;
    ensure!(source.len() > 0, "the file is empty");
    let is_named = |ending: &str| path.extension().is_some_and(|e| e.eq_ignore_ascii_case(ending));
    let magic = source.peek(4)?;
    let is_json = magic.starts_with(b"{") && !["gltf", "splat", "ksplat"].into_iter().any(is_named);
    let scene = match magic {
        _ if is_json => sog::read_json(source, path, level, watch)?,
        _ if level.is_some() => bail!(NoLevel::none()),
        _ if magic.starts_with(b"ply") => ply::read(&mut source)?,
        _ if magic.starts_with(b"glTF") => gltf::read_binary(&mut source, path)?,
        _ if is_named("gltf") => gltf::read_text(&mut source, path)?,
        _ if magic.starts_with(b"NGSP") => spz::read_v4(&mut source)?,
        [0x1f, 0x8b, 8, ..] => spz::read_gzip(&mut source)?,
        [b'P', b'K', 3, 4] => sog::read_bundle(source, watch)?,
        _ if is_named("splat") => splat::read(&mut source)?,
        _ if is_named("ksplat") => ksplat::read(&mut source)?,
        _ => bail!(
            "not a scene that smalto reads: expected .ply, .compressed.ply, .spz, .sog, .glb or .smalto content, a \
             meta.json or lod-meta.json of SOG, or a file named .splat, .ksplat or .gltf, found bytes {magic:02x?}"
        ),
    };
    let LoadReport { read, .. } = scene.report;
    ensure!(read > 0, "the scene holds no Gaussians");
    let is_drawable = !scene.gaussians.is_empty() || scene.report.is_clean();
    ensure!(is_drawable, "none of its {read} Gaussians can be drawn: {}", scene.report);
    Ok(scene)
}

fn read_any_blocks(
    path: &Path,
    watch: &Watch,
    take: &mut dyn FnMut(Gaussians, usize) -> Result<()>,
) -> Result<Option<Scene>> {
    let path = &sog::in_folder(path);
    let mut source = Source::open(path, watch)?;
    ensure!(source.len() > 0, "the file is empty");
    match source.peek(4)? {
        magic if magic.starts_with(b"ply") => ply::read_blocks(&mut source, take),
        _ if is_splat(path) => splat::read_blocks(&mut source, take).map(Some),
        _ => Ok(None),
    }
}
