//! Simulated faults of reading, for tests.

use std::str::FromStr;
use std::sync::OnceLock;
use std::time::Duration;

use anyhow::{Context, Result, bail};

/// A fault of every page file that the process reads.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ReadFault {
    /// The read of the page with this number fails: `page@N`.
    Page(usize),
    /// Each read takes this time longer: `slow@MS`.
    Slow(Duration),
}

static FAULT: OnceLock<ReadFault> = OnceLock::new();

/// Simulates a fault until the process ends. Later calls have no effect.
pub fn simulate(fault: ReadFault) {
    _ = FAULT.set(fault);
}

/// The simulated fault.
pub(crate) fn simulated() -> Option<ReadFault> {
    FAULT.get().copied()
}

impl FromStr for ReadFault {
    type Err = anyhow::Error;

    fn from_str(text: &str) -> Result<Self> {
        let (kind, number) = text.split_once('@').context("expected page@N or slow@MS")?;
        Ok(match kind {
            "page" => Self::Page(number.parse().context("expected the number of a page")?),
            "slow" => Self::Slow(Duration::from_millis(number.parse().context("expected a time in milliseconds")?)),
            _ => bail!("there is no fault {kind}"),
        })
    }
}
