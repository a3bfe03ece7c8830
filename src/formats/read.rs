//! Reads scene files. The format is detected from the content; level of detail and axes come from the caller.

use std::path::{Path, PathBuf};

use anyhow::{Result, anyhow, bail, ensure};

use super::input::Input;
use super::sog::{self, LOD_META};
use super::training::with_settings;
use super::{BlockReader, Format, Reader, Recognition, Request, SourceLevels, labels, packed, rad};
use crate::host_memory::OutOfMemory;
use crate::procedural::Procedural;
use crate::scene::{Cancelled, Gaussians, LoadReport, NoLevel, Placement, Scene, Transform, Unreadable, Watch};

/// Bytes that no signature exceeds.
pub(crate) const SIGNATURE_BYTES: usize = 8;
/// Progress when a gzip stream is unpacked.
const UNPACKED: f64 = 0.5;

/// Choices of the caller for reading a file, and corrections of what it states wrongly.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Reading {
    /// Level of detail, 0 the finest, of a file with several. By default the finest.
    pub level: Option<u32>,
    /// Axes x, y, z that are reversed with respect to the format.
    pub flip: [bool; 3],
    /// Applied to the scene after its axes are flipped, before its positions are rounded to 32-bit floats.
    pub transform: Transform,
}

impl Reading {
    /// Reads a scene file, or the folder of a SOG. The format is detected from the content; only .splat, .ksplat and
    /// .gltf are recognized by name.
    ///
    /// # Errors
    /// [`Unreadable`] if the file is not a scene that can be drawn, [`OutOfMemory`] if it does not fit into memory,
    /// [`NoLevel`] if it lacks the level of detail.
    pub fn read(&self, path: &Path) -> Result<Scene> {
        self.read_watched(path, &Watch::NONE)
    }

    /// Like [`Reading::read`], with progress, partial results and cancelling.
    ///
    /// # Errors
    /// Those of [`Reading::read`], and [`Cancelled`].
    pub fn read_watched(&self, path: &Path, watch: &Watch) -> Result<Scene> {
        read_any(path, self, watch).map_err(|problem| failure(path, problem, watch))
    }

    /// Reads all levels of a streamed SOG, or of a `.rad` with a tree.
    ///
    /// # Errors
    /// Those of [`Reading::read_watched`]; [`NoLevel`] if the file has no levels.
    pub fn read_levels(&self, path: &Path, watch: &Watch) -> Result<SourceLevels> {
        let read = || {
            let path = &sog::in_folder(path);
            let mut input = Input::placed(path, watch, self.placement())?;
            let format = detect(&mut input, path)?;
            let Some(Reader::Levels { read_all, .. }) = format.map(|format| &format.reader) else {
                bail!(NoLevel::no_levels());
            };
            let SourceLevels { scene, coarser, leaves } = read_all(input, &Request { path, level: None, watch })?;
            check_drawable(&scene.report)?;
            Ok(SourceLevels { scene: with_settings(scene, path), coarser, leaves })
        };
        read().map_err(|problem| failure(path, problem, watch))
    }

    /// True if [`Reading::read_blocks`] reads a file. False, too, if nothing reads it.
    #[doc(hidden)]
    pub fn comes_in_blocks(&self, path: &Path) -> bool {
        let Ok(mut input) = Input::open(path, &Watch::NONE) else { return false };
        block_reader(&mut input, path).is_ok_and(|blocks| blocks.is_some_and(|blocks| (blocks.applies)(&mut input)))
    }

    /// Reads a scene file block by block, if its format allows that: `.ply` with Gaussians, and `.splat`. `take` gets
    /// the blocks in the order of the file, flipped and transformed, and the number of Gaussians that the file claims.
    /// Returns everything but the Gaussians, or `None` if the format is read as a whole.
    ///
    /// # Errors
    /// Those of [`Reading::read_watched`], and those of `take`.
    #[doc(hidden)]
    pub fn read_blocks(
        &self,
        path: &Path,
        watch: &Watch,
        take: &mut dyn FnMut(Gaussians, usize) -> Result<()>,
    ) -> Result<Option<Scene>> {
        // What `take` refuses is no fault of the file.
        let mut refused = None;
        let mut take = |block: Gaussians, of: usize| {
            take(block, of).map_err(|problem| {
                refused = Some(problem);
                Cancelled.into()
            })
        };
        let read = read_any_blocks(path, self.placement(), watch, &mut take);
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
        self.placed(procedural.make()?)
    }

