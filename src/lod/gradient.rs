//! The gradient of the squared difference of pictures, by the parameters of nodes.
//!
//! As in training, it is carried through the blending from back to front (3D Gaussian splatting, Kerbl et al. 2023).

use glam::{DMat3, DVec3};
use multiversion::multiversion;

use super::node::{Node, Nodes};
use super::raster::{Drawing, LANES, Picture, Splats, lanes_from};
use crate::rules::ALPHA_MAX;
use crate::scene::harmonics;

/// The parameters of a node, a step of them, or a gradient by them: the mean along the node's own axes, in standard
/// deviations; the logarithms of the standard deviations; the turns about the node's own axes, radians; the logarithm
/// of the opacity; and red, green and blue of the harmonics of degree 0.
pub type Parameters = [f32; 13];

/// Pixels on the way from the back to the front. The memory is reused by the next picture.
#[derive(Clone, Debug, Default)]
pub struct Backward {
    /// The gradient by red, green, blue and the transmittance of a pixel.
    by_pixel: [Vec<f32>; 4],
    /// Red, green, blue and the transmittance of the splats behind.
    behind: [Vec<f32>; 4],
    /// The transmittance of the splats in front, and of the one that comes next.
    passing: Vec<f32>,
}

impl Backward {
    /// Adds the gradient of the squared difference between the picture of these nodes and the expected one: the mean
    /// over black and white backgrounds, summed over pixels and channels, px^2.
    pub fn add(
        &mut self,
        expected: &Picture,
        (splats, nodes): (&Splats, &Nodes),
        drawing: &mut Drawing,
        gradients: &mut [Parameters],
    ) {
        splats.draw(nodes, drawing);
        self.begin(expected, &drawing.picture);
        add(self, (splats, nodes), drawing, gradients);
    }

    fn begin(&mut self, expected: &Picture, drawn: &Picture) {
        let Self { by_pixel, behind, passing } = self;
        by_pixel.iter_mut().for_each(Vec::clear);
        passing.clear();
        for (expected, drawn) in expected.pixels().zip(drawn.pixels()) {
            let on_black: [f32; 4] = std::array::from_fn(|k| drawn[k] - expected[k]);
            let on_white = [0, 1, 2].map(|k| on_black[k] + on_black[3]);
            (0..3).for_each(|k| by_pixel[k].push(on_black[k] + on_white[k]));
            by_pixel[3].push(on_white.iter().sum());
            passing.push(drawn[3]);
        }
        for (plane, empty) in behind.iter_mut().zip([0.0, 0.0, 0.0, 1.0]) {
            plane.clear();
            plane.resize(passing.len(), empty);
        }
    }
}

/// Sums over the pixels of a splat: the gradient by the logarithm of alpha, times 1, x, y, xx, xy and yy from its mean,
/// px; and the gradient by its colour.
type Sums<T> = [T; 9];

type Lanes = [f32; LANES];

/// Alphas from here on are clamped ones.
pub const CLAMPED: f32 = 0.9999 * ALPHA_MAX;

/// Smaller parts of gradients count as 0.
const LEAST: f64 = 1e-24;

