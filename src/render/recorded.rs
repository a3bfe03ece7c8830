//! Frames that are recorded, on the GPU, or finished.

use super::lod::{Chooser, Detailed};
use super::path::{Limits, Path};
use super::shaders::{CutState, Totals};
use super::slabs::{Drawn, Parts};
use super::streaming::Demand;
use crate::gpu::{InFlight, Readback, Results, Timing};
use crate::options::Options;

/// The report of a finished frame.
#[derive(Clone, Debug)]
pub struct Frame {
    /// The counts of the frame.
    pub totals: Totals,
    /// The measured times: of every stage, or only of the frame, as
    /// [`Renderer::set_timestamps`](super::renderer::Renderer::set_timestamps) says.
    pub timings: Vec<Timing>,
    /// Times that the frame was drawn: more than one if something did not fit at first.
    pub attempts: u32,
    pub path: Path,
    /// Set if it was drawn in parts.
    pub parts: Option<Parts>,
    /// Set if it was drawn by levels of detail.
    pub detail: Option<Detailed>,
}

/// A frame on the GPU.
pub struct Started {
    pub(super) commands: InFlight,
    pub(super) recorded: Recorded,
}

/// A recorded frame. When its commands have run, [`Renderer::judge`](super::Renderer::judge) tells whether it is
/// complete.
pub struct Recorded {
    pub(super) number: u64,
    pub(super) counted: Counted,
    pub(super) limits: Limits,
}

/// The counts of a recorded frame.
pub(super) enum Counted {
    /// They are there when its commands have run.
    OnDevice(Readback<Totals>),
    /// The same, of a scene in pages.
    OfPages(Readback<Totals>, OfPages),
    /// The frame is drawn already, in slabs.
    Here(Box<Drawn>),
}

/// What a frame of a scene in pages that was drawn at once tells of these.
pub(super) struct OfPages {
    pub state: Readback<CutState>,
    /// Set if it does not wait for pages.
    pub demand: Option<Demand>,
}

impl Recorded {
    pub(super) fn parts(&self) -> Option<Parts> {
        match &self.counted {
            Counted::Here(drawn) => Some(drawn.parts),
            Counted::OnDevice(_) | Counted::OfPages(..) => None,
        }
    }

    /// What the levels of detail were cut to, if they were.
    pub(super) fn detail(&self, results: &Results, options: &Options) -> Option<Detailed> {
        match &self.counted {
            Counted::Here(drawn) => drawn.detail,
            Counted::OnDevice(_) => None,
            Counted::OfPages(_, pages) => Chooser::detail(&results.view(&pages.state)[0], options),
        }
    }

    /// The timings of the frame, from those of its commands.
    pub(super) fn timings(&self, own: &[Timing]) -> Vec<Timing> {
        let Counted::Here(drawn) = &self.counted else { return own.to_vec() };
        let whole: f64 = drawn.timings.iter().map(|stage| stage.duration_ms).sum();
        let longer = |timing: &Timing| Timing { duration_ms: timing.duration_ms + whole, ..timing.clone() };
        let own = own.iter().map(|timing| if timing.depth == 0 { longer(timing) } else { timing.clone() });
        drawn.timings.iter().cloned().chain(own).collect()
    }
}
