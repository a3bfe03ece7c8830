//! File formats of scenes: the table of all formats, their readers and their writers.
//!
//! - `read` - detects the format of a file, and reads it with the choices of the caller
//! - `write` - the formats that can be written, and how each arranges the Gaussians
//! - `write_file` - writes a scene to a file, reads it back, and reports what the format lost
//! - `loss` - the difference of every attribute between two scenes
//! - `input` - a file that is read front to back, with progress and cancelling
//! - `levels` - all levels of a scene
//! - `packed` - scenes in gzip streams, and names of other archives
//! - `training` - settings of training beside a scene
//! - `linked_file` - paths of files that a scene file names
//! - `rows` - rows of bytes, and encodings that several formats share
//! - `ply/`, `spz/`, `sog/`, `splat/`, `gltf/`, `rad/`, `ksplat` - a reader for each format, and a writer for all but
//!   the last two

mod gltf;
mod input;
mod ksplat;
mod levels;
mod linked_file;
mod loss;
mod packed;
mod ply;
mod rad;
mod read;
mod rows;
mod sog;
mod splat;
mod spz;
mod training;
mod write;
mod write_file;

use std::path::Path;

use anyhow::Result;

use crate::scene::{Scene, Watch};
use input::{Input, TakeBlock};

#[doc(hidden)]
pub use levels::{Leaf, SourceLevels};
pub use loss::Loss;
pub use read::{Reading, in_folder, read, read_watched};
pub(crate) use read::{SIGNATURE_BYTES, check_recognized, file_with_levels};
pub use sog::{LOD_META, Streamed, WrittenLevels, write_sog_folder, write_streamed_sog};
pub use write::SceneFile;
pub use write_file::{WrittenFile, write_file};

/// A file format of scenes.
pub struct Format {
    /// The ending of file names without its dot, or a whole file name. Also the value of `--format`.
    pub name: &'static str,
    /// A line on the format.
    pub help: &'static str,
    pub(crate) recognition: Recognition,
    pub(crate) reader: Reader,
    /// The format for writing, if it can be written.
    pub write: Option<Writer>,
}

/// The property by which files of a format are recognized.
#[derive(Clone, Copy, PartialEq)]
pub(crate) enum Recognition {
    /// The file begins with one of these byte strings.
    Signature(&'static [&'static [u8]]),
    /// The file has no signature, so its ending is that of the format.
    Ending,
    /// The file is JSON, and its ending is not that of another format.
    Json,
}

/// The reader of a format.
pub(crate) enum Reader {
    /// A reader of this module. It has a `BlockReader` if some files can be read without holding the whole scene.
    Scene { read: fn(Input, &Request) -> Result<Scene>, blocks: Option<BlockReader> },
    /// A reader of scenes that may have several levels of detail: of one level, and of all, for which no level is
    /// requested.
    Levels { read: fn(Input, &Request) -> Result<Scene>, read_all: fn(Input, &Request) -> Result<SourceLevels> },
    /// Page files are read by the module `pagefile`.
    Pages,
}

/// The file to read, and the caller's choices that concern its format.
pub(crate) struct Request<'r> {
    pub path: &'r Path,
    /// Level of detail, 0 the finest. By default the finest.
    pub level: Option<u32>,
    pub watch: &'r Watch<'r>,
}

/// A reader that passes a scene on in blocks of Gaussians.
pub(crate) struct BlockReader {
    /// True if this file can be read in blocks.
    pub applies: fn(&mut Input) -> bool,
    /// Returns everything but the Gaussians, or `None` if the file has to be read as a whole.
    pub read: fn(&mut Input, TakeBlock) -> Result<Option<Scene>>,
}

/// The form in which a format is written.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Writer {
    /// A scene file, written as a whole.
    Scene(SceneFile),
    /// A page file, which the module `pagefile` writes.
    Pages,
}

/// First bytes of a page file.
pub(crate) const PAGE_FILE_SIGNATURE: [u8; 8] = *b"smalto\x1a\n";

