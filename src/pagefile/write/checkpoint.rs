//! The state of an interrupted conversion, which is kept beside the output as JSON.

use std::path::Path;

use anyhow::Result;
use serde::{Deserialize, Serialize};

use crate::files::hash_of;

/// The identity of a conversion: its source and its settings. Another run resumes only if it is equal.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Work {
    /// The version of this record.
    pub version: u32,
    /// The name of the source, its length, and the BLAKE3 hash of its content.
    pub source: String,
    pub bytes: u64,
    pub hash: String,
    /// All settings on which the output depends.
    pub settings: String,
}

/// The progress of a conversion. It is kept once all Gaussians are in buckets.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct State {
    pub work: Work,
    /// Gaussians in each bucket.
    pub buckets: Vec<usize>,
    /// Buckets whose pages are written.
    pub done: usize,
    /// Gaussians that are written.
    pub written: usize,
    /// Notices about the source.
    pub notices: Vec<String>,
}

impl Work {
    /// The work on a source, without the hash of its content: [`Work::hashed`]. `None` if the source has no name.
    pub fn on(source: &Path, settings: &impl std::fmt::Debug) -> Option<Self> {
        Some(Self {
            version: 3,
            source: source.canonicalize().ok()?.display().to_string(),
            bytes: source.metadata().ok()?.len(),
            hash: String::new(),
            settings: format!("{settings:?}"),
        })
    }

    /// The work with the hash of what the source holds now. `check` is called between reads and may end it.
    ///
    /// # Errors
    /// That of `check`; if the source cannot be read.
    pub fn hashed(self, check: impl Fn() -> Result<()>) -> Result<Self> {
        let (_, hash) = hash_of(Path::new(&self.source), check)?;
        Ok(Self { hash, ..self })
    }
}
