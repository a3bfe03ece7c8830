//! Small pictures of few nodes along a direction, with parallel rays, by the antialiased rules.

use glam::{DMat3, DVec3};

use super::node::Nodes;
use crate::rules::{ALPHA_MAX, ALPHA_MIN, LOW_PASS};
use crate::scene::harmonics;

/// A direction in which nodes are looked at.
#[derive(Clone, Copy, Debug)]
pub struct Direction {
    right: DVec3,
    down: DVec3,
    forward: DVec3,
}

/// Six of the twelve corners of an icosahedron, one of each opposite pair: the most even six directions. Three look one
/// way and three the other, since splats cover one another differently from the two sides.
pub fn directions() -> [Direction; 6] {
    let long = (1.0 + 5.0_f64.sqrt()) / 2.0;
    let corners =
        [[0.0, 1.0, long], [0.0, 1.0, -long], [1.0, long, 0.0], [-1.0, long, 0.0], [long, 0.0, 1.0], [-long, 0.0, 1.0]];
    let mut sign = 1.0;
    corners.map(|corner| {
        let forward = DVec3::from(corner).normalize() * sign;
        sign = -sign;
        let (right, down) = forward.any_orthonormal_pair();
        Direction { right, down, forward }
    })
}

/// The part of the world that a picture shows.
#[derive(Clone, Copy, Debug)]
pub struct Window {
    direction: Direction,
    origin: DVec3,
    /// Width of a pixel, world units.
    px: f64,
    pub width: usize,
    pub height: usize,
}

/// Pixels around the means.
const MARGIN: f64 = 4.0;

impl Window {
    /// A window around all means, seen in this direction.
    pub fn around(nodes: &Nodes, direction: Direction, px: f64) -> Self {
        let (mut low, mut high) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
        for node in &nodes.nodes {
            let centre = node.centre();
            let seen =
                DVec3::new(direction.right.dot(centre), direction.down.dot(centre), direction.forward.dot(centre));
            (low, high) = (low.min(seen), high.max(seen));
        }
        let origin = low - DVec3::new(MARGIN * px, MARGIN * px, 0.0);
        let side = |from: f64, to: f64| ((to - from) / px + 2.0 * MARGIN).ceil().max(1.0) as usize;
        Self { direction, origin, px, width: side(low.x, high.x), height: side(low.y, high.y) }
    }
}

/// A node in a window.
#[derive(Clone, Copy, Debug)]
struct Splat {
    mean: [f32; 2],
    /// The inverse covariance: xx, xy, yy.
    conic: [f32; 3],
    /// Half height of the ellipse outside of which alpha is below the threshold, px.
    reach: f32,
    /// The square of the number of standard deviations to its edge.
    edge: f32,
    opacity: f32,
}

/// Nodes in a window, front to back.
pub struct Splats {
    window: Window,
    splats: Vec<Splat>,
    colours: Vec<[f32; 3]>,
    /// The places of the splats, front to back.
    order: Vec<u32>,
}

/// A picture: colour times alpha, and what passes.
#[derive(Clone, Debug)]
pub struct Picture {
    pub width: usize,
    pub colour: [Vec<f32>; 3],
    pub transmittance: Vec<f32>,
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

impl Splats {
    pub fn of(nodes: &Nodes, window: Window) -> Self {
        let Direction { right, down, forward } = window.direction;
        let basis = harmonics::basis(forward.to_array());
        let count = nodes.len();
        let mut splats = Vec::with_capacity(count);
        let (mut colours, mut depths) = (Vec::with_capacity(count), Vec::with_capacity(count));
        for (i, node) in nodes.nodes.iter().enumerate() {
            let centre = node.centre();
            let axes: DMat3 = node.axes();
            let (u, v) = (axes.transpose() * right / window.px, axes.transpose() * down / window.px);
            let sharp = u.cross(v).length_squared();
            let (a, b, c) = (u.length_squared() + LOW_PASS, u.dot(v), v.length_squared() + LOW_PASS);
            let determinant = a * c - b * b;
            let opacity = (f64::from(node.opacity) * (sharp / determinant).sqrt()) as f32;
            let is_drawn = opacity > ALPHA_MIN;
            let edge = if is_drawn { 2.0 * f64::from(opacity / ALPHA_MIN).ln() } else { 0.0 };
            splats.push(Splat {
                mean: [
                    (right.dot(centre) - window.origin.x) / window.px,
                    (down.dot(centre) - window.origin.y) / window.px,
                ]
                .map(|v| v as f32),
                conic: [c, -b, a].map(|v| (v / determinant) as f32),
                reach: if is_drawn { (edge * c).sqrt() as f32 } else { -1.0 },
                edge: edge as f32,
                opacity,
            });
            let sh = nodes.sh(i);
            let channel = |k: usize| {
                let sum: f64 = sh.iter().zip(basis).map(|(value, basis)| f64::from(value[k]) * basis).sum();
                (0.5 + sum).max(0.0) as f32
            };
            colours.push([0, 1, 2].map(channel));
            depths.push((forward.dot(centre) as f32, i as u32));
        }
        depths.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        Self { window, splats, colours, order: depths.into_iter().map(|(_, i)| i).collect() }
    }

