//! Progress, partial scenes and cancelling while a scene is read.

use super::Builder;

/// Callbacks while a scene is read. All are called on the reading thread.
#[derive(Clone, Copy)]
pub struct Watch<'w> {
    /// Gets the fraction of the file that was read, 0 to 1.
    pub progress: &'w dyn Fn(f64),
    /// Gets the Gaussians decoded so far, in the order of the scene: first when there are 65,536 or more, then whenever
    /// their number has doubled. It is not called with the complete scene.
    pub partial: &'w dyn Fn(&Builder),
    /// Asked about 200 times per file and once every 65,536 Gaussians. Once it returns true, and keeps doing so,
    /// reading ends with [`Cancelled`].
    pub is_cancelled: &'w dyn Fn() -> bool,
}

impl<'w> Watch<'w> {
    /// Reads to the end, and reports nothing.
    pub const NONE: Watch<'static> = Watch { progress: &|_| {}, partial: &|_| {}, is_cancelled: &|| false };

    /// Reads to the end, and reports only the progress.
    pub fn of_progress(progress: &'w dyn Fn(f64)) -> Self {
        Self { progress, ..Self::NONE }
    }
}

/// The error when reading was cancelled by [`Watch::is_cancelled`].
#[derive(Debug, thiserror::Error)]
#[error("cancelled")]
pub struct Cancelled;
