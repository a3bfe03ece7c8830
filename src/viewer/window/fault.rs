//! Faults to inject for tests of recovery, set by the environment variable SMALTO_FAULT.

use std::str::FromStr;

use anyhow::{Context, Result};

/// A fault to inject, and the number of its frame: `device@100`, `surface@100` or `memory@100`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Fault {
    pub(crate) kind: FaultKind,
    pub(crate) frame: u64,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum FaultKind {
    DeviceLost,
    SurfaceLost,
    OutOfMemory,
}

impl Fault {
    /// True in its frame if it is the loss of the device.
    #[cfg(feature = "serve")]
    pub(crate) fn is_loss_in(&self, frame: u64) -> bool {
        self.kind == FaultKind::DeviceLost && self.frame == frame
    }
}

impl FromStr for Fault {
    type Err = anyhow::Error;

    fn from_str(text: &str) -> Result<Self> {
        let (kind, frame) = text.split_once('@').context("expected device@N, surface@N or memory@N")?;
        let kind = match kind {
            "device" => FaultKind::DeviceLost,
            "surface" => FaultKind::SurfaceLost,
            "memory" => FaultKind::OutOfMemory,
            _ => anyhow::bail!("there is no fault {kind}"),
        };
        Ok(Self { kind, frame: frame.parse().context("expected the number of a frame")? })
    }
}
