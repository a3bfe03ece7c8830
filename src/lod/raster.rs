//! Small pictures of few nodes along a direction, with parallel rays, by the antialiased rules.

use glam::{DMat3, DVec3};
use multiversion::multiversion;

use super::node::Nodes;
use crate::rules::{ALPHA_MAX, ALPHA_MIN, LOW_PASS};
use crate::scene::harmonics;

/// The axes of a picture: its viewing direction.
#[derive(Clone, Copy, Debug)]
pub struct Direction {
    pub right: DVec3,
    pub down: DVec3,
    pub forward: DVec3,
}

impl Direction {
    pub fn to(forward: DVec3) -> Self {
        let forward = forward.normalize();
        let (right, down) = forward.any_orthonormal_pair();
        Self { right, down, forward }
    }
}

/// Six of the twelve corners of an icosahedron, one of each opposite pair: the most even six directions. Every second
/// one is reversed, since occlusion differs from the two sides.
pub fn directions() -> [Direction; 6] {
    let long = (1.0 + 5.0_f64.sqrt()) / 2.0;
    let corners =
        [[0.0, 1.0, long], [0.0, 1.0, -long], [1.0, long, 0.0], [-1.0, long, 0.0], [long, 0.0, 1.0], [-long, 0.0, 1.0]];
    let mut sign = 1.0;
    corners.map(|corner| {
        let forward = DVec3::from(corner) * sign;
        sign = -sign;
        Direction::to(forward)
    })
}

/// The pixel grid of a picture in the world.
#[derive(Clone, Copy, Debug)]
pub struct Window {
    pub direction: Direction,
    /// The corner of the first pixel, in the axes of the direction.
    pub origin: DVec3,
    /// Width of a pixel, world units.
    pub px: f64,
    pub width: usize,
    pub height: usize,
}

/// Pixels around the means.
pub const MARGIN: f64 = 4.0;

impl Window {
    /// A window around all means, seen in this direction.
    pub fn around(nodes: &Nodes, direction: Direction, px: f64) -> Self {
        Self::within(nodes, direction, px, MARGIN * px)
    }

    /// Tiles of at most `side` x `side` px that cover this window.
    pub fn tiles(self, side: usize) -> impl Iterator<Item = Self> {
        let Self { width, height, .. } = self;
        let starts = move |length: usize| (0..length).step_by(side);
        starts(height).flat_map(move |y| starts(width).map(move |x| (x, y))).map(move |(x, y)| {
            let origin = self.origin + DVec3::new(x as f64, y as f64, 0.0) * self.px;
            Self { origin, width: side.min(width - x), height: side.min(height - y), ..self }
        })
    }

    /// A window that reaches `margin` beyond all means, world units.
    pub fn within(nodes: &Nodes, direction: Direction, px: f64, margin: f64) -> Self {
        let (mut low, mut high) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
        for node in &nodes.nodes {
            let centre = node.centre();
            let seen =
                DVec3::new(direction.right.dot(centre), direction.down.dot(centre), direction.forward.dot(centre));
            (low, high) = (low.min(seen), high.max(seen));
        }
        let origin = low - DVec3::new(margin, margin, 0.0);
        let side = |from: f64, to: f64| ((to - from + 2.0 * margin) / px).ceil().max(1.0) as usize;
        Self { direction, origin, px, width: side(low.x, high.x), height: side(low.y, high.y) }
    }
}

/// A node in a window, without its opacity and its colour of degree 0: it stays valid while only these change.
#[derive(Clone, Copy, Debug, Default)]
pub struct Splat {
    pub mean: [f32; 2],
    /// The inverse covariance: xx, xy, yy.
    pub conic: [f32; 3],
    variance_y: f64,
    /// The factor of the opacity that compensates for the low-pass.
    compensation: f64,
    /// The colour in this direction without the term of degree 0.
    higher_degrees: [f64; 3],
}

/// Standard deviations beyond which no alpha of a node is above the threshold, whatever its opacity.
pub const MOST_DEVIATIONS: f64 = 6.0;

/// The inverse of the threshold of alphas.
pub const PER_ALPHA_MIN: f32 = 255.0;
const _: () = assert!(1.0 / PER_ALPHA_MIN == ALPHA_MIN);

/// Nodes in a window, front to back.
pub struct Splats {
    pub window: Window,
    /// The basis function of degree 0.
    degree_0: f64,
    pub splats: Vec<Splat>,
    /// Indices of the splats that may be in the window, front to back.
    order: Vec<u32>,
}

