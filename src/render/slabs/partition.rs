//! Where the slabs of a frame end.

use std::ops::Range;

use crate::render::shaders::Slab;

/// A place in the total order: the depth key in the upper 32 bits, the index of the Gaussian in the lower ones.
pub type Place = u64;

/// The first place of a depth key.
pub fn place_of(key: u32) -> Place {
    u64::from(key) << 32
}

/// A slab as the shaders read it.
pub fn slab(range: &Range<Place>) -> Slab {
    let pair = |place: Place| [(place >> 32) as u32, place as u32];
    Slab { begin: pair(range.start), end: pair(range.end) }
}

/// The part of their capacity that slabs are meant to fill. What is left covers the error of the estimate.
const FILL: f64 = 0.7;

/// Steps of an estimate.
const STEPS: usize = 2048;

/// Where the splats of a frame are expected to lie in depth.
#[derive(Debug)]
pub struct Estimate {
    end: Place,
    /// Splats expected before the end of each step; all steps have the same number of places.
    before: Vec<f64>,
}

impl Estimate {
    /// The same number everywhere below `end`, `splats` in all.
    pub fn uniform(end: Place, splats: f64) -> Self {
        Self { end, before: (1..=STEPS).map(|step| splats * step as f64 / STEPS as f64).collect() }
    }

    /// From ranges of depth keys (both ends included) and the number of splats within each.
    pub fn of(end: Place, groups: impl Iterator<Item = ([u32; 2], u32)>) -> Self {
        // Differences of the density, summed up below.
        let mut changes = vec![0.0; STEPS + 1];
        let step = |key: u32| (u128::from(place_of(key)) * STEPS as u128 / u128::from(end.max(1))) as usize;
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

    /// All splats.
    pub fn splats(&self) -> f64 {
        self.before[STEPS - 1]
    }

    /// The splats expected before a place.
    fn before(&self, place: Place) -> f64 {
        let at = place as f64 / self.end.max(1) as f64 * STEPS as f64;
        let step = (at as usize).min(STEPS - 1);
        let start = if step == 0 { 0.0 } else { self.before[step - 1] };
        start + (self.before[step] - start) * (at - step as f64).min(1.0)
    }

    /// The place before which so many splats are expected.
    fn place(&self, splats: f64) -> Place {
        let step = self.before.partition_point(|before| *before < splats);
        if step >= STEPS {
            return self.end;
        }
        let start = if step == 0 { 0.0 } else { self.before[step - 1] };
        let part = (splats - start) / (self.before[step] - start).max(1e-9);
        (((step as f64 + part.clamp(0.0, 1.0)) / STEPS as f64 * self.end as f64) as Place).min(self.end)
    }
}

/// Cuts a frame into slabs that fit, by an estimate and by what the slabs before demanded.
#[derive(Debug)]
pub struct Ends {
    estimate: Estimate,
    /// Number of indices: a depth key has places for these, and for no more.
    indices: u64,
    begin: Place,
    /// Expected splats of the next slab.
    target: f64,
    /// The most splats that a slab is meant to have.
    most: f64,
    /// Most places of the next slab, after one that did not fit.
    longest: u64,
}

impl Ends {
    /// Begins a frame whose slabs are meant to have `target` splats at first, and never more than `most`.
    pub fn new(estimate: Estimate, indices: usize, target: f64, most: f64) -> Self {
        let target = target.min(most).min(estimate.splats()).max(1.0);
        Self { estimate, indices: indices as u64, begin: 0, target, most, longest: u64::MAX }
    }

    /// Goes on by a new estimate.
    pub fn renew(&mut self, estimate: Estimate) {
        self.estimate = estimate;
    }

    /// The next slab; `None` if there is none left.
    pub fn next(&self) -> Option<Range<Place>> {
        self.after(self.begin)
    }

