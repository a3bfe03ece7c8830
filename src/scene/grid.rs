//! Detects values that a file held in 8 bits, after decoding.

/// 256 numbers at equal steps: `offset + step * n`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Grid {
    /// Number 0.
    pub offset: f32,
    /// Difference of neighbours.
    pub step: f32,
}

/// Number of values from which the step is estimated.
pub(crate) const SAMPLE: usize = 1 << 14;

/// Stride between sampled values: a prime, so that no pattern in a file hides a step.
pub(crate) const SCATTER: u64 = 2_654_435_761;

/// Most steps in the smallest gap between the values of a file: .spz rounds coefficients to 8 or 16 steps, and clamps
/// the last at 255.
const MOST_STEPS: u32 = 16;

/// Largest rounding error of a value on a grid in f32, absolute up to 1 and relative above.
const ROUNDING: f64 = 1e-6;

impl Grid {
    /// The grid of values that are not stored on one.
    pub const UNUSED: Self = Self { offset: 0.0, step: 1.0 };

    /// The grid that spans the values from `low` to `high`. For no values, `low > high`, it is any grid.
    pub fn spanning([low, high]: [f64; 2]) -> Self {
        if low > high {
            return Self::UNUSED;
        }
        Self { offset: low as f32, step: (((high - low) / 255.0) as f32).max(f32::MIN_POSITIVE) }
    }

    /// The number of the nearest step.
    pub fn encode(self, value: f64) -> u8 {
        // As `round` and then `clamp`, without the call of a library.
        let steps = ((value - f64::from(self.offset)) / f64::from(self.step)).clamp(0.0, 255.0);
        let below = steps as u8;
        below + u8::from(steps - f64::from(below) >= 0.5)
    }

    /// The value of a step.
    pub fn decode(self, number: u8) -> f32 {
        self.step.mul_add(number.into(), self.offset)
    }
}

/// The grids from `least` on that hold a whole sample, the coarsest first.
pub(crate) fn likely(sample: &[f64], least: f64) -> impl Iterator<Item = Grid> {
    let (first, last) = (sample[0], sample[sample.len() - 1]);
    let gap = sample.windows(2).map(|pair| pair[1] - pair[0]).fold(f64::INFINITY, f64::min);
    // The smallest gap may be several steps, and rounding affects it. The whole span is relatively exact: it is divided
    // by its whole number of steps.
    let grids = (1..=MOST_STEPS).map(move |parts| {
        let steps = ((last - first) / gap * f64::from(parts)).round();
        let step = if gap.is_finite() { (last - first) / steps } else { 1.0 };
        Grid { offset: least as f32, step: step as f32 }
    });
    grids.filter(|grid| {
        let steps = Steps::of(*grid);
        grid.step > 0.0 && sample.iter().all(|v| steps.hold(*v))
    })
}

/// A grid in f64, to compare many values with it.
pub(crate) struct Steps {
    offset: f64,
    step: f64,
    steps_per_unit: f64,
}

impl Steps {
    pub fn of(Grid { offset, step }: Grid) -> Self {
        Self { offset: offset.into(), step: step.into(), steps_per_unit: 1.0 / f64::from(step) }
    }

    /// True if a value lies on the grid. Which of two steps is nearest to a value in their middle does not matter.
    pub fn hold(&self, value: f64) -> bool {
        let number = ((value - self.offset) * self.steps_per_unit + 0.5).clamp(0.0, 255.0) as i32;
        let off = (self.offset + self.step * f64::from(number) - value).abs();
        off <= ROUNDING * value.abs().max(1.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn grid_of(count: usize, value: impl Fn(usize) -> f64 + Sync) -> Option<Grid> {
        Some(Grid::of_columns(count, 1, |row, _| [value(row)])?[0])
    }

    #[test]
    fn a_grid_is_found_and_gives_back_its_numbers() {
        for (offset, step) in [(-1.0, 1.0 / 128.0), (-10.0, 1.0 / 16.0), (-0.5 / 0.15, 1.0 / (255.0 * 0.15))] {
            let value = |i: usize| f64::from((offset + step * (i * 37 % 256) as f64) as f32);
            let grid = grid_of(5000, value).unwrap();
            for i in 0..256 {
                assert!((f64::from(grid.decode(grid.encode(value(i)))) - value(i)).abs() < 2e-6, "{offset} {i}");
            }
        }
    }

    #[test]
    fn a_grid_is_found_where_no_two_numbers_are_a_step_apart() {
        let coarse = |i: usize| f64::from((i as u32 * 7 % 17 * 16).min(255)) / 128.0 - 1.0;
        let grid = grid_of(5000, coarse).unwrap();
        assert_eq!(grid.step, 1.0 / 128.0);
        assert!((0..17).all(|i| f64::from(grid.decode(grid.encode(coarse(i)))) == coarse(i)));
        // A single value among many.
        let rare = |i: usize| if i == 54_321 { 255.0 } else { f64::from(i as u32 * 7 % 16 * 16) };
        assert_eq!(grid_of(1 << 16, rare).unwrap().step, 1.0);
    }

    #[test]
    fn the_two_zeros_are_one_step() {
        let value = |i: usize| if i == 500 { -0.0 } else { (i % 200) as f64 / 128.0 - 0.5 };
        assert!(grid_of(1000, value).is_some());
    }

    #[test]
    fn numbers_between_the_steps_have_no_grid() {
        let on = |i: usize| (i % 200) as f64 / 128.0;
        assert!(grid_of(1 << 16, on).is_some());
        assert!(grid_of(1 << 16, |i| if i == 12_345 { 0.3 } else { on(i) }).is_none(), "one of many is off");
        assert!(grid_of(1 << 16, |i| if i == 12_345 { 2.5 } else { on(i) }).is_none(), "257 steps are needed");
        assert!(grid_of(1000, |i| (i as f64).sin()).is_none());
        assert!(grid_of(10, |_| f64::NEG_INFINITY).is_none());
    }

    #[test]
    fn a_spanning_grid_is_half_a_step_off_at_most() {
        let values = [-3.0, 0.1, 0.2, 7.5];
        let grid = Grid::spanning([-3.0, 7.5]);
        for value in &values {
            let error = (f64::from(grid.decode(grid.encode(*value))) - value).abs();
            assert!(error <= 0.5 * f64::from(grid.step) + 1e-6, "{value}: {error}");
        }
        assert_eq!(grid.encode(f64::NEG_INFINITY), 0);
    }

    #[test]
    fn columns_are_searched_together_and_all_need_a_grid() {
        let of_column = |column: usize, i: usize| (i * 37 % 256) as f64 * [1.0, 0.5, 0.125][column];
        let pair = |row: usize, column: usize| [of_column(column, 2 * row), of_column(column, 2 * row + 1)];
        let grids = Grid::of_columns(40_000, 3, pair).unwrap();
        assert_eq!(grids.iter().map(|grid| grid.step).collect::<Vec<_>>(), [1.0, 0.5, 0.125]);
        let is_odd =
            |row: usize, column: usize| if (row, column) == (31_234, 2) { [0.3; 2] } else { pair(row, column) };
        assert!(Grid::of_columns(40_000, 3, is_odd).is_none());
    }

    #[test]
    fn numbers_are_rounded_to_the_nearest_half_away_from_zero() {
        let grid = Grid { offset: 0.0, step: 1.0 };
        let half = 0.49999999999999994;
        for (value, number) in [(0.5, 1), (half, 0), (1.5, 2), (254.5, 255), (300.0, 255), (-0.5, 0), (f64::NAN, 0)] {
            assert_eq!(grid.encode(value), number, "{value}");
        }
    }
}