/// Red, green and blue times alpha, and the transmittance.
pub type Pixel = [f32; 4];

/// Numbers that one instruction works on.
pub const LANES: usize = 8;

/// The values of pixels, row by row, and of [`LANES`] empty pixels behind the last. Each value of a [`Pixel`] has a
/// plane of its own, so that neighbours are loaded by one instruction.
#[derive(Clone, Debug, Default)]
pub struct Picture {
    planes: [Vec<f32>; 4],
}

impl Picture {
    fn clear(&mut self, pixels: usize) {
        for (plane, empty) in self.planes.iter_mut().zip([0.0, 0.0, 0.0, 1.0]) {
            plane.clear();
            plane.resize(pixels + LANES, empty);
        }
    }

    pub fn pixels(&self) -> impl Iterator<Item = Pixel> {
        let [red, green, blue, passing] = &self.planes;
        red.iter().zip(green).zip(blue).zip(passing).map(|(((r, g), b), passing)| [*r, *g, *b, *passing])
    }
}

/// A picture, and the weights of each splat in it. The memory is reused by the next picture.
#[derive(Clone, Debug, Default)]
pub struct Drawing {
    pub picture: Picture,
    rows: Vec<Row>,
    weights: Vec<f32>,
}

/// The first pixel of a row that a splat covers, and where the weights of these pixels begin.
#[derive(Clone, Copy, Debug)]
struct Row {
    splat: u32,
    first: u32,
    weights: u32,
}

impl Drawing {
    /// The rows of all splats, front to back: the splat, the first pixel, and from there on the weights of the splat's
    /// colour, alpha times transmittance. Zeros pad the last [`LANES`] weights.
    pub fn rows(&self) -> impl DoubleEndedIterator<Item = (usize, usize, &[[f32; LANES]])> {
        (0..self.rows.len()).map(|i| {
            let Row { splat, first, weights } = self.rows[i];
            let end = self.rows.get(i + 1).map_or(self.weights.len(), |next| next.weights as usize);
            (splat as usize, first as usize, self.weights[weights as usize..end].as_chunks().0)
        })
    }
}

/// 2^x, to 1e-6 of it. The same bits on every machine, unlike the functions of the system.
pub fn exp2(x: f32) -> f32 {
    /// Adding this rounds to an integer, which is then in the lowest bits.
    const ROUNDER: f32 = 12_582_912.0;
    let x = x.max(-126.0);
    let shifted = x + ROUNDER;
    let rest = x - (shifted - ROUNDER);
    let whole = f32::from_bits(shifted.to_bits().wrapping_sub(ROUNDER.to_bits()).wrapping_add(127) << 23);
    // Taylor's series of 2^rest, |rest| <= 1/2.
    let series = 1.0
        + rest
            * (std::f32::consts::LN_2
                + rest * (0.240_226_5 + rest * (0.055_504_11 + rest * (0.009_618_13 + rest * 0.001_333_36))));
    whole * series
}

/// The logarithm of x >= 1 to base 2, to 1e-5. The same bits on every machine.
pub fn log2(x: f32) -> f32 {
    let exponent = (x.to_bits() >> 23) as f32 - 127.0;
    let mantissa = f32::from_bits(x.to_bits() & 0x007f_ffff | 0x3f80_0000);
    // Newton's method, from a line that is 0.09 off at most.
    let mut logarithm = mantissa - 1.0;
    for _ in 0..3 {
        logarithm += (mantissa * exp2(-logarithm) - 1.0) * std::f32::consts::LOG2_E;
    }
    exponent + logarithm
}

