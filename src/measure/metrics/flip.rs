//! LDR-FLIP, the perceived difference of two images that alternate: Andersson, Nilsson, Akenine-Möller, Oskarsson,
//! Åström, Fairchild, "FLIP: A Difference Evaluator for Alternating Images", Proceedings of the ACM on Computer
//! Graphics and Interactive Techniques 3(2), 2020. Constants are the paper's.

use std::f64::consts::PI;

use glam::{DMat3, DVec3, Mat3, Vec3};
use rayon::prelude::*;

use super::filter::{Filter, Plane};
use super::{by_row, check_sizes, displayed, is_finite};
use crate::pixels::Pixels;

/// Pixels per degree of the field of view, at 0.7 m from a display that is 3840 pixels and 0.7 m wide.
pub const PIXELS_PER_DEGREE: f64 = 67.0;

/// The perceived difference of two images.
#[derive(Clone, Debug, PartialEq)]
pub struct Flip {
    /// Error per pixel, row-major, 0 (equal) to 1 (maximal; also for non-finite pixels).
    pub map: Vec<f32>,
    pub mean: f64,
}

/// Compares two images as sRGB, clamped to 0 and 1, seen at `pixels_per_degree` (at least 1).
///
/// # Panics
/// If the images differ in size.
pub fn flip(a: &Pixels, b: &Pixels, pixels_per_degree: f64) -> Flip {
    check_sizes(a, b);
    let width = a.size[0] as usize;
    let (filters, difference) = (Filters::new(pixels_per_degree), ColourDifference::new());
    let images = [Opponent::of(a), Opponent::of(b)];
    let rows = by_row(0..a.size[1] as usize, |y| {
        let [seen_a, seen_b] = images.each_ref().map(|image| filters.row(image, y));
        let pixel = |x: usize| {
            if !is_finite(&a.rgba[y * width + x]) || !is_finite(&b.rgba[y * width + x]) {
                return 1.0;
            }
            let colour = difference.between(seen_a.colour(x), seen_b.colour(x));
            let [edge, point] = [0, 1].map(|i| (seen_a.feature(i, x) - seen_b.feature(i, x)).abs());
            // The exponent is q_f = 0.5.
            let feature = (edge.max(point) * std::f32::consts::FRAC_1_SQRT_2).sqrt();
            colour.powf(1.0 - feature)
        };
        (0..width).map(pixel).collect::<Vec<_>>()
    });
    let map = rows.concat();
    let mean = map.iter().map(|v| f64::from(*v)).sum::<f64>() / map.len() as f64;
    Flip { map, mean }
}

/// An image in opponent channels: luminance, red to green, yellow to blue. They are the paper's Y, Cx and Cz without
/// offset and scale, which the filters preserve.
struct Opponent([Plane; 3]);

impl Opponent {
    fn of(image: &Pixels) -> Self {
        let to_xyz = to_xyz().as_mat3();
        let xyz: Vec<Vec3> =
            image.rgba.par_iter().map(|p| to_xyz * Vec3::new(linear(p[0]), linear(p[1]), linear(p[2]))).collect();
        Self([
            Plane::new(image.size, |i| xyz[i].y),
            Plane::new(image.size, |i| xyz[i].x - xyz[i].y),
            Plane::new(image.size, |i| xyz[i].y - xyz[i].z),
        ])
    }
}

/// The linear value of an sRGB-encoded value.
fn linear(value: f32) -> f32 {
    let value = displayed(value);
    if value <= 0.04045 { value / 12.92 } else { ((value + 0.055) / 1.055).powf(2.4) }
}

/// The matrix from linear sRGB to CIE XYZ in units of the white point D65.
fn to_xyz() -> DMat3 {
    let rows = [
        DVec3::new(10_135_552.0, 8_788_810.0, 4_435_075.0) / 24_577_794.0,
        DVec3::new(2_613_072.0, 8_788_810.0, 887_015.0) / 12_288_897.0,
        DVec3::new(1_425_312.0, 8_788_810.0, 70_074_185.0) / 73_733_382.0,
    ];
    let [x, y, z] = rows.map(|row| row / row.element_sum());
    DMat3::from_cols(x, y, z).transpose()
}

/// One row of an image after the filters that model the eye.
struct SeenRow {
    /// Luminance, red to green, both parts of yellow to blue.
    channels: [Vec<f32>; 4],
    /// Edges and points: horizontal and vertical edges, horizontal and vertical points.
    features: [Vec<f32>; 4],
}

impl SeenRow {
    /// The colour of a pixel in opponent channels.
    fn colour(&self, x: usize) -> Vec3 {
        let [y, cx, cz1, cz2] = self.channels.each_ref().map(|row| row[x]);
        Vec3::new(y, cx, cz1 + cz2)
    }

    /// Strength of the edge (`which` = 0) or the point (1) at a pixel.
    fn feature(&self, which: usize, x: usize) -> f32 {
        let (across, down) = (self.features[2 * which][x], self.features[2 * which + 1][x]);
        (across * across + down * down).sqrt()
    }
}