/// See [`Backward::add`]. All versions make the same bits, as those of [`Splats::draw`] do.
#[multiversion(targets("x86_64+avx2"))]
fn add(backward: &mut Backward, (splats, nodes): (&Splats, &Nodes), drawing: &Drawing, gradients: &mut [Parameters]) {
    let width = splats.window.width;
    let Backward { by_pixel, behind, passing } = backward;
    let mut rows = drawing.rows().rev().peekable();
    while let Some((index, ..)) = rows.peek().copied() {
        let (mean, colour) = (splats.splats[index].mean, splats.colour(nodes, index));
        let mut sums: Sums<Lanes> = Default::default();
        while let Some((_, first, weights)) = rows.next_if(|row| row.0 == index) {
            let (x0, y) = ((first % width) as f32 + 0.5 - mean[0], (first / width) as f32 + 0.5 - mean[1]);
            let mut x: Lanes = std::array::from_fn(|lane| x0 + lane as f32);
            let [red, green, blue, rest] = &mut *behind;
            let colours = lanes_from(red, first).zip(lanes_from(green, first)).zip(lanes_from(blue, first));
            let behind = colours.zip(lanes_from(rest, first)).zip(lanes_from(passing, first));
            let [by_red, by_green, by_blue, by_passing] = &mut *by_pixel;
            let colours = lanes_from(by_red, first).zip(lanes_from(by_green, first)).zip(lanes_from(by_blue, first));
            let by_pixel = colours.zip(lanes_from(by_passing, first));
            for ((weights, behind), by_pixel) in weights.iter().zip(behind).zip(by_pixel) {
                let ((((red, green), blue), rest), passing) = behind;
                let (((by_red, by_green), by_blue), by_passing) = by_pixel;
                let apart = |k: usize, behind: &Lanes| -> Lanes { std::array::from_fn(|i| colour[k] - behind[i]) };
                let [to_red, to_green, to_blue] = [apart(0, red), apart(1, green), apart(2, blue)];
                let before: Lanes = std::array::from_fn(|i| passing[i] + weights[i]);
                let alpha: Lanes = std::array::from_fn(|i| weights[i] / before[i].max(1e-12));
                let by_weight: Lanes = std::array::from_fn(|i| {
                    let by_colour = by_red[i] * to_red[i] + by_green[i] * to_green[i] + by_blue[i] * to_blue[i];
                    by_colour - by_passing[i] * rest[i]
                });
                // A clamped alpha does not change.
                let is_clamped = alpha.map(|alpha| alpha >= CLAMPED);
                let by_alpha: Lanes =
                    std::array::from_fn(|i| if is_clamped[i] { 0.0 } else { weights[i] * by_weight[i] });
                (0..LANES).for_each(|i| red[i] += alpha[i] * to_red[i]);
                (0..LANES).for_each(|i| green[i] += alpha[i] * to_green[i]);
                (0..LANES).for_each(|i| blue[i] += alpha[i] * to_blue[i]);
                (0..LANES).for_each(|i| rest[i] -= alpha[i] * rest[i]);
                *passing = before;
                // One loop for each sum: the compiler makes one instruction of it.
                let by_x: Lanes = std::array::from_fn(|i| by_alpha[i] * x[i]);
                let by_y = by_alpha.map(|by_alpha| by_alpha * y);
                let [sum, sum_x, sum_y, sum_xx, sum_xy, sum_yy, sum_red, sum_green, sum_blue] = &mut sums;
                (0..LANES).for_each(|i| sum[i] += by_alpha[i]);
                (0..LANES).for_each(|i| sum_x[i] += by_x[i]);
                (0..LANES).for_each(|i| sum_y[i] += by_y[i]);
                (0..LANES).for_each(|i| sum_xx[i] += by_x[i] * x[i]);
                (0..LANES).for_each(|i| sum_xy[i] += by_x[i] * y);
                (0..LANES).for_each(|i| sum_yy[i] += by_y[i] * y);
                (0..LANES).for_each(|i| sum_red[i] += by_red[i] * weights[i]);
                (0..LANES).for_each(|i| sum_green[i] += by_green[i] * weights[i]);
                (0..LANES).for_each(|i| sum_blue[i] += by_blue[i] * weights[i]);
                (0..LANES).for_each(|i| x[i] += LANES as f32);
            }
        }
        let sums = sums.map(|lanes| f64::from(lanes.iter().sum::<f32>()));
        let gradient = by_parameters(splats, (&nodes.nodes[index], index), &sums, colour);
        // Devices take 32-bit floats below 1e-38 for 0.
        let gradient = gradient.map(|value| if value.abs() < LEAST { 0.0 } else { value as f32 });
        gradients[index].iter_mut().zip(gradient).for_each(|(sum, value)| *sum += value);
    }
}

