//! Structural similarity: Wang, Bovik, Sheikh, Simoncelli, "Image quality assessment: from error visibility to
//! structural similarity", IEEE Transactions on Image Processing 13(4), 2004.

use super::filter::{Filter, Plane};
use super::{by_row, check_sizes, displayed};
use crate::pixels::Pixels;

/// Side of the window in pixels.
pub(super) const WINDOW: usize = 11;
/// Standard deviation of the window's weights in pixels.
const SIGMA: f64 = 1.5;
/// (K1 L)^2 and (K2 L)^2 with K1 = 0.01, K2 = 0.03 and the peak L = 1.
const C1: f32 = 0.0001;
const C2: f32 = 0.0009;

/// Mean structural similarity of the colour channels, which are clamped to 0 and 1: 1 for equal images, at least -1.
/// The mean is over the windows that lie inside the image; `None` if the image is too small for a window.
///
/// # Panics
/// If the images differ in size.
pub fn ssim(a: &Pixels, b: &Pixels) -> Option<f64> {
    check_sizes(a, b);
    let [width, height] = a.size.map(|side| side as usize);
    if width < WINDOW || height < WINDOW {
        return None;
    }
    let channels = (0..3).map(|channel| of_channel(a, b, channel));
    Some(channels.sum::<f64>() / 3.0)
}

fn of_channel(a: &Pixels, b: &Pixels, channel: usize) -> f64 {
    let pair = |i: usize| (displayed(a.rgba[i][channel]), displayed(b.rgba[i][channel]));
    // Moments of the sum and the difference of the images, not of the images: small values are then not differences of
    // large ones, and four moments suffice instead of five.
    let sum = |i: usize| pair(i).0 + pair(i).1;
    let difference = |i: usize| pair(i).0 - pair(i).1;
    let moments = [
        Plane::new(a.size, sum),
        Plane::new(a.size, |i| sum(i).powi(2)),
        Plane::new(a.size, difference),
        Plane::new(a.size, |i| difference(i).powi(2)),
    ];
    let filter = window();
    let (radius, [width, height]) = (filter.radius(), a.size.map(|side| side as usize));
    let inside = width - 2 * radius;
    let rows = by_row(radius..height - radius, |y| {
        let mut column = vec![0.0; width];
        let [sum, sum2, difference, difference2] = [0, 1, 2, 3].map(|i: usize| {
            let mut row = vec![0.0; inside];
            filter.down(&moments[i], y, &mut column);
            filter.along(&column, &mut row);
            row
        });
        (0..inside).map(|x| f64::from(of_window([sum[x], sum2[x]], [difference[x], difference2[x]]))).sum::<f64>()
    });
    rows.iter().sum::<f64>() / (rows.len() * inside) as f64
}

/// The similarity of a window from the means and mean squares of a + b and a - b.
fn of_window([sum, sum2]: [f32; 2], [difference, difference2]: [f32; 2]) -> f32 {
    // 2 mean_a mean_b = (sum^2 - difference^2) / 2 and mean_a^2 + mean_b^2 = (sum^2 + difference^2) / 2; the same for
    // covariance and variances.
    let similarity = |sum: f32, difference: f32, c: f32| 1.0 - difference / ((sum + difference) / 2.0 + c);
    let (means, variances) =
        ([sum * sum, difference * difference], [sum2 - sum * sum, difference2 - difference * difference]);
    similarity(means[0], means[1], C1) * similarity(variances[0], variances[1], C2)
}

fn window() -> Filter {
    let weight = |x: f64| (-x * x / (2.0 * SIGMA * SIGMA)).exp();
    let radius = WINDOW / 2;
    let total: f64 = (0..WINDOW).map(|i| weight(i as f64 - radius as f64)).sum();
    Filter::new(radius, |x| weight(x) / total)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::measure::metrics::samples::{SIZE, blocks, noise, noisy};

    /// Moments are summed in f32: in flat windows of different colours, variances of 0 are wrong by about 1e-7, which
    /// is divided by C2.
    const TOLERANCE: f64 = 5e-6;

    #[test]
    fn ssim_is_that_of_scikit_image() {
        // scikit-image 0.26.0 in f64: structural_similarity(a, b, gaussian_weights=True, sigma=1.5,
        // use_sample_covariance=False, data_range=1, channel_axis=2)
        let published = [
            (noise(2), noise(3), 0.019222416),
            (blocks(1), noisy(&blocks(1)), 0.890806194),
            (blocks(1), blocks(5), 0.030491109),
        ];
        for (a, b, expected) in published {
            let found = ssim(&a, &b).unwrap();
            assert!((found - expected).abs() < TOLERANCE, "{found}, not {expected}");
        }
    }

    #[test]
    fn ssim_of_equal_images_is_1() {
        assert_eq!(ssim(&noise(1), &noise(1)), Some(1.0));
    }

    #[test]
    fn ssim_of_constant_images_is_that_of_their_means() {
        let grey = |value: f32| Pixels { size: SIZE, rgba: vec![[value, value, value, 1.0]; noise(0).rgba.len()] };
        let expected = (2.0 * 0.5 * 0.25 + 1e-4) / (0.5 * 0.5 + 0.25 * 0.25 + 1e-4);
        assert!((ssim(&grey(0.5), &grey(0.25)).unwrap() - expected).abs() < TOLERANCE);
        assert_eq!(ssim(&grey(1.0), &grey(7.0)), Some(1.0), "values over 1 are white");
    }

    #[test]
    fn ssim_needs_a_window() {
        let of_size = |size: [u32; 2]| Pixels { size, rgba: vec![[0.5; 4]; (size[0] * size[1]) as usize] };
        assert_eq!(ssim(&of_size([10, 20]), &of_size([10, 20])), None);
        assert_eq!(ssim(&of_size([20, 10]), &of_size([20, 10])), None);
        assert_eq!(ssim(&of_size([11, 11]), &of_size([11, 11])), Some(1.0));
    }
}