/// Filters for the contrast sensitivity of the eye, and detectors of edges and points.
struct Filters {
    /// Filters of [`SeenRow::channels`].
    sensitivity: [Filter; 4],
    /// A Gaussian, its first and its second derivative.
    gaussians: [Filter; 3],
}

impl Filters {
    fn new(pixels_per_degree: f64) -> Self {
        Self { sensitivity: sensitivity(pixels_per_degree), gaussians: gaussians(pixels_per_degree) }
    }

    fn row(&self, Opponent([luminance, red_green, yellow_blue]): &Opponent, y: usize) -> SeenRow {
        let through = |plane: &Plane, down: &Filter, along: &Filter| {
            let (width, radius) = (plane.width(), along.radius());
            let mut column = vec![0.0; width + 2 * radius];
            let (start, end) = (radius, radius + width);
            down.down(plane, y, &mut column[start..end]);
            let (first, last) = (column[start], column[end - 1]);
            column[..start].fill(first);
            column[end..].fill(last);
            let mut row = vec![0.0; width];
            along.along(&column, &mut row);
            row
        };
        let [wide, first, second] = &self.gaussians;
        let [y, cx, cz1, cz2] = &self.sensitivity;
        SeenRow {
            channels: [
                through(luminance, y, y),
                through(red_green, cx, cx),
                through(yellow_blue, cz1, cz1),
                through(yellow_blue, cz2, cz2),
            ],
            features: [(wide, first), (first, wide), (wide, second), (second, wide)]
                .map(|(down, along)| through(luminance, down, along)),
        }
    }
}

/// Amplitudes and widths of the sensitivity to luminance, red to green, and yellow to blue, which is a sum of two.
const SENSITIVITY: [(f64, f64); 4] = [(1.0, 0.0047), (1.0, 0.0053), (34.1, 0.04), (13.5, 0.025)];

fn sensitivity(pixels_per_degree: f64) -> [Filter; 4] {
    let widest = SENSITIVITY.iter().map(|(_, b)| *b).fold(0.0, f64::max);
    let radius = (3.0 * (widest / (2.0 * PI * PI)).sqrt() * pixels_per_degree).ceil() as usize;
    // Each direction has the square root of the amplitude: the product of both is the amplitude.
    let weight = |(a, b): (f64, f64), x: f64| {
        (a * (PI / b).sqrt()).sqrt() * (-PI * PI * (x / pixels_per_degree).powi(2) / b).exp()
    };
    let sums = SENSITIVITY.map(|gaussian| (0..=2 * radius).map(|i| weight(gaussian, i as f64 - radius as f64)).sum());
    let [y, cx, cz1, cz2]: [f64; 4] = sums;
    let cz = cz1.hypot(cz2);
    let totals = [y, cx, cz, cz];
    [0, 1, 2, 3].map(|i| Filter::new(radius, |x| weight(SENSITIVITY[i], x) / totals[i]))
}

fn gaussians(pixels_per_degree: f64) -> [Filter; 3] {
    // Half the width w = 0.082 degrees of the features that the detectors respond to.
    let sigma = 0.5 * 0.082 * pixels_per_degree;
    let radius = (3.0 * sigma).ceil() as usize;
    let gaussian = |x: f64| (-x * x / (2.0 * sigma * sigma)).exp();
    let weights: [&dyn Fn(f64) -> f64; 3] =
        [&gaussian, &|x| -x * gaussian(x), &|x| (x * x / (sigma * sigma) - 1.0) * gaussian(x)];
    weights.map(|weight| {
        let all = || (0..=2 * radius).map(|i| weight(i as f64 - radius as f64));
        let positive: f64 = all().filter(|w| *w > 0.0).sum();
        let negative: f64 = all().filter(|w| *w < 0.0).sum();
        // The positive weights add up to 1, and so do the negative ones.
        Filter::new(radius, |x| weight(x) / if weight(x) > 0.0 { positive } else { -negative })
    })
}

/// The colour difference of filtered pixels.
struct ColourDifference {
    to_xyz: Mat3,
    from_xyz: Mat3,
    /// The largest distance, from green to blue.
    most: f32,
}

impl ColourDifference {
    fn new() -> Self {
        let to_xyz = to_xyz();
        let mut difference = Self { to_xyz: to_xyz.as_mat3(), from_xyz: to_xyz.inverse().as_mat3(), most: 0.0 };
        difference.most = distance(difference.lab(Vec3::Y), difference.lab(Vec3::Z));
        difference
    }

    /// The difference, 0 to 1, of two colours in opponent channels.
    fn between(&self, a: Vec3, b: Vec3) -> f32 {
        let [a, b] = [a, b].map(|Vec3 { x: y, y: cx, z: cz }| {
            let rgb = self.from_xyz * Vec3::new(y + cx, y, y - cz);
            self.lab(rgb.clamp(Vec3::ZERO, Vec3::ONE))
        });
        // Differences below p_c = 0.4 of the largest are mapped to p_t = 0.95 of the range, larger ones to the rest.
        let (distance, knee) = (distance(a, b), 0.4 * self.most);
        if distance < knee { distance * 0.95 / knee } else { 0.95 + (distance - knee) / (self.most - knee) * 0.05 }
    }