impl Splats {
    pub fn of(nodes: &Nodes, window: Window) -> Self {
        let Direction { right, down, forward } = window.direction;
        let basis = harmonics::basis(forward.to_array());
        let count = nodes.len();
        let (mut splats, mut depths) = (Vec::with_capacity(count), Vec::with_capacity(count));
        for (i, node) in nodes.nodes.iter().enumerate() {
            let centre = node.centre();
            let mean =
                [(right, window.origin.x), (down, window.origin.y)].map(|(axis, o)| (axis.dot(centre) - o) / window.px);
            let reach =
                MOST_DEVIATIONS * (f64::from(node.scale.into_iter().fold(0.0, f32::max)) / window.px + LOW_PASS.sqrt());
            let sides = [window.width, window.height].map(|side| side as f64);
            if (0..2).any(|i| mean[i] < -reach || mean[i] > sides[i] + reach) {
                splats.push(Splat::default());
                continue;
            }
            let axes: DMat3 = node.axes();
            let (u, v) = (axes.transpose() * right / window.px, axes.transpose() * down / window.px);
            let sharp = u.cross(v).length_squared();
            let (a, b, c) = (u.length_squared() + LOW_PASS, u.dot(v), v.length_squared() + LOW_PASS);
            let determinant = a * c - b * b;
            let higher = || nodes.sh(i).iter().zip(basis).skip(1);
            splats.push(Splat {
                mean: mean.map(|v| v as f32),
                conic: [c, -b, a].map(|v| (v / determinant) as f32),
                variance_y: c,
                compensation: (sharp / determinant).sqrt(),
                higher_degrees: [0, 1, 2].map(|k| higher().map(|(value, basis)| f64::from(value[k]) * basis).sum()),
            });
            depths.push((forward.dot(centre) as f32, i as u32));
        }
        depths.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        Self { window, degree_0: basis[0], splats, order: depths.into_iter().map(|(_, i)| i).collect() }
    }

    /// The current colour of a node in the direction of the window.
    pub fn colour(&self, nodes: &Nodes, index: usize) -> [f32; 3] {
        let (first, higher_degrees) = (nodes.sh(index)[0], self.splats[index].higher_degrees);
        [0, 1, 2].map(|k| (0.5 + f64::from(first[k]) * self.degree_0 + higher_degrees[k]).max(0.0) as f32)
    }

    /// Draws the nodes of these splats with their current opacities and colours.
    pub fn draw(&self, nodes: &Nodes, drawing: &mut Drawing) {
        draw(self, nodes, drawing);
    }
}

/// See [`Splats::draw`]. All versions make the same bits: none joins a product and a sum in one operation.
#[multiversion(targets("x86_64+avx2"))]
fn draw(splats: &Splats, nodes: &Nodes, drawing: &mut Drawing) {
    let Window { width, height, .. } = splats.window;
    let Drawing { picture, rows, weights } = drawing;
    rows.clear();
    weights.clear();
    picture.clear(width * height);
    for index in splats.order.iter().map(|i| *i as usize) {
        let Splat { mean, conic: [a, b, c], variance_y, compensation, .. } = splats.splats[index];
        let opacity = (f64::from(nodes.nodes[index].opacity) * compensation) as f32;
        // It is no number if the conic of a long thin node has rounded to none.
        if opacity.is_nan() || opacity <= ALPHA_MIN {
            continue;
        }
        let colour = splats.colour(nodes, index);
        // The square of the number of standard deviations to the edge of the ellipse, where alpha is the threshold,
        // and half of its height.
        let edge = 2.0 * std::f32::consts::LN_2 * log2(opacity * PER_ALPHA_MIN);
        let (reach, per_a) = ((f64::from(edge) * variance_y).sqrt() as f32, 1.0 / a);
        for row in centres_within(mean[1], reach, height) {
            let y = row as f32 + 0.5 - mean[1];
            let root = (b * y).powi(2) - a * (c * y * y - edge);
            if root <= 0.0 {
                continue;
            }
            let (middle, half) = (mean[0] - b * y * per_a, root.sqrt() * per_a);
            let columns = centres_within(middle, half, width);
            if columns.is_empty() {
                continue;
            }
            const LOG2: f32 = -0.5 * std::f32::consts::LOG2_E;
            let (x0, squared, linear, constant) =
                (columns.start as f32 + 0.5 - mean[0], LOG2 * a, LOG2 * 2.0 * b * y, LOG2 * c * y * y);
            let first = row * width + columns.start;
            let [splat, from, begin] = [index, first, weights.len()].map(|n| n as u32);
            rows.push(Row { splat, first: from, weights: begin });
            // Whole lanes without a branch: rows are short, and of lengths that the processor cannot guess. Closures
            // would be calls here.
            let count = columns.len() as f32;
            let mut along: [f32; LANES] = std::array::from_fn(|lane| lane as f32);
            let [red, green, blue, passing] = &mut picture.planes;
            let colours = lanes_from(red, first).zip(lanes_from(green, first)).zip(lanes_from(blue, first));
            for (((red, green), blue), passing) in colours.zip(lanes_from(passing, first)) {
                let mut lanes = [0.0; LANES];
                for (lane, along) in lanes.iter_mut().zip(&mut along) {
                    let x = x0 + *along;
                    let alpha = (opacity * exp2(constant + x * (linear + x * squared))).min(ALPHA_MAX);
                    *lane = if *along < count { alpha } else { 0.0 };
                    *along += LANES as f32;
                }
                for (weight, passing) in lanes.iter_mut().zip(&mut *passing) {
                    *weight *= *passing;
                    *passing -= *weight;
                }
                for (values, colour) in [red, green, blue].into_iter().zip(colour) {
                    for (value, weight) in values.iter_mut().zip(&lanes) {
                        *value += colour * weight;
                    }
                }
                weights.extend_from_slice(&lanes);
                if along[0] >= count {
                    break;
                }
            }
        }
    }
}

