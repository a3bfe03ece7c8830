//! The state of an interrupted conversion, which is kept beside the output as JSON.

use std::path::Path;
use std::time::UNIX_EPOCH;

use serde::{Deserialize, Serialize};

/// The identity of a conversion: its source and its settings. Another run resumes only if it is equal.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Work {
    /// The version of this record.
    pub version: u32,
    /// The name of the source, its length, and the time of its last change since 1970.
    pub source: String,
    pub bytes: u64,
    pub modified_ns: u64,
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
    /// The work on the current state of a source. `None` if the system does not report its time of change.
    pub fn on(source: &Path, settings: &impl std::fmt::Debug) -> Option<Self> {
        let data = source.metadata().ok()?;
        let modified = data.modified().ok()?.duration_since(UNIX_EPOCH).ok()?;
        Some(Self {
            version: 2,
            source: source.canonicalize().ok()?.display().to_string(),
            bytes: data.len(),
            modified_ns: u64::try_from(modified.as_nanos()).ok()?,
            settings: format!("{settings:?}"),
        })
    }
}