    /// L*a*b* of linear sRGB, with less chroma in the dark (Hunt effect).
    fn lab(&self, rgb: Vec3) -> Vec3 {
        const DELTA: f32 = 6.0 / 29.0;
        let response = |t: f32| {
            if t > DELTA * DELTA * DELTA { t.cbrt() } else { t / (3.0 * DELTA * DELTA) + 4.0 / 29.0 }
        };
        let xyz = self.to_xyz * rgb;
        let [x, y, z] = xyz.to_array().map(response);
        let lightness = 116.0 * y - 16.0;
        let hunt = 0.01 * lightness;
        Vec3::new(lightness, hunt * 500.0 * (x - y), hunt * 200.0 * (y - z))
    }
}

/// The HyAB distance, which adds the distances of lightness and chroma, to the power of q_c = 0.7.
fn distance(a: Vec3, b: Vec3) -> f32 {
    let d = a - b;
    (d.x.abs() + (d.y * d.y + d.z * d.z).sqrt()).powf(0.7)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::measure::metrics::samples::{SIZE, blocks, noise, noisy};

    /// The authors' implementation also uses f32, in a different order; its notes state differences of 1e-4 between its
    /// variants.
    const TOLERANCE: f64 = 2e-5;

    /// The mean, and the values at [`PLACES`].
    type Expected = (f64, [f32; 5]);
    const PLACES: [(usize, usize); 5] = [(0, 0), (66, 44), (33, 22), (7, 8), (60, 3)];

    #[test]
    fn flip_is_that_of_its_authors() {
        // NVIDIA's flip-evaluator 1.7: evaluate(a, b, "LDR", inputsRGB=True, applyMagma=False, parameters={"ppd": ppd})
        let published: [(Pixels, Pixels, [Expected; 2]); 3] = [
            (
                noise(2),
                noise(3),
                [
                    (0.4625484, [0.489315, 0.957777, 0.228105, 0.528604, 0.273318]),
                    (0.8486779, [0.735203, 0.964452, 0.970803, 0.979935, 0.775844]),
                ],
            ),
            (
                blocks(1),
                noisy(&blocks(1)),
                [
                    (0.2355840, [0.260056, 0.283591, 0.273455, 0.084362, 0.208826]),
                    (0.2902226, [0.390920, 0.212758, 0.380875, 0.171296, 0.303551]),
                ],
            ),
            (
                blocks(1),
                blocks(5),
                [
                    (0.8487648, [0.927288, 0.970454, 0.969982, 0.974668, 0.965284]),
                    (0.8657970, [0.943115, 0.958550, 0.961731, 0.987874, 0.954046]),
                ],
            ),
        ];
        for (a, b, expected) in &published {
            for (ppd, (mean, pixels)) in [67.0, 20.0].into_iter().zip(expected) {
                let found = flip(a, b, ppd);
                assert!((found.mean - mean).abs() < TOLERANCE, "{} at {ppd}, not {mean}", found.mean);
                for ((x, y), expected) in PLACES.iter().zip(pixels) {
                    let pixel = found.map[y * SIZE[0] as usize + x];
                    assert!(f64::from((pixel - expected).abs()) < TOLERANCE, "{pixel} at {x} {y}, not {expected}");
                }
            }
        }
    }

    #[test]
    fn flip_of_equal_images_is_0_and_of_black_and_white_nearly_1() {
        let grey = |value: f32| Pixels { size: [5, 4], rgba: vec![[value, value, value, 1.0]; 20] };
        let of = |a: f32, b: f32| flip(&grey(a), &grey(b), PIXELS_PER_DEGREE).mean;
        assert_eq!(of(0.3, 0.3), 0.0);
        assert_eq!(of(1.0, 9.0), 0.0, "values over 1 are white");
        // The value of the same implementation: white and black differ less than green and blue.
        assert!((of(0.0, 1.0) - 0.9673918).abs() < TOLERANCE, "{}", of(0.0, 1.0));
    }

    #[test]
    fn flip_shows_pixels_that_are_not_finite() {
        let (mut a, b) = (blocks(1), blocks(1));
        a.rgba[70][1] = f32::NAN;
        let map = flip(&a, &b, PIXELS_PER_DEGREE).map;
        assert_eq!(map[70], 1.0);
        assert!(map.iter().all(|v| (0.0..=1.0).contains(v)));
    }

    #[test]
    fn flip_takes_extreme_distances_and_single_pixels() {
        for ppd in [1.0, 1000.0] {
            assert!((0.0..=1.0).contains(&flip(&noise(2), &noise(3), ppd).mean));
        }
        let dot = |value: f32| Pixels { size: [1, 1], rgba: vec![[value; 4]] };
        assert!(flip(&dot(0.2), &dot(0.4), PIXELS_PER_DEGREE).mean > 0.0);
    }
}
