//! The course of a frame in slabs, the same on both paths: where it is cut, and its report.

use std::ops::Range;
use std::time::Instant;

use super::input::Supply;
use super::partition::{Ends, Place};
use super::report::Parts;
use crate::gpu::Timing;
use crate::render::lod::{Chosen, Detailed};
use crate::render::shaders::Totals;

/// The report of a frame that was drawn in slabs.
#[derive(Clone, Debug)]
pub struct Drawn {
    /// The sums over all slabs; of the longest list and of the listed tiles, the most of any slab.
    pub totals: Totals,
    /// The sums over all slabs, by stage.
    pub timings: Vec<Timing>,
    pub parts: Parts,
    /// Set if it was drawn by levels of detail.
    pub detail: Option<Detailed>,
}

/// A frame that is being drawn.
pub struct Course {
    pub ends: Ends,
    drawn: Drawn,
    begun: Instant,
    /// The splats that the first slab was meant to have when it fitted.
    first_target: Option<f64>,
}

/// The most splats that a slab of a scene in pages is meant to have. After each slab, what is hidden by then is not
/// read any more.
const PAGED_SPLATS: f64 = 1.0e6;

impl Course {
    /// Begins a frame of places before `end`, of a scene with so many indices. `target`: the splats that its first slab
    /// is meant to have.
    pub fn begin(supply: &mut Supply, end: Place, indices: usize, target: f64) -> Self {
        let estimate = supply.estimate(end);
        let most = if supply.is_paged() { PAGED_SPLATS.max(estimate.splats() / 24.0) } else { f64::INFINITY };
        let totals = bytemuck::Zeroable::zeroed();
        let drawn = Drawn { totals, timings: Vec::new(), parts: supply.parts(), detail: None };
        Self { ends: Ends::new(estimate, indices, target, most), drawn, begun: Instant::now(), first_target: None }
    }

    /// Notes how the pages were chosen.
    pub fn chose(&mut self, chosen: Option<&Chosen>) {
        if let Some(chosen) = chosen {
            self.took(chosen.results.timings());
            self.drawn.detail = chosen.detail;
        }
    }

    /// Adds the times of some stages, which become the inner scopes of the frame.
    pub fn took(&mut self, stages: &[Timing]) {
        let sum = &mut self.drawn.timings;
        for timing in stages {
            match sum.iter_mut().find(|known| known.name == timing.name) {
                Some(known) => known.duration_ms += timing.duration_ms,
                None => sum.push(Timing { depth: 1, ..timing.clone() }),
            }
        }
    }

    /// Adds the counts of a slab.
    pub fn count(&mut self, totals: &Totals) {
        self.drawn.totals = sum(&self.drawn.totals, totals);
    }

    /// Goes on behind a slab that was blended, and that filled this part of the capacity.
    pub fn blended(&mut self, slab: &Range<Place>, filled: f64, totals: &Totals) {
        self.first_target.get_or_insert(self.ends.target());
        self.ends.drawn(slab, filled);
        self.count(totals);
        self.drawn.parts.slabs += 1;
    }

    /// The report of the frame, and the target of the first slab of the next one, which is then likely to fit.
    pub fn end(mut self, supply: &Supply) -> (Drawn, f64) {
        let wall_ms = 1e3 * self.begun.elapsed().as_secs_f64();
        self.drawn.parts = Parts { wall_ms, ..supply.since(self.drawn.parts) };
        let target = self.first_target.filter(|_| self.drawn.parts.slabs > 1);
        (self.drawn, target.unwrap_or(f64::INFINITY))
    }
}

/// The counts of two slabs together.
fn sum(one: &Totals, other: &Totals) -> Totals {
    let [low, high] = [|sum: u64| sum as u32, |sum: u64| (sum >> 32) as u32];
    let listed = one.listed() + other.listed();
    let evaluations = one.evaluations() + other.evaluations();
    let walked = one.walked() + other.walked();
    Totals {
        visible: one.visible.saturating_add(other.visible),
        visible_kept: one.visible_kept.saturating_add(other.visible_kept),
        spans: one.spans.saturating_add(other.spans),
        listed_low: low(listed),
        listed_high: high(listed),
        listed_kept: one.listed_kept.saturating_add(other.listed_kept),
        longest_list: one.longest_list.max(other.longest_list),
        evaluations_low: low(evaluations),
        evaluations_high: high(evaluations),
        walked_low: low(walked),
        walked_high: high(walked),
        stopped_pixels: one.stopped_pixels + other.stopped_pixels,
        listed_tiles: one.listed_tiles.max(other.listed_tiles),
        tiles_in_class: one.tiles_in_class,
    }
}
