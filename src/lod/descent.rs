//! Fits the shapes of parents to pictures of their children, by Adam's method (Kingma and Ba 2015).

use glam::{DQuat, DVec3, Vec3Swizzles};

use super::gradient::{Backward, Parameters};
use super::node::{Node, Nodes};
use super::raster::{Direction, Drawing, MARGIN, Splats, Window};

/// The width of a pixel of the pictures, as a part of the usual one: parents that are fitted in wider pixels look wrong
/// where nodes are drawn much larger than a pixel.
const PX: f64 = 0.5;
/// Directions of a round, in turn, also of the fit of opacities and colours. In fewer directions, a mostly hidden node
/// would be fitted to its few visible pixels.
pub const ROUND_DIRECTIONS: usize = 3;
/// The length of a step in the first round, and the part of it in the last one. Steps are in standard deviations,
/// logarithms, radians and coefficients.
const STEP: f32 = 0.02;
const LAST: f32 = 0.2;
/// The parts that the means of gradients and of their squares keep in a round.
const KEPT: [f32; 2] = [0.7, 0.95];
/// The largest factor between the scales and opacities of a merged and of a fitted node.
pub const MOST_CHANGE: f32 = 4.0;

/// Smaller gradients, by their root mean square, px^2, move parents less.
pub const LEAST_GRADIENT: f32 = 1e-9;

/// The 24 corners of a snub cube: even directions, none opposite another. With the six of the errors, parents fit only
/// those. The directions of one round are far apart.
fn directions() -> impl Iterator<Item = Direction> {
    /// The tribonacci constant.
    const LONG: f64 = 1.839_286_755_214_161;
    const SIGNS: [DVec3; 4] = [
        DVec3::new(-1.0, -1.0, -1.0),
        DVec3::new(-1.0, 1.0, 1.0),
        DVec3::new(1.0, -1.0, 1.0),
        DVec3::new(1.0, 1.0, -1.0),
    ];
    let corner = DVec3::new(1.0, 1.0 / LONG, LONG);
    let halves = [(1.0, [corner, corner.zxy(), corner.yzx()]), (-1.0, [corner.xzy(), corner.yxz(), corner.zyx()])];
    halves.into_iter().flat_map(move |(sign, corners)| {
        (0..SIGNS.len()).flat_map(move |i| {
            (0..ROUND_DIRECTIONS).map(move |k| Direction::to(sign * corners[k] * SIGNS[(i + k) % SIGNS.len()]))
        })
    })
}

/// Parents whose shapes are fitted to pictures of their children.
pub struct Descent<'d> {
    pub children: &'d Nodes,
    /// The pictures: [`ROUND_DIRECTIONS`] for each round, in turn. None without rounds.
    pub windows: Vec<Window>,
    /// For each parent, whether it is fitted.
    pub is_fitted: &'d [bool],
    /// The corners of a box that keeps all means.
    pub bounds: ([f32; 3], [f32; 3]),
    pub rounds: u32,
}

/// What differs from round to round.
#[derive(Clone, Copy, Debug)]
pub struct Round {
    /// The length of a step.
    pub length: f32,
    /// The parts of the means that the rounds up to this one have filled, since the means begin with 0.
    pub filled: [f32; 2],
}

/// The parts of a mean that a round replaces: of gradients, and of their squares.
pub const REPLACED: [f32; 2] = [1.0 - KEPT[0], 1.0 - KEPT[1]];

/// The windows of some rounds around the children. `px`: the usual width of a pixel, world units.
pub fn shape_windows(children: &Nodes, px: f64, rounds: u32) -> Vec<Window> {
    let directions = directions().take(ROUND_DIRECTIONS * rounds as usize);
    directions.map(|direction| Window::within(children, direction, PX * px, MARGIN * px)).collect()
}

