//! The search for grids of columns of values that come in blocks.

use rayon::prelude::*;

use super::grid::{Grid, SAMPLE, SCATTER, Steps, likely};

impl Grid {
    /// The grid of every column on which all of its values lie, if each column has one. `values(row, column)` returns
    /// the values of a row in a column.
    pub fn of_columns<const N: usize>(
        rows: usize,
        columns: usize,
        values: impl Fn(usize, usize) -> [f64; N] + Sync,
    ) -> Option<Vec<Self>> {
        let mut all = Columns::<N>::new(rows, columns);
        all.add(rows, values);
        all.grids(columns)
    }
}

/// Columns of values, with `N` values in each row, which come in blocks of rows. What is kept of them does not depend
/// on the size of the blocks.
#[derive(Clone, Debug)]
pub struct Columns<const N: usize> {
    rows: usize,
    /// Rows that were added.
    added: usize,
    /// The places of the sampled values in a column, ascending.
    sampled: Vec<u64>,
    /// The different sampled values of each column, ascending. `None` if some column is on no grid.
    columns: Option<Vec<(Vec<f64>, Distinct)>>,
}

/// Rows that a thread looks at in one column, then in the next.
const ROWS: usize = 1 << 10;
/// Most different values that a grid can have.
const STEPS: usize = 256;

impl<const N: usize> Columns<N> {
    /// Columns that are going to have this number of rows.
    pub fn new(rows: usize, columns: usize) -> Self {
        let count = (rows * N) as u64;
        let mut sampled: Vec<u64> = (0..(SAMPLE as u64).min(count)).map(|i| i * SCATTER % count).collect();
        sampled.sort_unstable();
        Self { rows, added: 0, sampled, columns: Some(vec![(Vec::new(), Distinct::new()); columns]) }
    }

    /// True if every column may still be on a grid.
    pub fn may_have_grids(&self) -> bool {
        self.columns.is_some()
    }

    /// Adds the next `count` rows. `values(row, column)` returns the values of one of them, counted from 0.
    pub fn add(&mut self, count: usize, values: impl Fn(usize, usize) -> [f64; N] + Sync) {
        let first = self.added;
        self.added += count;
        let Some(columns) = &mut self.columns else { return };
        // Most scenes are on no grid, which few rows show.
        let few = count.min(ROWS);
        let read = |rows: std::ops::Range<usize>, c: usize, distinct: &mut Distinct| {
            rows.flat_map(|row| values(row, c)).all(|value| distinct.insert(value))
        };
        let mut are_few = columns.iter_mut().enumerate().all(|(c, (_, distinct))| read(0..few, c, distinct));
        let rest = (few..count).step_by(ROWS).collect::<Vec<_>>();
        if are_few && !rest.is_empty() {
            let none = || Some(vec![Distinct::new(); columns.len()]);
            let parts = rest.into_par_iter().with_min_len(8).fold(none, |all, row| {
                let mut all = all?;
                let rows = row..count.min(row + ROWS);
                all.iter_mut().enumerate().all(|(c, distinct)| read(rows.clone(), c, distinct)).then_some(all)
            });
            let both = |a: Option<Vec<Distinct>>, b: Option<Vec<Distinct>>| {
                let (mut a, b) = (a?, b?);
                a.iter_mut().zip(&b).all(|(a, b)| b.values().all(|value| a.insert(value))).then_some(a)
            };
            let found = parts.reduce(none, both);
            are_few = found.is_some_and(|found| {
                let pairs = columns.iter_mut().zip(&found);
                pairs.into_iter().all(|((_, all), found)| found.values().all(|value| all.insert(value)))
            });
        }
        let range = [first, first + count].map(|row| self.sampled.partition_point(|place| *place < (row * N) as u64));
        let sampled = &self.sampled[range[0]..range[1]];
        let take = |(c, (sample, _)): (usize, &mut (Vec<f64>, Distinct))| {
            sampled.iter().all(|place| {
                let place = *place as usize - first * N;
                let value = values(place / N, c)[place % N] + 0.0; // -0 is 0
                if let Err(at) = sample.binary_search_by(|v| v.total_cmp(&value)) {
                    sample.insert(at, value);
                }
                sample.len() <= STEPS
            })
        };
        if !are_few || !columns.par_iter_mut().enumerate().all(take) {
            self.columns = None;
        }
    }

    /// The grids of the first `columns` columns, if each has one.
    ///
    /// # Panics
    /// If rows are missing.
    pub fn grids(&self, columns: usize) -> Option<Vec<Grid>> {
        assert_eq!(self.added, self.rows, "all rows are added");
        let found = self.columns.as_ref().filter(|_| self.rows > 0)?;
        let grid = |(sample, distinct): &(Vec<f64>, Distinct)| {
            let least = distinct.values().fold(f64::INFINITY, f64::min);
            likely(sample, least).find(|grid| {
                let steps = Steps::of(*grid);
                distinct.values().all(|value| steps.hold(value))
            })
        };
        found[..columns].iter().map(grid).collect()
    }
}

/// The different values of a column, up to [`MOST`](Distinct::MOST): a table with open addressing.
#[derive(Clone, Debug)]
struct Distinct {
    /// Bits of the values, or [`NONE`](Distinct::NONE).
    slots: Vec<u64>,
    count: usize,
}

impl Distinct {
    /// More than the steps of a grid, because rounding may move a step a little.
    const MOST: usize = 2 * STEPS;
    const BITS: u32 = 10;
    /// The bits of no value of a scene: a NaN.
    const NONE: u64 = u64::MAX;

    fn new() -> Self {
        Self { slots: vec![Self::NONE; 1 << Self::BITS], count: 0 }
    }

    /// Adds a value. False if the table has too many values then.
    fn insert(&mut self, value: f64) -> bool {
        let bits = (value + 0.0).to_bits(); // -0 is 0
        let mut at = (bits.wrapping_mul(0x9e37_79b9_7f4a_7c15) >> (u64::BITS - Self::BITS)) as usize;
        while self.slots[at] != bits {
            if self.slots[at] == Self::NONE {
                self.slots[at] = bits;
                self.count += 1;
                break;
            }
            at = (at + 1) % self.slots.len();
        }
        self.count <= Self::MOST
    }

    fn values(&self) -> impl Iterator<Item = f64> {
        self.slots.iter().filter(|slot| **slot != Self::NONE).map(|bits| f64::from_bits(*bits))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_size_of_the_blocks_does_not_change_the_grids() {
        let value = |i: usize| f64::from((-0.5 / 0.15 + (i * 37 % 251) as f64 / (255.0 * 0.15)) as f32);
        for rows in [1, 5000, 40_000] {
            let whole = Grid::of_columns(rows, 2, |row, column| [value(row), value(row + column), value(7 * row)]);
            assert!(whole.is_some());
            for block in [1000, 4096, 39_999] {
                let mut columns = Columns::new(rows, 2);
                for first in (0..rows).step_by(block) {
                    let at = |row: usize, column: usize| {
                        let row = first + row;
                        [value(row), value(row + column), value(7 * row)]
                    };
                    columns.add(block.min(rows - first), at);
                }
                assert_eq!(columns.grids(2), whole, "{rows} rows in blocks of {block}");
            }
        }
    }

    #[test]
    fn a_value_off_the_grid_is_found_in_every_block() {
        for odd in [0, 1023, 1024, 9_999, 50_000] {
            let value = |row: usize, _: usize| [if row == odd { 0.3 } else { (row % 200) as f64 / 128.0 }];
            let grids = Grid::of_columns(50_001, 1, value);
            assert_eq!(grids, None, "row {odd}");
        }
    }
}
