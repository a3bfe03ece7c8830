//! Frames: recorded, on the GPU, or finished.

use super::lod::{LodReport, LodSelector, SampledPsnr};
use super::path::{Limits, Path};
use super::shaders::{SelectionState, Totals};
use super::slabs::{SlabReport, SlabbedFrame};
use super::streaming::PageRequests;
use crate::gpu::{InFlight, Readback, Results, Timing};
use crate::options::Options;

/// The name of the scope that holds the stages of a frame.
pub(super) const FRAME: &str = "frame";

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
    /// GPU time of the first picture, which was drawn for its stop depths, ms.
    pub(super) first_picture_ms: f64,
}

/// The counts of a recorded frame.
pub(super) enum Counted {
    /// A frame of a whole scene, which counts when its commands run.
    Whole(Readback<Totals>),
    /// A frame of a scene in pages, which counts when its commands run.
    Paged(Readback<Totals>, PagedCounts),
    /// A frame in slabs, or joined from bands of several devices, which is finished when it is recorded.
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

    /// Takes the timings of the frame from the front of those of its commands, which may hold more frames: up to the
    /// scope of the frame, and of its packing. Those of its slabs and of the first picture, which had commands of their
    /// own, are added.
    pub fn take_timings(&self, of_commands: &mut &[Timing]) -> Vec<Timing> {
        let is_frame = |timing: &Timing| timing.depth == 0 && timing.name == FRAME;
        let end = of_commands.iter().position(is_frame).map_or(of_commands.len(), |frame| frame + 1);
        let packed = of_commands[end..].iter().take_while(|timing| timing.name == "pack").count();
        let (own, rest) = of_commands.split_at(end + packed);
        *of_commands = rest;
        let first = (self.first_picture_ms > 0.0).then_some(Timing {
            name: "first picture",
            depth: 1,
            start_ms: 0.0,
            duration_ms: self.first_picture_ms,
        });
        let mut all: Vec<Timing> = first.into_iter().chain(self.slabs().iter().chain(own).cloned()).collect();
        let elsewhere = self.elsewhere_ms();
        all.iter_mut().filter(|timing| is_frame(timing)).for_each(|frame| frame.duration_ms += elsewhere);
        all
    }

    /// The timings of the stages of its slabs, or of its bands.
    fn slabs(&self) -> &[Timing] {
        match &self.counted {
            Counted::Slabbed(drawn) => &drawn.timings,
            Counted::Whole(_) | Counted::Paged(..) => &[],
        }
    }

    /// The GPU time of other commands than the frame's own, ms.
    fn elsewhere_ms(&self) -> f64 {
        self.first_picture_ms + self.slabs().iter().map(|stage| stage.duration_ms).sum::<f64>()
    }

    /// The GPU time of the frame's own commands in milliseconds, without that of slabs or bands, which had others. The
    /// timings are those of [`Recorded::take_timings`].
    pub fn own_ms(&self, timings: &[Timing]) -> f64 {
        let all: f64 = timings.iter().filter(|timing| timing.depth == 0).map(|timing| timing.duration_ms).sum();
        all - self.elsewhere_ms()
    }
}

#[cfg(test)]
mod tests {
    use super::super::capacity::Capacity;
    use super::*;

    fn recorded(counted: SlabbedFrame) -> Recorded {
        let limits = Limits { path: Path::Fast, in_slabs: true, capacity: Capacity::default(), longest_list: 0 };
        Recorded {
            number: 0,
            counted: Counted::Slabbed(Box::new(counted)),
            limits,
            sampled: None,
            first_picture_ms: 0.0,
        }
    }

    /// Two pictures of one submission: each takes its own times, and a frame's hold those of its slabs once.
    #[test]
    fn the_time_of_a_frame_holds_that_of_its_slabs() {
        let timing = |name, depth, duration_ms| Timing { name, depth, start_ms: 0.0, duration_ms };
        let (totals, report) = (bytemuck::Zeroable::zeroed(), SlabReport::default());
        let slabs = vec![timing("sort", 1, 2.0), timing("blend", 1, 5.0)];
        let slabbed = recorded(SlabbedFrame { totals, timings: slabs, report, detail: None });
        let (upscale, frame, pack) = (timing("upscale", 1, 1.0), timing(FRAME, 0, 1.0), timing("pack", 0, 0.5));
        let all = [upscale, frame.clone(), pack.clone(), frame, timing("display", 0, 0.25)];
        let mut left = all.as_slice();
        let names =
            |timings: &[Timing]| timings.iter().map(|timing| (timing.name, timing.duration_ms)).collect::<Vec<_>>();
        let first = slabbed.take_timings(&mut left);
        assert_eq!(names(&first), [("sort", 2.0), ("blend", 5.0), ("upscale", 1.0), (FRAME, 8.0), ("pack", 0.5)]);
        assert_eq!(slabbed.own_ms(&first), 1.5);
        assert_eq!(names(&slabbed.take_timings(&mut left)[2..]), [(FRAME, 8.0)]);
        assert_eq!(names(left), [("display", 0.25)]);
        // And that of a first picture.
        let behind_another = Recorded { first_picture_ms: 4.0, ..slabbed };
        let first = behind_another.take_timings(&mut all.as_slice());
        assert_eq!(names(&first)[..2], [("first picture", 4.0), ("sort", 2.0)]);
        assert_eq!((names(&first)[4], behind_another.own_ms(&first)), ((FRAME, 12.0), 1.5));
    }
}
