//! How far two images are apart.

use crate::pixels::Pixels;

/// Largest absolute difference of any colour channel of any pixel. NaN differs infinitely.
pub fn max_error(a: &Pixels, b: &Pixels) -> f32 {
    colour_pairs(a, b)
        .map(|(x, y)| if x == y { 0.0 } else { (x - y).abs() })
        .fold(0.0, |m, d| if d <= m { m } else { nan_to_infinity(d) })
}

/// Peak signal-to-noise ratio of the colour channels in dB for a peak of 1, not clamped to the display's range.
/// Infinite for equal images.
pub fn psnr(a: &Pixels, b: &Pixels) -> f64 {
    let count = a.rgba.len() * 3;
    let squares: f64 = colour_pairs(a, b).map(|(x, y)| (f64::from(x) - f64::from(y)).powi(2)).sum();
    -10.0 * (squares / count as f64).log10()
}

fn nan_to_infinity(value: f32) -> f32 {
    if value.is_nan() { f32::INFINITY } else { value }
}

fn colour_pairs<'a>(a: &'a Pixels, b: &'a Pixels) -> impl Iterator<Item = (f32, f32)> + 'a {
    assert_eq!(a.size, b.size, "images to compare have the same size");
    a.rgba.iter().zip(&b.rgba).flat_map(|(p, q)| (0..3).map(|i| (p[i], q[i])))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn grey(values: &[f32]) -> Pixels {
        Pixels { size: [values.len() as u32, 1], rgba: values.iter().map(|v| [*v, *v, *v, 1.0]).collect() }
    }

    #[test]
    fn psnr_of_a_constant_difference_is_its_logarithm() {
        let (a, b) = (grey(&[0.5, 0.25]), grey(&[0.6, 0.35]));
        assert!((psnr(&a, &b) - 20.0).abs() < 1e-5);
        assert_eq!(psnr(&a, &a), f64::INFINITY);
    }

    #[test]
    fn max_error_sees_a_single_bad_value() {
        assert_eq!(max_error(&grey(&[0.5, 0.25]), &grey(&[0.5, 0.75])), 0.5);
        assert_eq!(max_error(&grey(&[f32::NAN]), &grey(&[0.5])), f32::INFINITY);
        assert_eq!(max_error(&grey(&[0.5]), &grey(&[0.5])), 0.0);
    }
}
