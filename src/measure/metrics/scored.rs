//! Measures of the pixels that a camera sees: a pixel without a ray says nothing of a picture.

use std::borrow::Cow;

use super::difference::Difference;
use super::errors::mse;
use super::flip::{Flip, PIXELS_PER_DEGREE, flip};
use super::ssim::{WINDOW, ssim};
use crate::pixels::Pixels;

/// Two pictures of one size, to be measured where pixels count. The others are made black in both, so that they differ
/// nowhere, and means are over those that count.
pub struct Scored<'p> {
    pictures: [Cow<'p, Pixels>; 2],
    /// True of pixels that count, row-major; `None` if all do.
    counts: Option<Vec<bool>>,
}

impl<'p> Scored<'p> {
    /// `counts`: one value per pixel, row-major; `None` if all pixels count.
    ///
    /// # Panics
    /// If the sizes differ.
    pub fn new(a: &'p Pixels, b: &'p Pixels, counts: Option<Vec<bool>>) -> Self {
        let blackened = |pixels: &'p Pixels| match &counts {
            None => Cow::Borrowed(pixels),
            Some(counts) => {
                assert_eq!(counts.len(), pixels.rgba.len(), "a mask has as many values as the pictures have pixels");
                let rgba = pixels.rgba.iter().zip(counts).map(|(pixel, counts)| if *counts { *pixel } else { BLACK });
                Cow::Owned(Pixels { size: pixels.size, rgba: rgba.collect() })
            }
        };
        Self { pictures: [blackened(a), blackened(b)], counts }
    }

    /// PSNR in dB of the pixels that count; infinite if they are equal.
    pub fn psnr(&self) -> f64 {
        -10.0 * (mse(&self.pictures[0], &self.pictures[1]) * self.pixels()).log10()
    }

    /// Mean SSIM of the windows that hold a pixel that counts; `None` if the pictures are smaller than a window.
    pub fn ssim(&self) -> Option<f64> {
        ssim(&self.pictures[0], &self.pictures[1]).map(|mean| self.of_windows(mean))
    }

    /// All measures, with FLIP at [`PIXELS_PER_DEGREE`].
    pub fn difference(&self) -> Difference {
        let [a, b] = &self.pictures;
        let Flip { map, mean } = flip(a, b, PIXELS_PER_DEGREE);
        let mean = match &self.counts {
            None => mean,
            Some(counts) => {
                let counted = map.iter().zip(counts).filter(|(_, counts)| **counts).map(|(error, _)| f64::from(*error));
                counted.sum::<f64>() / map.len() as f64 * self.pixels()
            }
        };
        let mut of = Difference::with_flip(a, b, &Flip { map, mean });
        let pixels = self.pixels();
        for mean in [&mut of.over.steps_1, &mut of.over.steps_4, &mut of.over.steps_16, &mut of.changed8] {
            *mean *= pixels;
        }
        if of.non_finite == 0 {
            of.mse *= pixels;
            of.psnr_db = (of.mse > 0.0).then(|| -10.0 * of.mse.log10());
            of.ssim = of.ssim.map(|mean| self.of_windows(mean));
        }
        of
    }

    /// All pixels over those that count.
    fn pixels(&self) -> f64 {
        self.counts.as_ref().map_or(1.0, |counts| over(counts.iter().copied()))
    }

    /// The mean of the windows that hold a pixel that counts, from the mean of all: the others have the value 1.
    fn of_windows(&self, mean: f64) -> f64 {
        let Some(counts) = &self.counts else { return mean };
        let [width, height] = self.pictures[0].size.map(|side| side as usize);
        // Whether a row of a window holds one, then whether one of its rows does.
        let in_row: Vec<Vec<bool>> =
            counts.chunks(width).map(|row| row.windows(WINDOW).map(|row| row.contains(&true)).collect()).collect();
        let holds = (0..=height - WINDOW)
            .flat_map(|y| (0..=width - WINDOW).map(move |x| (x, y)))
            .map(|(x, y)| in_row[y..y + WINDOW].iter().any(|row| row[x]));
        1.0 - (1.0 - mean) * over(holds)
    }
}

const BLACK: [f32; 4] = [0.0, 0.0, 0.0, 1.0];

/// All values over those that are true, or over one if none is.
fn over(values: impl Iterator<Item = bool>) -> f64 {
    let (all, held) = values.fold((0_u64, 0_u64), |(all, held), value| (all + 1, held + u64::from(value)));
    all as f64 / held.max(1) as f64
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::measure::metrics::samples::{SIZE, blocks, noise, noisy};

    /// The left half of the pictures counts; what is in the right half is of no consequence.
    #[test]
    fn pixels_that_do_not_count_change_nothing() {
        let [width, height] = SIZE.map(|side| side as usize);
        let left = |i: usize| i % width < width / 2;
        let joined = |a: &Pixels, b: &Pixels| {
            let rgba = a.rgba.iter().zip(&b.rgba).enumerate().map(|(i, (a, b))| if left(i) { *a } else { *b });
            Pixels { size: a.size, rgba: rgba.collect() }
        };
        let counts = || Some((0..width * height).map(left).collect::<Vec<_>>());
        let (a, b) = (blocks(1), noisy(&blocks(1)));
        let expected = Scored::new(&a, &b, counts()).difference();
        let bad = Pixels { size: SIZE, rgba: vec![[f32::NAN; 4]; width * height] };
        for other in [noise(4), bad] {
            assert_eq!(Scored::new(&joined(&a, &other), &b, counts()).difference(), expected);
        }
        // The pixels that count, alone.
        let half = |pixels: &Pixels| Pixels {
            size: [SIZE[0] / 2, SIZE[1]],
            rgba: (0..width * height).filter(|i| left(*i)).map(|i| pixels.rgba[i]).collect(),
        };
        let alone = Difference::between(&half(&a), &half(&b));
        assert!((expected.mse / alone.mse - 1.0).abs() < 1e-9, "{expected:?} {alone:?}");
        assert!((expected.changed8 - alone.changed8).abs() < 1e-9 && expected.max_error == alone.max_error);
        let scored = Scored::new(&a, &b, counts());
        assert_eq!((scored.psnr(), scored.ssim()), (expected.psnr_db.unwrap(), expected.ssim));
        // Windows and filters at the border see black, too.
        assert!((expected.ssim.unwrap() - alone.ssim.unwrap()).abs() < 0.1, "{expected:?} {alone:?}");
        assert!((expected.flip - alone.flip).abs() < 0.1, "{expected:?} {alone:?}");
    }

    #[test]
    fn all_pixels_count_without_a_mask() {
        let (a, b) = (blocks(1), noisy(&blocks(1)));
        let (all, none) = (vec![true; a.rgba.len()], vec![false; a.rgba.len()]);
        let expected = Difference::between(&a, &b);
        assert_eq!(Scored::new(&a, &b, None).difference(), expected);
        assert_eq!(Scored::new(&a, &b, Some(all)).difference(), expected);
        assert_eq!(Scored::new(&a, &b, Some(none)).difference(), Difference::between(&a, &a));
    }
}
