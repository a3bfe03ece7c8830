//! Headers of a `.rad`, and the Gaussians of the scene.

use std::path::Path;
use std::sync::Arc;

use anyhow::{Context, Result, ensure};
use serde::Deserialize;

use super::chunk::{Chunk, Columns, MOST_IN_CHUNK, header};
use crate::formats::Request;
use crate::formats::input::{Input, checked_count};
use crate::formats::linked_file::inside;
use crate::scene::{NoLevel, Scene, USUAL_SH_DEGREE, Watch};

pub(crate) const SIGNATURE: &[u8] = b"RAD0";
/// Bytes that the properties of a Gaussian take at least, and the highest ratio of deflate.
const LEAST_BYTES: u64 = 16;
const MOST_RATIO: u64 = 1032;

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
struct FileMeta {
    version: u32,
    #[serde(rename = "type")]
    kind: String,
    count: u64,
    max_sh: Option<u32>,
    lod_tree: Option<bool>,
    chunk_size: Option<u64>,
    chunks: Vec<Place>,
    sh_code_count: Option<u64>,
}

/// Where a chunk lies: behind the header, or in a file of its own.
#[derive(Deserialize)]
struct Place {
    #[serde(default)]
    offset: u64,
    bytes: u64,
    filename: Option<String>,
}

/// A file whose header is read.
pub struct RadFile<'p> {
    meta: FileMeta,
    folder: &'p Path,
    /// Bytes of the header.
    begin: u64,
    pub degree: u32,
    /// Gaussians of each chunk but the last, which may have fewer.
    pub in_chunk: usize,
    pub count: usize,
}

impl<'p> RadFile<'p> {
    pub fn open(input: &mut Input, path: &'p Path) -> Result<Self> {
        let (meta, begin): (FileMeta, _) = header(input, SIGNATURE, "the header")?;
        let FileMeta { version, kind, count, .. } = &meta;
        ensure!(*version == 1, "RAD version {version} is not supported, only 1");
        ensure!(kind == "gsplat", "its type is '{kind}', and only gsplat is supported");
        let degree = meta.max_sh.unwrap_or(0);
        ensure!(degree <= USUAL_SH_DEGREE, "SH degree {degree} is not supported, only 0 to {USUAL_SH_DEGREE}");
        let (each, chunks) = (meta.chunk_size.unwrap_or(*count).max(1), meta.chunks.len());
        ensure!(each <= MOST_IN_CHUNK || each == *count, "chunks of {each} Gaussians are not supported");
        ensure!(chunks as u64 == count.div_ceil(each), "{count} Gaussians are not {chunks} chunks of {each}");
        let folder = path.parent().unwrap_or(Path::new("."));
        let mut available = input.left();
        for name in meta.chunks.iter().filter_map(|place| place.filename.as_ref()) {
            available = available.saturating_add(chunk_file(folder, name)?.len());
        }
        let nodes = checked_count(*count, LEAST_BYTES, available.saturating_mul(MOST_RATIO), "Gaussians")?;
        Ok(Self { folder, begin, degree, in_chunk: usize::try_from(each)?, count: nodes, meta })
    }

    pub fn has_tree(&self) -> bool {
        self.meta.lod_tree == Some(true)
    }

    /// The name of the format.
    pub fn format(&self) -> String {
        if self.has_tree() { format!("RAD, the leaves of {} nodes", self.meta.count) } else { "RAD".to_owned() }
    }

    /// Passes on all chunks, with the values of their Gaussians.
    pub fn chunks(
        &self,
        input: &mut Input,
        mut take: impl FnMut(&mut Input, Chunk, Columns) -> Result<()>,
    ) -> Result<()> {
        let FileMeta { count, chunks, sh_code_count, .. } = &self.meta;
        input.set_read_fraction(0.0);
        let (mut codes, mut next) = (Arc::<[Vec<f32>]>::from([]), self.begin);
        for (number, place) in chunks.iter().enumerate() {
            let first = (number * self.in_chunk) as u64;
            let expected = (self.in_chunk as u64).min(count - first);
            let mut one = || {
                let chunk = match &place.filename {
                    None => {
                        let from = self.begin.saturating_add(place.offset);
                        ensure!(from >= next, "it lies before the end of the chunk before");
                        input.skip(from - next, "what is between chunks")?;
                        next = from.saturating_add(place.bytes);
                        Chunk::read(input, place.bytes, expected)?
                    }
                    Some(name) => {
                        let mut file = chunk_file(self.folder, name)?;
                        let bytes = file.len();
                        Chunk::read(&mut file, bytes, expected).with_context(|| name.clone())?
                    }
                };
                if number == 0 {
                    codes = chunk.codes(self.degree, *sh_code_count)?;
                }
                let columns = chunk.columns(self.degree, &codes)?;
                take(input, chunk, columns)
            };
            one().with_context(|| format!("chunk {number}"))?;
            input.report_decoded((first + expected) as f64 / *count as f64);
        }
        Ok(())
    }
}

/// Opens a chunk in a file of its own.
fn chunk_file(folder: &Path, name: &str) -> Result<Input<'static>> {
    let open = || Input::open(&inside(folder, name)?, &Watch::NONE);
    open().with_context(|| name.to_owned())
}

/// Reads the Gaussians of the scene.
pub(crate) fn read(mut input: Input, request: &Request) -> Result<Scene> {
    // Levels of a tree have no numbers.
    ensure!(request.level.is_none(), NoLevel::none());
    let input = &mut input;
    let file = RadFile::open(input, request.path)?;
    let mut builder = input.builder(file.degree, file.count)?;
    file.chunks(input, |input, chunk, columns| {
        input.before_block(&builder)?;
        if file.has_tree() {
            let leaves = chunk.leaves()?;
            builder.extend(leaves.len(), |index, sh| columns.gaussian(leaves[index], sh));
        } else {
            builder.extend(chunk.count, |index, sh| columns.gaussian(index, sh));
        }
        Ok(())
    })?;
    let (gaussians, report) = builder.finish();
    Ok(Scene { gaussians, report, ..Scene::empty(&file.format()) })
}

/// True if this file is a `.rad` with a tree. False, too, if it cannot be read.
pub(crate) fn has_tree(path: &Path) -> bool {
    let has_tree = || anyhow::Ok(RadFile::open(&mut Input::open(path, &Watch::NONE)?, path)?.has_tree());
    has_tree().unwrap_or(false)
}
