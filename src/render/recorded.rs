//! Frames: recorded, on the GPU, or finished.

use super::lod::{LodReport, LodSelector, SampledPsnr};
use super::path::{Limits, Path};
use super::shaders::{SelectionState, Totals};
use super::slabs::{SlabReport, SlabbedFrame};
use super::streaming::PageRequests;
use crate::gpu::{InFlight, Readback, Results, Timing};
use crate::options::Options;

/// The report of a finished frame.
#[derive(Clone, Debug)]
pub struct Frame {
    /// The counts of the frame.
    pub totals: Totals,
    /// The measured times: of every stage, or only of the frame, by
    /// [`Renderer::set_timestamps`](super::renderer::Renderer::set_timestamps).
    pub timings: Vec<Timing>,
    /// The number of attempts: more than one if the frame did not fit its buffers at first.
    pub attempts: u32,
    pub path: Path,
    /// Set if it was drawn in slabs.
    pub parts: Option<SlabReport>,
    /// Set if it was drawn by levels of detail.
    pub detail: Option<LodReport>,
}

impl Frame {
    /// The time of the whole frame on the GPU, in milliseconds.
    pub fn gpu_ms(&self) -> f64 {
        self.timings.iter().filter(|timing| timing.depth == 0).map(|timing| timing.duration_ms).sum()
    }
}

/// A frame on the GPU.
pub struct Started {
    pub(super) commands: InFlight,
    pub(super) recorded: Recorded,
}

/// A recorded frame. When its commands have run, [`Renderer::judge`](super::Renderer::judge) decides whether it is
/// complete.
pub struct Recorded {
    pub(super) number: u64,
    pub(super) counted: Counted,
    pub(super) limits: Limits,
    /// The PSNR by which its levels were chosen, if they were.
    pub(super) sampled: Option<SampledPsnr>,
}

/// The counts of a recorded frame.
pub(super) enum Counted {
    /// A frame of a whole scene, which counts when its commands run.
    Whole(Readback<Totals>),
    /// A frame of a scene in pages, which counts when its commands run.
    Paged(Readback<Totals>, PagedCounts),
    /// A frame in slabs, which is finished when it is recorded.
    Slabbed(Box<SlabbedFrame>),
}

/// The counts of the pages of a frame that is drawn without slabs.
pub(super) struct PagedCounts {
    pub state: Readback<SelectionState>,
    /// The requested pages, if the frame does not wait for missing ones.
    pub requests: Option<PageRequests>,
}

impl Recorded {
    pub(super) fn parts(&self) -> Option<SlabReport> {
        match &self.counted {
            Counted::Slabbed(drawn) => Some(drawn.report),
            Counted::Whole(_) | Counted::Paged(..) => None,
        }
    }

    /// The report of the levels of detail, if the frame was drawn by them.
    pub(super) fn detail(&self, results: &Results, options: &Options) -> Option<LodReport> {
        let detail = match &self.counted {
            Counted::Slabbed(drawn) => drawn.detail,
            Counted::Whole(_) => None,
            Counted::Paged(_, pages) => LodSelector::report(&results.view(&pages.state)[0], options),
        };
        detail.map(|detail| self.sampled.map_or(detail, |sampled| detail.with(&sampled)))
    }

    /// The timings of the frame, from the timings of its commands.
    pub(super) fn timings(&self, own: &[Timing]) -> Vec<Timing> {
        let Counted::Slabbed(drawn) = &self.counted else { return own.to_vec() };
        let whole: f64 = drawn.timings.iter().map(|stage| stage.duration_ms).sum();
        let longer = |timing: &Timing| Timing { duration_ms: timing.duration_ms + whole, ..timing.clone() };
        let own = own.iter().map(|timing| if timing.depth == 0 { longer(timing) } else { timing.clone() });
        drawn.timings.iter().cloned().chain(own).collect()
    }
}
