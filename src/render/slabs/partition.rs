//! The partition of a frame into slabs.

use std::ops::Range;

use crate::render::frame::{SortPosition, position_of};

/// The fraction of their capacity that slabs should fill. The rest covers the error of the estimate.
const FILL: f64 = 0.7;

/// Steps of an estimate.
const STEPS: usize = 2048;

/// The expected distribution of the splats of a frame over sort positions.
#[derive(Debug)]
pub struct Estimate {
    end: SortPosition,
    /// Splats expected before the end of each step; all steps have the same number of positions.
    before: Vec<f64>,
}

impl Estimate {
    /// A uniform distribution of `splats` below `end`.
    pub fn uniform(end: SortPosition, splats: f64) -> Self {
        Self { end, before: (1..=STEPS).map(|step| splats * step as f64 / STEPS as f64).collect() }
    }

    /// The distribution of groups of splats: the depth keys of each (both ends included) and its number of splats.
    pub fn of(end: SortPosition, groups: impl Iterator<Item = ([u32; 2], u32)>) -> Self {
        // The differences of the density from step to step.
        let mut changes = vec![0.0; STEPS + 1];
        let step = |key: u32| (u128::from(position_of(key)) * STEPS as u128 / u128::from(end.max(1))) as usize;
        for (keys, splats) in groups {
            let [first, last] = keys.map(|key| step(key).min(STEPS - 1));
            let each = f64::from(splats) / (last - first + 1) as f64;
            changes[first] += each;
            changes[last + 1] -= each;
        }
        let (mut density, mut sum) = (0.0, 0.0);
        let before = changes[..STEPS].iter().map(|change| {
            density += change;
            sum += f64::max(density, 0.0);
            sum
        });
        Self { end, before: before.collect() }
    }

    /// The number of all splats.
    pub fn splats(&self) -> f64 {
        self.before[STEPS - 1]
    }

    /// The number of splats expected before a position.
    fn before(&self, position: SortPosition) -> f64 {
        let at = position as f64 / self.end.max(1) as f64 * STEPS as f64;
        let step = (at as usize).min(STEPS - 1);
        let start = if step == 0 { 0.0 } else { self.before[step - 1] };
        start + (self.before[step] - start) * (at - step as f64).min(1.0)
    }

    /// The position before which this number of splats is expected.
    fn position(&self, splats: f64) -> SortPosition {
        let step = self.before.partition_point(|before| *before < splats);
        if step >= STEPS {
            return self.end;
        }
        let start = if step == 0 { 0.0 } else { self.before[step - 1] };
        let fraction = (splats - start) / (self.before[step] - start).max(1e-9);
        (((step as f64 + fraction.clamp(0.0, 1.0)) / STEPS as f64 * self.end as f64) as SortPosition).min(self.end)
    }
}

/// Cuts a frame into slabs that fit, by an estimate and by the demand of the slabs before.
#[derive(Debug)]
pub struct SlabPartition {
    estimate: Estimate,
    /// The number of indices of Gaussians, and so of the positions that a depth key has.
    indices: u64,
    begin: SortPosition,
    /// The number of splats that the next slab should have.
    target: f64,
    /// The most splats that a slab should have.
    most: f64,
    /// The most positions of the next slab, after one that did not fit.
    longest: u64,
}

impl SlabPartition {
    /// Begins a frame whose first slab should have `target` splats, and none more than `most`.
    pub fn new(estimate: Estimate, indices: usize, target: f64, most: f64) -> Self {
        let target = target.min(most).min(estimate.splats()).max(1.0);
        Self { estimate, indices: indices as u64, begin: 0, target, most, longest: u64::MAX }
    }

    /// Replaces the estimate.
    pub fn set_estimate(&mut self, estimate: Estimate) {
        self.estimate = estimate;
    }

    /// The next slab; `None` at the end of the frame.
    pub fn next(&self) -> Option<Range<SortPosition>> {
        self.after(self.begin)
    }

    /// The probable slab from `begin` on.
    pub fn after(&self, begin: SortPosition) -> Option<Range<SortPosition>> {
        let Estimate { end, .. } = self.estimate;
        if begin >= end {
            return None;
        }
        let next = self.estimate.position(self.estimate.before(begin) + self.target);
        // A small rest is added to the last slab.
        let rest = self.estimate.splats() - self.estimate.before(next);
        let next = if rest < self.target / 8.0 { end } else { next.max(begin + 1) };
        let next = next.min(begin.saturating_add(self.longest));
        // Behind the last index of a key lies the next key.
        let is_behind = next & u64::from(u32::MAX) >= self.indices;
        Some(begin..if is_behind { position_of((next >> 32) as u32 + 1).min(end) } else { next })
    }