    /// The slab that will probably follow the one up to `begin`.
    pub fn after(&self, begin: Place) -> Option<Range<Place>> {
        let Estimate { end, .. } = self.estimate;
        if begin >= end {
            return None;
        }
        let wanted = self.estimate.place(self.estimate.before(begin) + self.target);
        // What is hardly worth a slab of its own belongs to the last one.
        let rest = self.estimate.splats() - self.estimate.before(wanted);
        let wanted = if rest < self.target / 8.0 { end } else { wanted.max(begin + 1) };
        let wanted = wanted.min(begin.saturating_add(self.longest));
        // Behind the last index of a key lies the next key.
        let is_behind = wanted & u64::from(u32::MAX) >= self.indices;
        Some(begin..if is_behind { place_of((wanted >> 32) as u32 + 1).min(end) } else { wanted })
    }

    /// The splats that the next slab is meant to have.
    pub fn target(&self) -> f64 {
        self.target
    }

    /// Goes on behind a slab that filled this part of the capacity.
    pub fn drawn(&mut self, slab: &Range<Place>, filled: f64) {
        self.begin = slab.end;
        let factor = (FILL / filled.max(1e-3)).clamp(0.5, 4.0);
        self.target = (self.target * factor).clamp(1.0, self.most);
        self.longest = self.longest.saturating_mul(4);
    }

    /// Makes the slab shorter, which demanded `filled` times the capacity. False if it has a single place.
    pub fn shorten(&mut self, slab: &Range<Place>, filled: f64) -> bool {
        let key = slab.start >> 32;
        let last = if key == (slab.end - 1) >> 32 { place_of(key as u32) + self.indices } else { slab.end };
        let length = last.min(slab.end).saturating_sub(slab.start);
        // The demand may be hidden by the overflow of an earlier stage, so it is at least halved.
        let factor = (FILL / filled).clamp(1.0 / 1024.0, 0.5);
        self.longest = ((length as f64 * factor) as u64).max(1);
        self.target = (self.target * factor).max(1.0);
        length > 1
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Cuts places where so many splats lie at each of some depth keys, with room for `room` of them.
    fn cut(weights: &[(u32, u32)], room: u32, estimate: Estimate) -> Vec<Range<Place>> {
        let mut ends = Ends::new(estimate, 1000, f64::from(room), f64::from(room));
        let mut slabs = Vec::new();
        let count = |slab: &Range<Place>| -> u64 {
            let within = |key: u32, index: u32| slab.contains(&(place_of(key) + u64::from(index)));
            weights.iter().map(|(key, n)| (0..*n).filter(|index| within(*key, *index)).count() as u64).sum()
        };
        while let Some(slab) = ends.next() {
            let filled = count(&slab) as f64 / f64::from(room);
            if filled > 1.0 {
                assert!(ends.shorten(&slab, filled));
            } else {
                ends.drawn(&slab, filled);
                slabs.push(slab);
            }
        }
        slabs
    }

    #[test]
    fn slabs_follow_each_other_and_fit() {
        let weights = [(10, 50), (11, 30), (900, 80), (1 << 19, 7)];
        let end = place_of(1 << 20);
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
        let end = place_of(1 << 20);
        let weights: Vec<(u32, u32)> = (0..1000).map(|i| (1000 * i, 10)).collect();
        let estimate = Estimate::of(end, weights.iter().map(|(key, count)| ([*key, *key + 999], *count)));
        let slabs = cut(&weights, 1000, estimate);
        assert!((10..25).contains(&slabs.len()), "{} slabs", slabs.len());
    }

    #[test]
    fn a_single_depth_is_cut_by_the_indices_of_its_gaussians() {
        let slabs = cut(&[(7, 100)], 9, Estimate::uniform(place_of(1 << 20), 100.0));
        assert!(slabs.len() < 60, "{} slabs", slabs.len());
        let inside = slabs.iter().filter(|slab| slab.start >> 32 == 7 && slab.end >> 32 == 7).count();
        assert!(inside >= 9, "{slabs:?}");
    }

    #[test]
    fn one_splat_without_room_is_told() {
        let mut ends = Ends::new(Estimate::uniform(place_of(4), 1.0), 1000, 1.0, 1.0);
        assert!(!ends.shorten(&(5..6), 2.0));
    }
}