/// Every format. A new one that is read costs its reader and an entry here.
pub static FORMATS: [Format; 11] = [
    Format {
        name: "ply",
        help: "32-bit floats",
        recognition: Recognition::Signature(&[b"ply"]),
        reader: PLY,
        write: Some(Writer::Scene(SceneFile::Ply)),
    },
    Format {
        name: "compressed.ply",
        help: "The compressed PLY of PlayCanvas",
        // The header distinguishes it from other PLY.
        recognition: Recognition::Signature(&[b"ply"]),
        reader: PLY,
        write: Some(Writer::Scene(SceneFile::CompressedPly)),
    },
    Format {
        name: "spz",
        help: "SPZ",
        recognition: Recognition::Signature(&[b"NGSP", GZIP]),
        reader: whole(|mut input, _| spz::read(&mut input)),
        write: Some(Writer::Scene(SceneFile::Spz { version: 4 })),
    },
    Format {
        name: "sog",
        help: "SOG in one file",
        recognition: Recognition::Signature(&[b"PK\x03\x04"]),
        reader: whole(|input, request| sog::read_bundle(input, request.watch)),
        write: Some(Writer::Scene(SceneFile::Sog)),
    },
    Format {
        name: "meta.json",
        help: "SOG in a folder",
        recognition: Recognition::Json,
        reader: Reader::Levels { read: sog::read_json, read_all: sog::read_all_levels },
        write: Some(Writer::Scene(SceneFile::SogFolder)),
    },
    Format {
        name: "splat",
        help: "32 bytes per Gaussian",
        recognition: Recognition::Ending,
        reader: Reader::Scene {
            read: |mut input, _| splat::read(&mut input),
            blocks: Some(BlockReader {
                applies: |_| true,
                read: |input, take| splat::read_blocks(input, take).map(Some),
            }),
        },
        write: Some(Writer::Scene(SceneFile::Splat)),
    },
    Format {
        name: "ksplat",
        help: "The compressed splats of mkkellogg",
        recognition: Recognition::Ending,
        reader: whole(|mut input, _| ksplat::read(&mut input)),
        write: None,
    },
    Format {
        name: "rad",
        help: "Spark's levels, the finest or all",
        recognition: Recognition::Signature(&[rad::SIGNATURE]),
        reader: Reader::Levels { read: rad::read, read_all: rad::read_levels },
        write: None,
    },
    Format {
        name: "glb",
        help: "Binary glTF, 32-bit floats",
        recognition: Recognition::Signature(&[b"glTF"]),
        reader: whole(|mut input, request| gltf::read_binary(&mut input, request.path)),
        write: Some(Writer::Scene(SceneFile::Glb)),
    },
    Format {
        name: "gltf",
        help: "glTF with its buffers in other files",
        recognition: Recognition::Ending,
        reader: whole(|mut input, request| gltf::read_text(&mut input, request.path)),
        write: None,
    },
    Format {
        name: "smalto",
        help: "Pages, for scenes larger than memory",
        recognition: Recognition::Signature(&[&PAGE_FILE_SIGNATURE]),
        reader: Reader::Pages,
        write: Some(Writer::Pages),
    },
];

/// First bytes of a gzip stream, which SPZ 1 to 3 are. Any other scene may lie in one, too.
const GZIP: &[u8] = &[0x1f, 0x8b, 8];

const PLY: Reader = Reader::Scene {
    read: |mut input, _| ply::read(&mut input),
    blocks: Some(BlockReader { applies: ply::comes_in_blocks, read: ply::read_blocks }),
};

/// A reader of files with one level of detail, which are read as a whole.
const fn whole(read: fn(Input, &Request) -> Result<Scene>) -> Reader {
    Reader::Scene { read, blocks: None }
}

