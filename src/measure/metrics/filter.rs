//! Separable filters for one channel of an image: first down the columns, then along the resulting row.

use rayon::prelude::*;

/// One channel of an image, row by row.
pub(super) struct Plane {
    width: usize,
    values: Vec<f32>,
}

impl Plane {
    /// A plane with `value(i)` at the pixel with index `i`.
    pub fn new(size: [u32; 2], value: impl Fn(usize) -> f32 + Sync + Send) -> Self {
        let [width, height] = size.map(|side| side as usize);
        Self { width, values: (0..width * height).into_par_iter().map(value).collect() }
    }

    pub fn width(&self) -> usize {
        self.width
    }

    fn height(&self) -> usize {
        self.values.len() / self.width
    }

    fn row(&self, y: usize) -> &[f32] {
        &self.values[y * self.width..][..self.width]
    }
}

/// The weights of the neighbours from `-radius` to `radius`.
pub(super) struct Filter(Vec<f32>);

impl Filter {
    /// A filter with `weight(i)` for the neighbour at distance `i`.
    pub fn new(radius: usize, weight: impl Fn(f64) -> f64) -> Self {
        Self((0..=2 * radius).map(|i| weight(i as f64 - radius as f64) as f32).collect())
    }

    pub fn radius(&self) -> usize {
        self.0.len() / 2
    }

    /// Filters the columns and writes row `y` of the result. Beyond its ends a column repeats its outermost value.
    pub fn down(&self, plane: &Plane, y: usize, out: &mut [f32]) {
        let (radius, bottom) = (self.radius(), plane.height() - 1);
        self.weigh(|i| plane.row((y + i).saturating_sub(radius).min(bottom)), out);
    }

    /// Filters a row where it has all neighbours: `out` is shorter than `row` by the radius at both ends.
    pub fn along(&self, row: &[f32], out: &mut [f32]) {
        self.weigh(|i| &row[i..], out);
    }

    /// Writes the sum of `values(i)` times weight `i`. Four weights at a time, to read and write `out` less often.
    fn weigh<'v>(&self, values: impl Fn(usize) -> &'v [f32], out: &mut [f32]) {
        out.fill(0.0);
        let (fours, rest) = self.0.as_chunks::<4>();
        for (four, weights) in fours.iter().enumerate() {
            add(*weights, [0, 1, 2, 3].map(|i| values(4 * four + i)), out);
        }
        for (i, weight) in rest.iter().enumerate() {
            add([*weight], [values(4 * fours.len() + i)], out);
        }
    }
}

fn add<const N: usize>(weights: [f32; N], values: [&[f32]; N], out: &mut [f32]) {
    let values = values.map(|values| &values[..out.len()]);
    for (x, sum) in out.iter_mut().enumerate() {
        for i in 0..N {
            *sum += weights[i] * values[i][x];
        }
    }
}
