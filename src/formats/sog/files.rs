//! Access to the textures of a SOG in a zip archive or in a folder.

use std::io::{Cursor, Read};
use std::path::PathBuf;

use anyhow::{Context, Result, anyhow, bail, ensure};
use zip::ZipArchive;
use zip::result::ZipError;

use crate::files::describe;
use crate::formats::input::Input;
use crate::formats::linked_file::inside;
use crate::scene::Watch;

pub(crate) enum Files {
    Folder(PathBuf),
    /// An archive and its length in bytes.
    Archive(ZipArchive<Cursor<Vec<u8>>>, u64),
}

impl Files {
    pub fn archive(input: &mut Input) -> Result<Self> {
        let bytes = input.rest(u64::MAX, "the archive")?;
        let archive = ZipArchive::new(Cursor::new(bytes)).context("the zip archive cannot be read")?;
        Ok(Self::Archive(archive, input.len()))
    }

    /// The content of a file. Fails if it has more than `limit` bytes.
    pub fn read(&mut self, name: &str, limit: u64) -> Result<Vec<u8>> {
        match self {
            Self::Folder(folder) => {
                let watch = Watch::NONE;
                let read = || Input::open(&inside(folder, name)?, &watch)?.rest(limit, "it");
                read().with_context(|| name.to_owned())
            }
            Self::Archive(archive, _) => {
                if archive.index_for_name(name).is_none()
                    && let Some(Ok(other)) = archive.file_names().next()
                {
                    bail!("the zip archive has no {name}, but {other}: unpack it first if that is a scene");
                }
                let file = match archive.by_name(name) {
                    Err(ZipError::FileNotFound) => bail!("the zip archive has no {name}"),
                    file => file.with_context(|| format!("{name} cannot be unpacked"))?,
                };
                // Grows with the content: the stated size may be wrong.
                let mut bytes = Vec::new();
                file.take(limit + 1).read_to_end(&mut bytes).with_context(|| format!("{name} cannot be unpacked"))?;
                ensure!(bytes.len() as u64 <= limit, "{name} has over {limit} bytes");
                Ok(bytes)
            }
        }
    }

    /// Size of these files on disk in bytes; for an archive, its whole size.
    pub fn bytes(&self, names: &[&str]) -> Result<u64> {
        match self {
            Self::Archive(_, len) => Ok(*len),
            Self::Folder(folder) => names.iter().try_fold(0_u64, |sum, name| {
                let metadata = std::fs::metadata(inside(folder, name)?);
                let metadata = metadata.map_err(|e| anyhow!("{name}: cannot be opened: {}", describe(&e)))?;
                Ok(sum.saturating_add(metadata.len()))
            }),
        }
    }
}