    /// A scene that no reader of this module made, or a part of it, flipped and transformed.
    ///
    /// # Errors
    /// If none of its Gaussians can be drawn then, or [`OutOfMemory`].
    pub fn placed(&self, scene: Scene) -> Result<Scene> {
        let placement = self.placement();
        if placement == Placement::IDENTITY {
            return Ok(scene);
        }
        let Scene { gaussians, report, .. } = scene;
        let (gaussians, placed) = gaussians.placed(&placement)?;
        let report = LoadReport { read: report.read, ..report.and(&placed) };
        check_drawable(&report)?;
        Ok(Scene { gaussians, report, ..scene })
    }

    fn placement(&self) -> Placement {
        Placement::new(self.flip, &self.transform)
    }
}

/// Reads a scene file into memory with the defaults of [`Reading`]: the finest level, no flip, no transform. Page files
/// are opened by [`SceneSource::open`](crate::render::SceneSource::open).
///
/// # Errors
/// Those of [`Reading::read`].
pub fn read(path: impl AsRef<Path>) -> Result<Scene> {
    Reading::default().read(path.as_ref())
}

/// Like [`read`], with progress, partial results and cancelling.
///
/// # Errors
/// Those of [`Reading::read_watched`].
pub fn read_watched(path: impl AsRef<Path>, watch: &Watch) -> Result<Scene> {
    Reading::default().read_watched(path.as_ref(), watch)
}

/// Reads a file that was just written and still has a temporary name, which errors leave out.
pub(crate) fn read_back(written: &Path, watch: &Watch) -> Result<Scene> {
    read_watched(written, watch).map_err(|error| match error.downcast::<Unreadable>() {
        Ok(Unreadable { problem, .. }) => anyhow!("what was written cannot be read back: {problem}"),
        Err(error) => error,
    })
}

/// The file at a path, if it has levels: a `lod-meta.json`, which may be in the folder `path`, or a `.rad` with a tree.
pub(crate) fn file_with_levels(path: &Path) -> Option<PathBuf> {
    // A pipe can be read only once.
    let is_rad = || path.is_file() && rad::has_tree(path);
    sog::streamed_in(path).or_else(|| is_rad().then(|| path.to_owned()))
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
    // Decoders may wrap or replace the error of a cancelled input.
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

/// True if an allocation failed inside of a decompressor.
fn lacks_memory(problem: &anyhow::Error) -> bool {
    let kinds = problem.chain().filter_map(|cause| cause.downcast_ref::<std::io::Error>()).map(std::io::Error::kind);
    kinds.into_iter().any(|kind| kind == std::io::ErrorKind::OutOfMemory)
}

fn read_any(path: &Path, reading: &Reading, watch: &Watch) -> Result<Scene> {
    let (path, level) = (&sog::in_folder(path), reading.level);
    let mut input = Input::placed(path, watch, reading.placement())?;
    let scene = match packed::gzip_content(&mut input)? {
        // SPZ 1 to 3 is read from its stream.
        Some(begin) if !begin.starts_with(b"NGSP") || begin.get(4) == Some(&4) => {
            read_gzip(input, &begin, &Request { path, level, watch })?
        }
        _ => read_open(input, &Request { path, level, watch })?,
    };
    check_drawable(&scene.report)?;
    Ok(with_settings(scene, path))
}

/// Fails if there are no Gaussians, or all were dropped and some of them for wrong values.
fn check_drawable(report: &LoadReport) -> Result<()> {
    let read = report.read;
    ensure!(read > 0, "the scene holds no Gaussians");
    let is_drawable = read > report.dropped() || report.is_clean();
    ensure!(is_drawable, "none of its {read} Gaussians can be drawn: {report}");
    Ok(())
}

/// Reads a file that is open. Its path is that of its format and of the files that it names.
fn read_open(mut input: Input, request: &Request) -> Result<Scene> {
    let format = detect(&mut input, request.path)?;
    match format.map(|format| &format.reader) {
        Some(Reader::Levels { read, .. }) => read(input, request),
        _ if request.level.is_some() => bail!(NoLevel::none()),
        Some(Reader::Scene { read, .. }) => read(input, request),
        Some(Reader::Pages) => bail!("it is a page file, which is not read as a whole here"),
        None => bail!(unknown(packed::begin(&mut input)?)),
    }
}

/// Reads a scene that begins with `begin` from a gzip stream.
fn read_gzip(input: Input, begin: &[u8], request: &Request) -> Result<Scene> {
    let Request { path, level, watch } = *request;
    let is_named = path.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("gz"));
    let path = &if is_named { path.with_extension("") } else { path.to_owned() };
    match Format::of(begin, path).map(|format| &format.reader) {
        None => bail!("in a gzip stream: {}", unknown(begin)),
        Some(Reader::Pages) => bail!("a gzip stream that holds a page file: unpack it first"),
        Some(_) => {}
    }
    let unpacking = Watch { progress: &|fraction| (watch.progress)(UNPACKED * fraction), ..*watch };
    let placement = input.placement();
    let unpacked = packed::unpack_gzip(input.watched_by(&unpacking))?;
    let reading = Watch { progress: &|fraction| (watch.progress)(UNPACKED + (1.0 - UNPACKED) * fraction), ..*watch };
    read_open(Input::placed(&unpacked.path(), &reading, placement)?, &Request { path, level, watch: &reading })
}

