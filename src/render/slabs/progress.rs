//! The progress of a frame in slabs, the same on both paths: its partition and its report.

use std::ops::Range;
use std::time::Instant;

use super::input::SlabInput;
use super::partition::SlabPartition;
use super::report::SlabReport;
use crate::gpu::Timing;
use crate::render::frame::SortPosition;
use crate::render::lod::{LodReport, Selection};
use crate::render::shaders::Totals;

/// The counts, times and report of a frame that was drawn in slabs.
#[derive(Clone, Debug)]
pub struct SlabbedFrame {
    /// The sums over all slabs; of the longest list and of the listed tiles, the most of any slab.
    pub totals: Totals,
    /// The sums over all slabs, by stage.
    pub timings: Vec<Timing>,
    pub report: SlabReport,
    /// Set if the frame was drawn by levels of detail.
    pub detail: Option<LodReport>,
}

/// A frame that is being drawn.
pub struct FrameProgress {
    pub partition: SlabPartition,
    drawn: SlabbedFrame,
    begun: Instant,
    /// The number of splats that the first slab should have when it fitted.
    first_target: Option<f64>,
}

/// The most splats that a slab of a scene in pages should have. After each slab, the pages that it hides are no longer
/// read.
const PAGED_SPLATS: f64 = 1.0e6;

impl FrameProgress {
    /// Begins a frame of the positions before `end`, of a scene with `indices` Gaussians. `target`: the number of
    /// splats that its first slab should have.
    pub fn begin(
        input: &mut SlabInput,
        end: SortPosition,
        indices: usize,
        target: f64,
        selection: Option<&Selection>,
    ) -> Self {
        let estimate = input.estimate(end);
        let most = if input.is_paged() { PAGED_SPLATS.max(estimate.splats() / 24.0) } else { f64::INFINITY };
        let totals = bytemuck::Zeroable::zeroed();
        let detail = selection.and_then(|selection| selection.detail);
        let drawn = SlabbedFrame { totals, timings: Vec::new(), report: input.begin_report(), detail };
        let partition = SlabPartition::new(estimate, indices, target, most);
        let mut progress = Self { partition, drawn, begun: Instant::now(), first_target: None };
        progress.add_timings(selection.map_or(&[], |selection| selection.results.timings()));
        progress
    }

    /// Adds the times of some stages, which become the inner scopes of the frame.
    pub fn add_timings(&mut self, stages: &[Timing]) {
        let sum = &mut self.drawn.timings;
        for timing in stages {
            match sum.iter_mut().find(|known| known.name == timing.name) {
                Some(known) => known.duration_ms += timing.duration_ms,
                None => sum.push(Timing { depth: 1, ..timing.clone() }),
            }
        }
    }

    /// Adds the counts of a slab.
    pub fn add_totals(&mut self, totals: &Totals) {
        self.drawn.totals = self.drawn.totals.plus(totals);
    }

    /// Continues behind a slab that was blended, and that filled this fraction of the capacity.
    pub fn add_slab(&mut self, slab: &Range<SortPosition>, filled: f64, totals: &Totals) {
        self.first_target.get_or_insert(self.partition.target());
        self.partition.advance(slab, filled);
        self.add_totals(totals);
        self.drawn.report.slabs += 1;
    }

    /// The finished frame, and the target of the first slab of the next one, which is then likely to fit.
    pub fn end(mut self, input: &SlabInput) -> (SlabbedFrame, f64) {
        let wall_ms = 1e3 * self.begun.elapsed().as_secs_f64();
        self.drawn.report = SlabReport { wall_ms, ..input.end_report(self.drawn.report) };
        let target = self.first_target.filter(|_| self.drawn.report.slabs > 1);
        (self.drawn, target.unwrap_or(f64::INFINITY))
    }
}
