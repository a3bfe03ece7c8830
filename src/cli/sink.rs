//! The destination of a report: a file, or standard output in place of the tables.

use std::ffi::OsString;
use std::io::Write;
use std::path::{Path, PathBuf};

use anyhow::Result;
use serde::Serialize;

use super::printed;
use crate::files::{check_writable, write_whole};

/// The value `FILE|-` of an option.
#[derive(Clone, Debug)]
pub(super) enum Sink {
    /// `-`
    Stdout,
    File(PathBuf),
}

impl From<OsString> for Sink {
    fn from(text: OsString) -> Self {
        if text == "-" { Self::Stdout } else { Self::File(text.into()) }
    }
}

impl Sink {
    /// The file; `None` for standard output.
    pub fn file(&self) -> Option<&Path> {
        match self {
            Self::Stdout => None,
            Self::File(file) => Some(file),
        }
    }

    /// Fails before anything is computed if the file cannot be written.
    pub fn check(&self) -> Result<()> {
        self.file().map_or(Ok(()), check_writable)
    }

    /// Writes the report as JSON.
    pub fn write_json(&self, report: &impl Serialize) -> Result<()> {
        self.write(|out| {
            serde_json::to_writer_pretty(&mut *out, report)?;
            Ok(writeln!(out)?)
        })
    }

    /// Writes what `write` produces. A closed pipe is not an error.
    pub fn write(&self, write: impl FnOnce(&mut dyn Write) -> Result<()>) -> Result<()> {
        if let Self::File(file) = self {
            return write_whole(file, |out| write(out));
        }
        let mut text = Vec::new();
        write(&mut text)?;
        printed(std::io::stdout().write_all(&text).and_then(|()| std::io::stdout().flush()))
    }
}