fn read_any_blocks(
    path: &Path,
    placement: Placement,
    watch: &Watch,
    take: &mut dyn FnMut(Gaussians, usize) -> Result<()>,
) -> Result<Option<Scene>> {
    let path = &sog::in_folder(path);
    let mut input = Input::placed(path, watch, placement)?;
    let Some(blocks) = block_reader(&mut input, path)? else { return Ok(None) };
    let scene = (blocks.read)(&mut input, take)?;
    scene.iter().try_for_each(|scene| check_drawable(&scene.report))?;
    Ok(scene.map(|scene| with_settings(scene, path)))
}

/// The format of a file. Fails if the file is empty.
fn detect(input: &mut Input, path: &Path) -> Result<Option<&'static Format>> {
    ensure!(input.len() > 0, "the file is empty");
    Ok(Format::of(input.peek(SIGNATURE_BYTES)?, path))
}

/// Checks that a scene with these first bytes can be read from a file without a name.
///
/// # Errors
/// A phrase that continues "standard input: " if it cannot.
pub(crate) fn check_recognized(begin: &[u8]) -> Result<()> {
    ensure!(!begin.is_empty(), "the file is empty");
    match Format::of(begin, Path::new("")) {
        Some(format) if format.recognition == Recognition::Json => {
            bail!("JSON names other files of the scene, so it is read by its path, not from a pipe")
        }
        Some(_) => Ok(()),
        None => bail!(unknown(&begin[..begin.len().min(4)])),
    }
}

fn block_reader(input: &mut Input, path: &Path) -> Result<Option<&'static BlockReader>> {
    Ok(detect(input, path)?.and_then(|format| match &format.reader {
        Reader::Scene { blocks, .. } => blocks.as_ref(),
        Reader::Levels { .. } | Reader::Pages => None,
    }))
}

/// The first bytes of a file as a clause.
fn begins_with(bytes: &[u8]) -> String {
    match bytes {
        [] => "found no byte".to_owned(),
        _ if bytes.iter().all(|byte| byte.is_ascii_graphic() || *byte == b' ') => {
            format!("found one that begins with \"{}\"", String::from_utf8_lossy(bytes))
        }
        _ => format!("found one that begins with the bytes {:02x?}", bytes),
    }
}

/// The problem with a file of no known format, which begins with these bytes.
fn unknown(begin: &[u8]) -> String {
    if let Some(other) = packed::other(begin) {
        return format!("not a scene, but {other}");
    }
    let by_content = labels(|format| matches!(format.recognition, Recognition::Signature(_)));
    let by_name = labels(|format| format.recognition == Recognition::Ending);
    format!(
        "not a scene that smalto reads: expected {by_content} content, a meta.json or {LOD_META} of SOG, or a file \
         named {by_name}, {}",
        begins_with(&begin[..begin.len().min(4)])
    )
}