    /// Goes through all splats, front to back, row by row. Calls `visit` with the splat, the first pixel, and the
    /// weights of its colour in the pixels from there on: alpha times transmittance. Returns what passes.
    pub fn walk(&self, mut visit: impl FnMut(usize, usize, &[f32])) -> Vec<f32> {
        let Window { width, height, .. } = self.window;
        let mut transmittance = vec![1.0; width * height];
        let mut weights = vec![0.0; width];
        for index in self.order.iter().map(|i| *i as usize) {
            let Splat { mean, conic: [a, b, c], reach, edge, opacity } = self.splats[index];
            if reach < 0.0 {
                continue;
            }
            for row in centres_within(mean[1], reach, height) {
                let y = row as f32 + 0.5 - mean[1];
                let root = (b * y).powi(2) - a * (c * y * y - edge);
                if root <= 0.0 {
                    continue;
                }
                let (middle, half) = (mean[0] - b * y / a, root.sqrt() / a);
                let columns = centres_within(middle, half, width);
                if columns.is_empty() {
                    continue;
                }
                let first = row * width + columns.start;
                let passing = &mut transmittance[first..first + columns.len()];
                let weights = &mut weights[..columns.len()];
                const LOG2: f32 = -0.5 * std::f32::consts::LOG2_E;
                let (x0, squared, linear, constant) =
                    (columns.start as f32 + 0.5 - mean[0], LOG2 * a, LOG2 * 2.0 * b * y, LOG2 * c * y * y);
                for (k, (weight, passing)) in weights.iter_mut().zip(passing).enumerate() {
                    let x = x0 + k as f32;
                    let alpha = (opacity * exp2(constant + x * (linear + x * squared))).min(ALPHA_MAX);
                    *weight = alpha * *passing;
                    *passing -= *weight;
                }
                visit(index, first, weights);
            }
        }
        transmittance
    }

    pub fn draw(&self) -> Picture {
        let Window { width, height, .. } = self.window;
        let mut colour = [(); 3].map(|()| vec![0.0; width * height]);
        let transmittance = self.walk(|splat, first, weights| {
            for (channel, value) in colour.iter_mut().zip(self.colours[splat]) {
                let part = &mut channel[first..first + weights.len()];
                part.iter_mut().zip(weights).for_each(|(sum, weight)| *sum += value * weight);
            }
        });
        Picture { width, colour, transmittance }
    }
}

/// The pixels whose centres lie within `reach` of `middle`, of `count`.
fn centres_within(middle: f32, reach: f32, count: usize) -> std::ops::Range<usize> {
    let first = (middle - reach - 0.5).ceil().max(0.0) as usize;
    let end = ((middle + reach - 0.5).floor() + 1.0).clamp(0.0, count as f32) as usize;
    first.min(end)..end
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::levels::Node;

    #[test]
    fn powers_of_two_are_those_of_the_system() {
        for i in -2000..400 {
            let x = i as f32 / 17.0;
            assert!((exp2(x) / x.exp2() - 1.0).abs() < 1e-5 || x < -125.0, "{x}: {}", exp2(x));
        }
        assert!(exp2(-1e30) < 1e-37);
    }

    #[test]
    fn a_picture_holds_what_passes_and_what_is_near_covers_what_is_far() {
        let red = [[1.0 / 0.282_094_79 * 0.5, -1.772, -1.772]];
        let mut nodes = Nodes::new(0);
        let direction = directions()[0];
        let place = |depth: f64| (direction.forward * depth).as_vec3().to_array();
        nodes.push(Node::leaf(place(2.0), [1.0, 0.0, 0.0, 0.0], [1.0; 3], 0.9), &[[0.0; 3]]);
        nodes.push(Node::leaf(place(1.0), [1.0, 0.0, 0.0, 0.0], [1.0; 3], 0.5), &red);
        let window = Window::around(&nodes, direction, 0.25);
        let picture = Splats::of(&nodes, window).draw();
        let middle = picture.transmittance.iter().copied().enumerate().min_by(|a, b| a.1.total_cmp(&b.1)).unwrap();
        // The low-pass widens the variance from 16 to 16.3 px^2.
        let [near, far] = [0.5, 0.9].map(|opacity: f32| opacity * 16.0 / 16.3);
        let expected = [near + (1.0 - near) * far * 0.5, (1.0 - near) * far * 0.5];
        assert!((middle.1 - (1.0 - near) * (1.0 - far)).abs() < 0.01, "{middle:?}");
        assert!((picture.colour[0][middle.0] - expected[0]).abs() < 0.01, "{}", picture.colour[0][middle.0]);
        assert!((picture.colour[1][middle.0] - expected[1]).abs() < 0.01, "{}", picture.colour[1][middle.0]);
    }
}