/// The values from this pixel on.
#[inline(always)]
pub fn lanes_from(plane: &mut [f32], first: usize) -> impl Iterator<Item = &mut [f32; LANES]> {
    plane[first..].as_chunks_mut().0.iter_mut()
}

/// The pixels whose centres lie within `reach` of `middle`, of `count`.
fn centres_within(middle: f32, reach: f32, count: usize) -> std::ops::Range<usize> {
    // Conversions round towards 0 and saturate. They are faster than floor and ceil, which are calls in builds for old
    // processors.
    let low = middle - reach - 0.5;
    let first = low as u32 + u32::from(low > low as u32 as f32);
    let end = ((middle + reach + 0.5) as u32).min(count as u32);
    first.min(end) as usize..end as usize
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lod::Node;

    #[test]
    fn powers_of_two_are_those_of_the_system() {
        for i in -2000..400 {
            let x = i as f32 / 17.0;
            assert!((exp2(x) / x.exp2() - 1.0).abs() < 1e-5 || x < -125.0, "{x}: {}", exp2(x));
        }
        assert!(exp2(-1e30) < 1e-37);
        for i in 0..4000 {
            let x = exp2(i as f32 / 170.0);
            assert!((log2(x) - x.log2()).abs() < 1e-5, "{x}: {}", log2(x));
        }
    }

    #[test]
    fn a_picture_has_transmittance_and_occlusion() {
        let red = [[1.0 / 0.282_094_79 * 0.5, -1.772, -1.772]];
        let mut nodes = Nodes::new(0);
        let direction = directions()[0];
        let place = |depth: f64| (direction.forward * depth).as_vec3().to_array();
        nodes.push(Node::leaf(place(2.0), [1.0, 0.0, 0.0, 0.0], [1.0; 3], 0.9), &[[0.0; 3]]);
        nodes.push(Node::leaf(place(1.0), [1.0, 0.0, 0.0, 0.0], [1.0; 3], 0.5), &red);
        let window = Window::around(&nodes, direction, 0.25);
        let mut drawing = Drawing::default();
        Splats::of(&nodes, window).draw(&nodes, &mut drawing);
        let middle = drawing.picture.pixels().min_by(|a, b| a[3].total_cmp(&b[3])).unwrap();
        // The low-pass widens the variance from 16 to 16.3 px^2.
        let [near, far] = [0.5, 0.9].map(|opacity: f32| opacity * 16.0 / 16.3);
        let rest = (1.0 - near) * far * 0.5;
        let expected = [near + rest, rest, rest, (1.0 - near) * (1.0 - far)];
        assert!((0..4).all(|k| (middle[k] - expected[k]).abs() < 0.01), "{middle:?}, not {expected:?}");
        let mut sums = vec![[0.0_f32; 4]; drawing.picture.pixels().count()];
        for (splat, first, weights) in drawing.rows() {
            let colour = [[0.5; 3], [1.0, 0.0, 0.0]][splat];
            for (sum, weight) in sums[first..].iter_mut().zip(weights.as_flattened()) {
                (0..3).for_each(|k| sum[k] += colour[k] * weight);
                sum[3] += weight;
            }
        }
        let is_sum = |(sum, pixel): (&Pixel, Pixel)| {
            (0..4).all(|k| (sum[k] - if k == 3 { 1.0 - pixel[3] } else { pixel[k] }).abs() < 1e-3)
        };
        assert!(
            sums.iter().zip(drawing.picture.pixels()).all(is_sum),
            "a picture is the sum of what its splats have of it"
        );
    }
}