    /// The number of splats that the next slab should have.
    pub fn target(&self) -> f64 {
        self.target
    }

    /// Continues behind a slab that filled this fraction of the capacity.
    pub fn advance(&mut self, slab: &Range<SortPosition>, filled: f64) {
        self.begin = slab.end;
        let factor = (FILL / filled.max(1e-3)).clamp(0.5, 4.0);
        self.target = (self.target * factor).clamp(1.0, self.most);
        self.longest = self.longest.saturating_mul(4);
    }

    /// Shortens a slab that demanded `filled` times the capacity. False if it has a single position.
    pub fn shorten(&mut self, slab: &Range<SortPosition>, filled: f64) -> bool {
        let key = slab.start >> 32;
        let last = if key == (slab.end - 1) >> 32 { position_of(key as u32) + self.indices } else { slab.end };
        let length = last.min(slab.end).saturating_sub(slab.start);
        // The overflow of an earlier stage may hide the demand, so the slab is at least halved.
        let factor = (FILL / filled).clamp(1.0 / 1024.0, 0.5);
        self.longest = ((length as f64 * factor) as u64).max(1);
        self.target = (self.target * factor).max(1.0);
        length > 1
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Cuts a frame with these numbers of splats at some depth keys, for slabs of at most `capacity` splats.
    fn cut(weights: &[(u32, u32)], capacity: u32, estimate: Estimate) -> Vec<Range<SortPosition>> {
        let capacity = f64::from(capacity);
        let mut partition = SlabPartition::new(estimate, 1000, capacity, capacity);
        let mut slabs = Vec::new();
        let count = |slab: &Range<SortPosition>| -> u64 {
            let within = |key: u32, index: u32| slab.contains(&(position_of(key) + u64::from(index)));
            weights.iter().map(|(key, n)| (0..*n).filter(|index| within(*key, *index)).count() as u64).sum()
        };
        while let Some(slab) = partition.next() {
            let filled = count(&slab) as f64 / capacity;
            if filled > 1.0 {
                assert!(partition.shorten(&slab, filled));
            } else {
                partition.advance(&slab, filled);
                slabs.push(slab);
            }
        }
        slabs
    }

    #[test]
    fn slabs_follow_each_other_and_fit() {
        let weights = [(10, 50), (11, 30), (900, 80), (1 << 19, 7)];
        let end = position_of(1 << 20);
        let known = Estimate::of(end, weights.iter().map(|(key, count)| ([*key, *key], *count)));
        assert_eq!(known.splats(), 167.0);
        for estimate in [Estimate::uniform(end, 167.0), known] {
            let slabs = cut(&weights, 40, estimate);
            assert_eq!((slabs[0].start, slabs.last().unwrap().end), (0, end));
            assert!(slabs.windows(2).all(|pair| pair[0].end == pair[1].start));
            assert!(slabs.len() < 200, "{} slabs", slabs.len());
        }
    }

    #[test]
    fn a_good_estimate_fills_every_slab() {
        let end = position_of(1 << 20);
        let weights: Vec<(u32, u32)> = (0..1000).map(|i| (1000 * i, 10)).collect();
        let estimate = Estimate::of(end, weights.iter().map(|(key, count)| ([*key, *key + 999], *count)));
        let slabs = cut(&weights, 1000, estimate);
        assert!((10..25).contains(&slabs.len()), "{} slabs", slabs.len());
    }

    #[test]
    fn a_single_depth_is_cut_by_the_indices_of_its_gaussians() {
        let slabs = cut(&[(7, 100)], 9, Estimate::uniform(position_of(1 << 20), 100.0));
        assert!(slabs.len() < 60, "{} slabs", slabs.len());
        let inside = slabs.iter().filter(|slab| slab.start >> 32 == 7 && slab.end >> 32 == 7).count();
        assert!(inside >= 9, "{slabs:?}");
    }

    #[test]
    fn a_single_splat_that_does_not_fit_is_reported() {
        let mut partition = SlabPartition::new(Estimate::uniform(position_of(4), 1.0), 1000, 1.0, 1.0);
        assert!(!partition.shorten(&(5..6), 2.0));
    }
}
