//! Codebooks: 256 values that approximate many, by k-means in one dimension.

use rayon::prelude::*;

const VALUES: usize = 256;
/// Largest number of rounds of Lloyd's algorithm. A round takes a few thousand steps for any number of values.
const ROUNDS: usize = 1000;

/// 256 ascending values; the last is repeated if fewer are used.
pub(crate) struct Codebook([f32; VALUES]);

impl Codebook {
    /// A codebook with a small sum of squared rounding errors of `values`. It is exact for at most 256
    /// distinct values. No value may be NaN.
    pub fn of(mut values: Vec<f32>) -> Self {
        values.par_sort_unstable_by(f32::total_cmp);
        let mut different = values.clone();
        different.dedup();
        if different.len() <= VALUES {
            let last = different.last().copied().unwrap_or(0.0);
            return Self(std::array::from_fn(|i| different.get(i).copied().unwrap_or(last)));
        }
        let sorted = Sorted::new(values);
        let mut book = sorted.spread();
        for _ in 0..ROUNDS {
            let next = sorted.means(&book);
            if next.0 == book.0 {
                break;
            }
            book = next;
        }
        book
    }

    pub fn values(&self) -> &[f32] {
        &self.0
    }

    /// The index of the nearest value.
    pub fn byte(&self, value: f32) -> u8 {
        let above = self.0.partition_point(|v| *v < value);
        let distance = |i: usize| (f64::from(self.0[i]) - f64::from(value)).abs();
        match above {
            0 => 0,
            VALUES => (VALUES - 1) as u8,
            _ if distance(above - 1) <= distance(above) => (above - 1) as u8,
            _ => above as u8,
        }
    }
}

/// Sorted values with their prefix sums.
struct Sorted {
    values: Vec<f32>,
    sums: Vec<f64>,
}

impl Sorted {
    fn new(values: Vec<f32>) -> Self {
        let mut sum = 0.0;
        let sums = std::iter::once(0.0).chain(values.iter().map(|v| {
            sum += f64::from(*v);
            sum
        }));
        let sums = sums.collect();
        Self { values, sums }
    }

    /// Initial values whose density is the cube root of that of the data (Panter and Dite 1951). The density of the
    /// data is one over its gaps, so these are equal steps along the sum of the gaps to the power of two thirds.
    fn spread(&self) -> Codebook {
        let mut sum = 0.0;
        let places = std::iter::once(0.0).chain(self.values.windows(2).map(|pair| {
            sum += (f64::from(pair[1]) - f64::from(pair[0])).powi(2).cbrt();
            sum
        }));
        let places: Vec<f64> = places.collect();
        Codebook(std::array::from_fn(|i| {
            let target = sum * (i as f64 + 0.5) / VALUES as f64;
            // The first place, 0, is below every target.
            self.values[places.partition_point(|place| *place <= target) - 1]
        }))
    }

    /// One round of Lloyd's algorithm: the mean of the values nearest to each entry. An entry without any stays.
    fn means(&self, book: &Codebook) -> Codebook {
        let mut start = 0;
        Codebook(std::array::from_fn(|i| {
            let value = book.0[i];
            let end = match book.0.get(i + 1) {
                Some(next) => {
                    let middle = (f64::from(value) + f64::from(*next)) / 2.0;
                    self.values.partition_point(|v| f64::from(*v) <= middle)
                }
                None => self.values.len(),
            };
            let range = start..end.max(start);
            start = range.end;
            if range.is_empty() {
                return value;
            }
            ((self.sums[range.end] - self.sums[range.start]) / range.len() as f64) as f32
        }))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::Random;

    fn squares(values: &[f32], book: &Codebook) -> f64 {
        values.iter().map(|v| f64::from(book.0[usize::from(book.byte(*v))] - v).powi(2)).sum()
    }

    #[test]
    fn few_values_are_kept_as_they_are() {
        let values: Vec<f32> = (0..1000).map(|i| ((i * 7) % 256) as f32 / 3.0).collect();
        assert_eq!(squares(&values, &Codebook::of(values.clone())), 0.0);
        assert_eq!(Codebook::of(vec![2.5]).0, [2.5; VALUES]);
        assert_eq!(Codebook::of(Vec::new()).0, [0.0; VALUES]);
    }

    #[test]
    fn a_codebook_is_ascending_and_better_than_equal_steps() {
        let mut random = Random::of(1);
        let mut values: Vec<f32> = (0..20_000).map(|_| random.normal() as f32).collect();
        values.push(40.0); // far from all others
        let book = Codebook::of(values.clone());
        assert!(book.0.is_sorted());
        let steps = Codebook(std::array::from_fn(|i| -4.0 + 44.0 * i as f32 / 255.0));
        assert!(squares(&values, &book) < 0.03 * squares(&values, &steps));
        assert_eq!(book.0[255], 40.0);
    }

    /// Panter and Dite (1951): the error of the best codebook of a normal distribution is pi sqrt(3) / 2 / 256^2.
    #[test]
    fn a_codebook_of_normal_values_has_nearly_the_least_error() {
        let mut random = Random::of(2);
        let values: Vec<f32> = (0..200_000).map(|_| random.normal() as f32).collect();
        let mean = squares(&values, &Codebook::of(values.clone())) / values.len() as f64;
        let least = std::f64::consts::PI * 3_f64.sqrt() / 2.0 / (256.0 * 256.0);
        assert!(mean < 1.2 * least, "{mean} for {least}");
    }
}
