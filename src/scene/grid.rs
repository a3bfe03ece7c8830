//! Detects values that a file held in 8 bits, after decoding.

use rayon::prelude::*;

/// 256 numbers at equal steps: `offset + step * n`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Grid {
    /// Number 0.
    pub offset: f32,
    /// Difference of neighbours.
    pub step: f32,
}

/// Number of values from which the step is estimated.
const SAMPLE: usize = 1 << 14;

/// Stride between sampled values: a prime, so that no pattern in a file hides a step.
const SCATTER: u64 = 2_654_435_761;

/// Most steps in the smallest gap between the values of a file: .spz rounds coefficients to 8 or 16 steps, and clamps
/// the last at 255.
const MOST_STEPS: u32 = 16;

/// Largest rounding error of a value on a grid in f32, absolute up to 1 and relative above.
const ROUNDING: f64 = 1e-6;

impl Grid {
    /// The grid on which all of `values(0..count)` lie, if there is one.
    pub fn of(count: usize, values: impl Fn(usize) -> f64 + Sync) -> Option<Self> {
        let mut sample: Vec<f64> = Vec::new();
        for i in 0..SAMPLE.min(count) {
            let value = values((i as u64 * SCATTER % count as u64) as usize) + 0.0; // -0 is 0
            if let Err(place) = sample.binary_search_by(|v| v.total_cmp(&value)) {
                sample.insert(place, value);
            }
            if sample.len() > 256 {
                return None;
            }
        }
        let (first, last) = (*sample.first()?, *sample.last()?);
        let gap = sample.windows(2).map(|pair| pair[1] - pair[0]).fold(f64::INFINITY, f64::min);
        let least = (0..count).into_par_iter().with_min_len(1 << 14).map(&values).reduce(|| first, f64::min);
        let off = |grid: Self, value: f64| (f64::from(grid.decode(grid.encode(value))) - value).abs();
        let holds = |grid: Self, value: f64| off(grid, value) <= ROUNDING * value.abs().max(1.0);
        // The smallest gap may be several steps, and rounding affects it. The whole span is relatively exact: it is
        // divided by its whole number of steps.
        let grids = (1..=MOST_STEPS).map(|parts| {
            let steps = ((last - first) / gap * f64::from(parts)).round();
            let step = if gap.is_finite() { (last - first) / steps } else { 1.0 };
            Self { offset: least as f32, step: step as f32 }
        });
        let holds_all = |grid: &Self| (0..count).into_par_iter().with_min_len(1 << 14).all(|i| holds(*grid, values(i)));
        let mut likely = grids.filter(|grid| grid.step > 0.0 && sample.iter().all(|v| holds(*grid, *v)));
        likely.find(holds_all)
    }

    /// The grid that spans the finite `values`; any grid if there are none.
    pub fn spanning(values: impl ParallelIterator<Item = f64>) -> Self {
        let empty = (f64::INFINITY, f64::NEG_INFINITY);
        let (low, high) = values
            .filter(|v| v.is_finite())
            .fold(|| empty, |(low, high), v| (low.min(v), high.max(v)))
            .reduce(|| empty, |a, b| (a.0.min(b.0), a.1.max(b.1)));
        if low > high {
            return Self { offset: 0.0, step: 1.0 };
        }
        Self { offset: low as f32, step: (((high - low) / 255.0) as f32).max(f32::MIN_POSITIVE) }
    }

    /// The number of the nearest step.
    pub fn encode(self, value: f64) -> u8 {
        ((value - f64::from(self.offset)) / f64::from(self.step)).round().clamp(0.0, 255.0) as u8
    }

    /// The value of a step.
    pub fn decode(self, number: u8) -> f32 {
        self.step.mul_add(number.into(), self.offset)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_grid_is_found_and_gives_back_its_numbers() {
        for (offset, step) in [(-1.0, 1.0 / 128.0), (-10.0, 1.0 / 16.0), (-0.5 / 0.15, 1.0 / (255.0 * 0.15))] {
            let value = |i: usize| f64::from((offset + step * (i * 37 % 256) as f64) as f32);
            let grid = Grid::of(5000, value).unwrap();
            for i in 0..256 {
                assert!((f64::from(grid.decode(grid.encode(value(i)))) - value(i)).abs() < 2e-6, "{offset} {i}");
            }
        }
    }

    #[test]
    fn a_grid_is_found_where_no_two_numbers_are_a_step_apart() {
        let coarse = |i: usize| f64::from((i as u32 * 7 % 17 * 16).min(255)) / 128.0 - 1.0;
        let grid = Grid::of(5000, coarse).unwrap();
        assert_eq!(grid.step, 1.0 / 128.0);
        assert!((0..17).all(|i| f64::from(grid.decode(grid.encode(coarse(i)))) == coarse(i)));
        // A single value among many.
        let rare = |i: usize| if i == 54_321 { 255.0 } else { f64::from(i as u32 * 7 % 16 * 16) };
        assert_eq!(Grid::of(1 << 16, rare).unwrap().step, 1.0);
    }

    #[test]
    fn the_two_zeros_are_one_step() {
        let value = |i: usize| if i == 500 { -0.0 } else { (i % 200) as f64 / 128.0 - 0.5 };
        assert!(Grid::of(1000, value).is_some());
    }

    #[test]
    fn numbers_between_the_steps_have_no_grid() {
        let on = |i: usize| (i % 200) as f64 / 128.0;
        assert!(Grid::of(1 << 16, on).is_some());
        assert!(Grid::of(1 << 16, |i| if i == 12_345 { 0.3 } else { on(i) }).is_none(), "one of many is off");
        assert!(Grid::of(1 << 16, |i| if i == 12_345 { 2.5 } else { on(i) }).is_none(), "257 steps are needed");
        assert!(Grid::of(1000, |i| (i as f64).sin()).is_none());
        assert!(Grid::of(10, |_| f64::NEG_INFINITY).is_none());
    }

    #[test]
    fn a_spanning_grid_is_half_a_step_off_at_most() {
        let values = [-3.0, 0.1, 0.2, 7.5, f64::NEG_INFINITY];
        let grid = Grid::spanning(values.into_par_iter());
        for value in &values[..4] {
            let error = (f64::from(grid.decode(grid.encode(*value))) - value).abs();
            assert!(error <= 0.5 * f64::from(grid.step) + 1e-6, "{value}: {error}");
        }
        assert_eq!(grid.encode(f64::NEG_INFINITY), 0);
    }
}
