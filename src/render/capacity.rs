//! The capacity that a frame needs and that its buffers have, and its growth.

use anyhow::Result;

use super::shaders::{Splat, Totals};
use crate::gpu::Device;
use crate::host_memory::OutOfMemory;

/// The most attempts to draw a frame, which no frame needs. Buffers grow to the demand of the attempt before. An
/// overflow hides the demand of the next stage (visible, spans and listed, list length), so a frame may need one retry
/// per stage, and one more for the change of path.
pub(crate) const MAX_ATTEMPTS: u32 = 10;

/// The numbers of elements that the buffers of a frame hold, or that a frame needs. Splats are listed in cells: tiles
/// of the portable path, bins of the fast path.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Capacity {
    /// All Gaussians of the scene.
    pub gaussians: usize,
    /// Gaussians that may touch the image.
    pub visible: u64,
    /// Rows of cells touched, over all splats.
    pub spans: u64,
    /// Cells touched, over all splats: instances of the portable path, entries of the fast path.
    pub listed: u64,
    /// Cells of the image.
    pub cells: usize,
}

impl Capacity {
    /// A first guess for a scene on the portable path, within what the device can bind. A frame that needs more reports
    /// it and is drawn again.
    pub fn guess(device: &Device, gaussians: usize, cells: usize) -> Self {
        let most = |bytes: usize| device.capabilities().limits.storage_range / bytes as u64;
        // Captured scenes at 1080p: half of the Gaussians are visible, in 2.3 rows and 6 tiles each.
        let visible = (gaussians as u64 / 4 * 3 + 1024).min(gaussians as u64).min(most(size_of::<Splat>()));
        let listed = (6 * visible).max(1 << 16);
        Self { gaussians, visible, spans: (2 * visible).min(most(4)), listed: listed.min(most(4)), cells }
    }

    /// The capacity that a frame with these totals needs.
    pub fn of(totals: &Totals, gaussians: usize, cells: usize) -> Self {
        Self { gaussians, visible: totals.visible.into(), spans: totals.spans.into(), listed: totals.listed(), cells }
    }

    fn max(self, other: Self) -> Self {
        Self {
            gaussians: self.gaussians.max(other.gaussians),
            visible: self.visible.max(other.visible),
            spans: self.spans.max(other.spans),
            listed: self.listed.max(other.listed),
            cells: self.cells.max(other.cells),
        }
    }

    /// The larger of `self` and `current`: first with an eighth to spare where `current` is not enough, then without.
    fn beyond(self, current: Self) -> [Self; 2] {
        let spare = |needed: u64, current: u64| if needed > current { needed + needed / 8 } else { current };
        let exact = self.max(current);
        let roomy = Self {
            visible: spare(self.visible, current.visible).min(exact.gaussians as u64),
            spans: spare(self.spans, current.spans),
            listed: spare(self.listed, current.listed),
            ..exact
        };
        [roomy, exact]
    }

    /// True if no number exceeds that of `capacity`.
    pub(super) fn fits(self, capacity: Self) -> bool {
        self.max(capacity) == capacity
    }

    /// Makes buffers that are large enough for `self` and `current`, with some to spare if memory allows.
    pub(super) fn grow<T>(self, current: Self, make: impl Fn(Self) -> Result<T>) -> Result<T> {
        let [roomy, exact] = self.beyond(current);
        match make(roomy) {
            Err(error) if error.is::<OutOfMemory>() => make(exact),
            other => other,
        }
    }
}

/// False if the result is [`OutOfMemory`].
pub(super) fn has_memory(result: Result<()>) -> Result<bool> {
    match result {
        Err(error) if error.is::<OutOfMemory>() => Ok(false),
        other => other.map(|()| true),
    }
}

/// `elements` as the length of the buffer `name`.
///
/// # Errors
/// If 32-bit offsets do not reach the end of the buffer.
pub(super) fn length(name: &str, elements: u64) -> Result<usize, OutOfMemory> {
    let refusal = |_| OutOfMemory {
        name: name.to_owned(),
        bytes: Some(elements.saturating_mul(4)),
        reason: "32-bit offsets reach no further".to_owned(),
    };
    u32::try_from(elements).map(|length| length as usize).map_err(refusal)
}
