//! Progress, partial scenes and cancelling while a scene is read.

use super::Builder;

/// Who waits for a scene to be read. All are called on the thread that reads.
#[derive(Clone, Copy)]
pub struct Watch<'w> {
    /// Told the fraction of the file read so far.
    pub progress: &'w dyn Fn(f64),
    /// Shown what was decoded so far, in the order of the scene: first when they are 65,536 or more, then whenever
    /// they have doubled, and never when they are all.
    pub partial: &'w dyn Fn(&Builder),
    /// Asked now and then, some 200 times a file and once every 65,536 Gaussians. When it says so, and goes on saying
    /// so, reading ends with [`Cancelled`].
    pub is_cancelled: &'w dyn Fn() -> bool,
}

/// No one waits for the scene any more: reading was cancelled by [`Watch::is_cancelled`].
#[derive(Debug, thiserror::Error)]
#[error("cancelled")]
pub struct Cancelled;
