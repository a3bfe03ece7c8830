//! Separable filters over one channel of an image: columns first, then along the row that comes of it.

use rayon::prelude::*;

/// One channel of an image, row by row.
pub(super) struct Plane {
    width: usize,
    values: Vec<f32>,
}

impl Plane {
    /// The channel that `value` makes of the pixel at an index.
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

/// Weights of the neighbours from `-radius` to `radius`.
pub(super) struct Filter(Vec<f32>);

impl Filter {
    /// The weight that `weight` gives to a neighbour.
    pub fn new(radius: usize, weight: impl Fn(f64) -> f64) -> Self {
        Self((0..=2 * radius).map(|i| weight(i as f64 - radius as f64) as f32).collect())
    }

    pub fn radius(&self) -> usize {
        self.0.len() / 2
    }

    /// Row `y` of the columns filtered. Beyond its ends a column repeats its last value.
    pub fn down(&self, plane: &Plane, y: usize, out: &mut [f32]) {
        let (radius, bottom) = (self.radius(), plane.height() - 1);
        out.fill(0.0);
        for (i, weight) in self.0.iter().enumerate() {
            add(*weight, plane.row((y + i).saturating_sub(radius).min(bottom)), out);
        }
    }

    /// A row filtered, as far as it has all neighbours: `out` is shorter by the radius at both ends.
    pub fn along(&self, row: &[f32], out: &mut [f32]) {
        out.fill(0.0);
        for (i, weight) in self.0.iter().enumerate() {
            add(*weight, &row[i..], out);
        }
    }
}

fn add(weight: f32, values: &[f32], out: &mut [f32]) {
    for (sum, value) in out.iter_mut().zip(values) {
        *sum += weight * value;
    }
}