/// The gradient by the parameters of the node with this index, which has this colour.
fn by_parameters(splats: &Splats, (node, index): (&Node, usize), sums: &Sums<f64>, colour: [f32; 3]) -> [f64; 13] {
    let [sum, x, y, xx, xy, yy, by_colour @ ..] = *sums;
    let [a, b, c] = splats.splats[index].conic.map(f64::from);
    let (direction, px) = (splats.window.direction, splats.window.px);
    let scale = DVec3::from(node.scale.map(f64::from));
    let to_axes = DMat3::from_quat(node.turn()).transpose();
    let (along_x, along_y) = (to_axes * direction.right / px, to_axes * direction.down / px);
    // The covariance of the splat is uu, uv, vv, and the low-pass.
    let (u, v) = (along_x * scale, along_y * scale);
    let by_mean = u * (a * x + b * y) + v * (b * x + c * y);
    // By the covariance: C M C - sum C, a half of it, with the conic C and the second moments M.
    let [ax, ay, bx, by] = [a * xx + b * xy, a * xy + b * yy, b * xx + c * xy, b * xy + c * yy];
    let [uu, uv, vv] = [ax * a + ay * b - sum * a, ax * b + ay * c - sum * b, bx * b + by * c - sum * c];
    // The compensation for the low-pass is proportional to the area |u x v|.
    let area = u.cross(v);
    let by_area = area * (sum / area.length_squared().max(f64::MIN_POSITIVE));
    let by_u = u * uu + v * uv + v.cross(by_area);
    let by_v = u * uv + v * vv + by_area.cross(u);
    let by_scale = u * by_u + v * by_v;
    let by_turn = -(along_x.cross(scale * by_u) + along_y.cross(scale * by_v));
    let [red, green, blue] = [0, 1, 2].map(|k| if colour[k] > 0.0 { by_colour[k] * harmonics::C0 } else { 0.0 });
    let [[x, y, z], [i, j, k], [p, q, r]] = [by_mean, by_scale, by_turn].map(|by| by.to_array());
    [x, y, z, i, j, k, p, q, r, sum, red, green, blue]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lod::descent::change;
    use crate::lod::difference::Difference;
    use crate::lod::raster::{Window, directions};

    /// Nodes of several shapes that cover each other, one with an opacity above 1.
    fn nodes() -> Nodes {
        let mut nodes = Nodes::new(1);
        let turned = DVec3::new(0.3, -0.5, 0.2);
        for i in 0..5 {
            let at = i as f32;
            let mean = [0.4 * at - 0.8, 0.3 * (at * 2.0).sin(), 0.5 * (at - 2.0)];
            let rotation = [1.0, 0.2 * at, 0.3 - 0.1 * at, turned.z as f32];
            let opacity = if i == 3 { 1.8 } else { 0.3 + 0.12 * at };
            let node = Node::leaf(mean, rotation, [0.5, 0.2 + 0.1 * at, 0.35], opacity);
            let sh = [[0.9 - 0.3 * at, 0.2 * at, 0.4], [0.1; 3], [-0.1, 0.2, 0.0], [0.2, 0.0, 0.1]];
            nodes.push(node, &sh);
        }
        nodes
    }

    /// The gradient is the slope of the squared difference: a step in one number to both sides changes it so much.
    #[test]
    fn gradients_are_slopes_of_the_squared_difference() {
        let mut others = nodes();
        others.nodes.iter_mut().for_each(|node| node.mean = node.mean.map(|value| value + 0.05));
        others.sh.iter_mut().for_each(|sh| *sh = sh.map(|value| value + 0.1));
        let mut seen = Parameters::default();
        for direction in directions() {
            let (mut nodes, window) = (nodes(), Window::around(&nodes(), direction, 0.04));
            let (mut drawing, mut expected) = (Drawing::default(), Drawing::default());
            Splats::of(&others, window).draw(&others, &mut expected);
            let mut found = vec![Parameters::default(); nodes.len()];
            let splats = Splats::of(&nodes, window);
            Backward::default().add(&expected.picture, (&splats, &nodes), &mut drawing, &mut found);
            let largest: Parameters = std::array::from_fn(|k| found.iter().fold(0.0, |most, by| by[k].abs().max(most)));
            let most = largest.into_iter().fold(0.0, f32::max);
            seen.iter_mut().zip(largest).for_each(|(seen, value)| *seen = value.max(*seen));
            for (i, found) in found.iter().enumerate() {
                for (k, found) in found.iter().enumerate() {
                    const STEP: f32 = 0.01;
                    let before = (nodes.nodes[i], nodes.sh(i)[0]);
                    let [below, above] = [-STEP, STEP].map(|length| {
                        let mut step = Parameters::default();
                        step[k] = length;
                        let (mut node, mut sh) = before;
                        change(&mut node, &mut sh, &step);
                        (nodes.nodes[i], nodes.sh_mut(i)[0]) = (node, sh);
                        Splats::of(&nodes, window).draw(&nodes, &mut drawing);
                        Difference::of(window, &expected.picture, &drawing.picture).sums[0]
                    });
                    (nodes.nodes[i], nodes.sh_mut(i)[0]) = before;
                    let slope = ((above - below) / f64::from(2.0 * STEP)) as f32;
                    let off = (slope - found).abs();
                    assert!(off < 0.003 * most + 0.03 * largest[k], "node {i}, {k}: {found}, slope {slope}");
                }
            }
        }
        assert!(seen.iter().all(|value| *value > 0.5), "a number without a slope: {seen:?}");
    }
}