impl Descent<'_> {
    pub fn each_round(&self) -> impl Iterator<Item = Round> {
        let (last, mut missing) = (self.rounds.saturating_sub(1).max(1) as f32, [1.0, 1.0]);
        (0..self.rounds).map(move |round| {
            missing = [0, 1].map(|power| missing[power] * KEPT[power]);
            Round {
                length: STEP * (1.0 - (1.0 - LAST) * round as f32 / last),
                filled: missing.map(|missing| 1.0 - missing),
            }
        })
    }

    /// Moves the parents towards the pictures of their children.
    pub fn on_host(&self, parents: &mut Nodes) {
        let mut drawing = Drawing::default();
        let views = Vec::from_iter(self.windows.iter().map(|window| {
            Splats::of(self.children, *window).draw(self.children, &mut drawing);
            (window, drawing.picture.clone())
        }));
        let (merged, (low, high)) = (parents.nodes.clone(), self.bounds);
        let (mut backward, mut gradients) = (Backward::default(), vec![Parameters::default(); parents.len()]);
        let mut means = vec![[Parameters::default(); 2]; parents.len()];
        for (Round { length, filled }, views) in self.each_round().zip(views.chunks(ROUND_DIRECTIONS).cycle()) {
            gradients.fill(Parameters::default());
            for (window, picture) in views {
                let splats = Splats::of(parents, **window);
                backward.add(picture, (&splats, parents), &mut drawing, &mut gradients);
            }
            for i in (0..parents.len()).filter(|i| self.is_fitted[*i]) {
                let step = std::array::from_fn(|k| {
                    let gradient = gradients[i][k];
                    let [mean, square] = [0, 1].map(|power| {
                        let mean = &mut means[i][power][k];
                        *mean += REPLACED[power] * (if power == 0 { gradient } else { gradient * gradient } - *mean);
                        *mean / filled[power]
                    });
                    -length * mean / square.sqrt().max(LEAST_GRADIENT)
                });
                let mut first = parents.sh(i)[0];
                let node = &mut parents.nodes[i];
                change(node, &mut first, &step);
                node.mean = [0, 1, 2].map(|k| node.mean[k].clamp(low[k], high[k]));
                let limited = |value: f32, merged: f32| value.clamp(merged / MOST_CHANGE, merged * MOST_CHANGE);
                node.scale = [0, 1, 2].map(|k| limited(node.scale[k], merged[i].scale[k]));
                node.opacity = limited(node.opacity, merged[i].opacity);
                node.size = node.scale.into_iter().fold(node.size, f32::max);
                parents.sh_mut(i)[0] = first;
            }
        }
    }
}

/// Moves the parameters of a node, of which `sh` has the colour, by a small step.
pub fn change(node: &mut Node, sh: &mut [f32; 3], step: &Parameters) {
    // e^x up to x^2: functions of the system differ from machine to machine.
    let factor = |x: f32| 1.0 + x + 0.5 * x * x;
    let [x, y, z, i, j, k, p, q, r, opacity, colour @ ..] = *step;
    let half_turn = 0.5 * DVec3::new(p.into(), q.into(), r.into());
    let turn = (node.turn() * DQuat::from_xyzw(half_turn.x, half_turn.y, half_turn.z, 1.0)).normalize();
    node.mean = (node.centre() + node.axes() * DVec3::new(x.into(), y.into(), z.into())).as_vec3().to_array();
    node.rotation = [turn.w, turn.x, turn.y, turn.z].map(|v| v as f32);
    node.scale.iter_mut().zip([i, j, k]).for_each(|(scale, step)| *scale *= factor(step));
    node.opacity *= factor(opacity);
    sh.iter_mut().zip(colour).for_each(|(value, step)| *value += step);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lod::difference::from_other_directions;
    use crate::lod::{FitOptions, simplify};
    use crate::procedural::cactus;
    use crate::scene::along_curve;

    #[test]
    fn directions_are_even_and_none_is_opposite_another() {
        let all = Vec::from_iter(directions().map(|direction| direction.right.cross(direction.down).normalize()));
        assert_eq!(all.len(), 24);
        for (i, a) in all.iter().enumerate() {
            let others = || all.iter().enumerate().filter(|(j, _)| *j != i).map(|(_, b)| a.dot(*b));
            let [nearest, farthest] = [others().fold(-1.0, f64::max), others().fold(1.0, f64::min)];
            assert!((0.68..0.75).contains(&nearest), "43 degrees: {nearest}");
            assert!(farthest > -0.99, "{farthest}");
        }
    }

    /// From directions in which no picture was fitted, nodes with fitted shapes are nearer to their children.
    #[test]
    fn fitted_shapes_are_better_from_other_directions() {
        let scene = cactus::cactus(60_000).unwrap().gaussians;
        let children = Nodes::of(&scene, along_curve(scene.means())[..2048].iter().map(|index| *index as usize));
        let [merged, fitted] =
            [0, 12].map(|shape_rounds| simplify(&children, 512, 0.0, FitOptions { shape_rounds, fitter: None }));
        let px = f64::from(merged.reference_width);
        let [before, after] = [&merged, &fitted].map(|found| from_other_directions(&children, &found.nodes, px));
        let part = after / before;
        assert!(part < 0.75, "{part} of the squared error");
        let (low, high) = children.bounds();
        let is_within = |node: &Node| (0..3).all(|k| (low[k]..=high[k]).contains(&node.mean[k]));
        assert!(fitted.nodes.nodes.iter().all(is_within));
        let is_covered = |node: &Node| node.size == 0.0 || node.scale.iter().all(|scale| *scale <= node.size);
        assert!(fitted.nodes.nodes.iter().all(is_covered), "the size is not that of the merged node");
        let again = simplify(&children, 512, 0.0, FitOptions { shape_rounds: 12, fitter: None });
        assert_eq!(again.nodes, fitted.nodes, "the same in every run");
    }
}
