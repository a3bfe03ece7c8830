//! The report of a frame that was drawn in slabs.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// How a frame was drawn in parts.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(rename = "Parts")]
pub struct SlabReport {
    /// Parts in depth that were drawn one after another.
    pub slabs: u32,
    /// Wall time of the whole frame, with the waits for its pages.
    pub wall_ms: f64,
    /// Pages of the scene that lie in the view; 0 if the scene is on the device as a whole, as are the next two.
    pub pages_in_view: u64,
    /// Pages that were read for the frame: those that are not hidden and were not on the device.
    pub pages_read: u64,
    /// Bytes of these pages.
    pub bytes_read: u64,
}