impl Format {
    /// The format of a file that begins with these bytes and has this path.
    pub(crate) fn of(begin: &[u8], path: &Path) -> Option<&'static Self> {
        let has_signature = |format: &&Self| match format.recognition {
            Recognition::Signature(all) => all.iter().any(|signature| begin.starts_with(signature)),
            Recognition::Ending | Recognition::Json => false,
        };
        let has_ending = |format: &&Self| {
            let ending = path.extension().is_some_and(|ending| ending.eq_ignore_ascii_case(format.name));
            format.recognition == Recognition::Ending && ending
        };
        let is_json = |format: &&Self| format.recognition == Recognition::Json && begin.starts_with(b"{");
        // A name is weaker than a signature, and stronger than the brace that all JSON begins with.
        let found = FORMATS.iter().find(has_signature).or_else(|| FORMATS.iter().find(has_ending));
        found.or_else(|| FORMATS.iter().find(is_json))
    }

    /// The format that is written to a file of this name.
    pub(crate) fn of_name(path: &Path) -> Option<&'static Self> {
        let name = path.file_name()?.to_string_lossy().to_ascii_lowercase();
        let fits = |format: &&Self| match format.is_file_name() {
            true => name == format.name,
            false => name.ends_with(&format.label()),
        };
        FORMATS.iter().filter(|format| format.write.is_some()).filter(fits).max_by_key(|format| format.name.len())
    }

    /// The name as help texts and messages write it: `.ply`, or `meta.json`.
    pub fn label(&self) -> String {
        if self.is_file_name() { self.name.to_owned() } else { format!(".{}", self.name) }
    }

    /// True if the format is written to a single file.
    #[cfg(feature = "viewer")]
    pub(crate) fn is_written_file(&self) -> bool {
        self.write.is_some() && !self.is_file_name()
    }

    /// True if the name is a whole file name, not an ending.
    fn is_file_name(&self) -> bool {
        self.recognition == Recognition::Json
    }
}

/// The formats that are read from a single file, like ".ply, .spz or .smalto".
pub fn read_labels() -> String {
    labels(|format| !format.is_file_name())
}

/// The formats that are written, like ".ply, meta.json (a SOG in a folder) or .smalto (pages)".
pub fn written_labels() -> String {
    let written = FORMATS.iter().filter(|format| format.write.is_some());
    listed(written.map(|format| match format.write {
        Some(Writer::Scene(SceneFile::SogFolder)) => format!("{} (a SOG in a folder)", format.label()),
        Some(Writer::Pages) => format!("{} (pages)", format.label()),
        _ => format.label(),
    }))
}

/// The labels of some formats as a list.
pub(crate) fn labels(is_listed: impl Fn(&Format) -> bool) -> String {
    listed(FORMATS.iter().filter(|format| is_listed(format)).map(Format::label))
}

/// Texts as a list: "a, b or c".
pub(crate) fn listed(texts: impl Iterator<Item = String>) -> String {
    let texts: Vec<String> = texts.collect();
    match texts.split_last() {
        Some((last, [])) => last.clone(),
        Some((last, others)) => format!("{} or {last}", others.join(", ")),
        None => String::new(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_signature_is_stronger_than_a_name_and_a_name_than_json() {
        let name = |begin: &[u8], path: &str| Format::of(begin, path.as_ref()).map(|format| format.name);
        assert_eq!(name(b"ply\n", "a.splat"), Some("ply"));
        assert_eq!(name(b"{\"as", "a.GLTF"), Some("gltf"));
        assert_eq!(name(b"{\"as", "a.splat"), Some("splat"));
        assert_eq!(name(b"{\"as", "a.json"), Some("meta.json"));
        assert_eq!(name(b"smalto\x1a\n", "a"), Some("smalto"));
        assert_eq!(name(b"abcd", "a.ply"), None);
    }

    #[test]
    fn the_longest_ending_names_the_format_to_write() {
        let name = |path: &str| Format::of_name(path.as_ref()).map(|format| format.name);
        assert_eq!(
            ["a.compressed.PLY", "a.ply", "b/meta.json"].map(name).map(Option::unwrap),
            ["compressed.ply", "ply", "meta.json"]
        );
        assert_eq!(["a.ksplat", "a.meta.json", "ply", ""].map(name), [None; 4]);
    }

    #[test]
    fn lists_of_formats_are_sentences() {
        let read = ".ply, .compressed.ply, .spz, .sog, .splat, .ksplat, .rad, .glb, .gltf or .smalto";
        assert_eq!(read_labels(), read);
        let written =
            ".ply, .compressed.ply, .spz, .sog, meta.json (a SOG in a folder), .splat, .glb or .smalto (pages)";
        assert_eq!(written_labels(), written);
        assert_eq!(labels(Format::is_written_file), ".ply, .compressed.ply, .spz, .sog, .splat, .glb or .smalto");
    }
}
