//! Fits parents to the pictures of their children, and measures what is left of the difference.

use super::median::median;
use super::node::Nodes;
use super::raster::{Picture, Splats, Window, directions};
use crate::scene::harmonics;

/// Rounds of the fit. Each moves opacities and colours towards the pictures of the children.
const ROUNDS: usize = 3;
/// Pixels with lower alphas say little about colours.
const LEAST_ALPHA: f32 = 0.05;
/// Most pixels of the diagonal of a picture.
const MOST_PX: f64 = 256.0;

/// What is left of the difference between parents and children.
pub struct Left {
    /// For each parent, the squared difference of colours, summed over the channels and over the area, world units
    /// squared; the mean over the directions and over black and white grounds.
    pub energies: Vec<f64>,
    /// The length down to which the difference shows whole: pixels of this width and smaller ones. In larger pixels it
    /// falls with the square of their width.
    pub detail: f64,
}

/// A family seen in one direction.
struct View {
    window: Window,
    children: Picture,
}

/// The width of pixels in which parents are fitted: that of the median parent.
fn pixel(parents: &Nodes, children: &Nodes) -> f64 {
    let median = median(parents.nodes.iter().map(|node| node.area().sqrt()).collect());
    let (low, high) = children.bounds();
    let diagonal = (0..3).map(|i| f64::from(high[i] - low[i]).powi(2)).sum::<f64>().sqrt();
    median.max(diagonal / MOST_PX).max(1e-18)
}

/// Fits the parents for which `is_free`, and measures all.
pub fn fit(children: &Nodes, parents: &mut Nodes, is_free: &[bool]) -> Left {
    let px = pixel(parents, children);
    let views: Vec<View> = directions()
        .into_iter()
        .map(|direction| {
            let window = Window::around(children, direction, px);
            View { window, children: Splats::of(children, window).draw() }
        })
        .collect();
    for _ in 0..ROUNDS {
        let mut changes = vec![Change::default(); parents.len()];
        views.iter().for_each(|view| view.compare(parents, &mut changes));
        for (i, change) in changes.iter().enumerate().filter(|(i, _)| is_free[*i]) {
            change.apply(parents, i);
        }
    }
    measure(&views, parents, px)
}

/// What the pictures ask one parent to change.
#[derive(Clone, Copy, Default)]
struct Change {
    /// Sums over pixels, weighted with the parent's part in them: of the alphas of the children and of the parents, and
    /// of the missing colour.
    wanted: f64,
    drawn: f64,
    missing: [f64; 3],
}

impl Change {
    fn apply(&self, parents: &mut Nodes, index: usize) {
        if self.drawn <= 0.0 {
            return;
        }
        parents.nodes[index].opacity *= (self.wanted / self.drawn).clamp(0.5, 2.0) as f32;
        let first = &mut parents.sh_mut(index)[0];
        for (value, missing) in first.iter_mut().zip(self.missing) {
            *value += (missing / self.drawn) as f32 / harmonics::C0 as f32;
        }
    }
}

impl View {
    /// Adds what this view asks for.
    fn compare(&self, parents: &Nodes, changes: &mut [Change]) {
        let splats = Splats::of(parents, self.window);
        let picture = splats.draw();
        let alpha = |picture: &Picture| -> Vec<f32> { picture.transmittance.iter().map(|t| 1.0 - t).collect() };
        let (wanted, drawn) = (alpha(&self.children), alpha(&picture));
        let missing = [0, 1, 2].map(|channel| -> Vec<f32> {
            let colours = self.children.colour[channel].iter().zip(&picture.colour[channel]);
            let missing = |((colour, own), (wanted, drawn)): ((&f32, &f32), (&f32, &f32))| {
                // Of the same alpha: what alpha lacks is not made up by a brighter colour.
                if *wanted > LEAST_ALPHA { colour * (drawn / wanted) - own } else { 0.0 }
            };
            colours.zip(wanted.iter().zip(&drawn)).map(missing).collect()
        });
        let dot = |values: &[f32], weights: &[f32]| -> f32 { values.iter().zip(weights).map(|(v, w)| v * w).sum() };
        splats.walk(|splat, first, weights| {
            let change = &mut changes[splat];
            let part = first..first + weights.len();
            change.wanted += f64::from(dot(&wanted[part.clone()], weights));
            change.drawn += f64::from(dot(&drawn[part.clone()], weights));
            for (sum, missing) in change.missing.iter_mut().zip(&missing) {
                *sum += f64::from(dot(&missing[part.clone()], weights));
            }
        });
    }
}

/// The squared difference of two pictures in each pixel, and the same where 2 x 2 and 4 x 4 pixels are one, summed.
struct Difference {
    squared: Vec<f32>,
    sums: [f64; 3],
}

impl Difference {
    fn of(wanted: &Picture, drawn: &Picture) -> Self {
        let width = wanted.width;
        let height = wanted.transmittance.len() / width;
        let apart = |a: &[f32], b: &[f32]| -> Vec<f32> { a.iter().zip(b).map(|(a, b)| a - b).collect() };
        // Of the colours, and of the alphas.
        let mut planes = [0, 1, 2].map(|i| apart(&wanted.colour[i], &drawn.colour[i])).to_vec();
        planes.push(apart(&drawn.transmittance, &wanted.transmittance));
        let energy = |pixel: [f32; 4]| -> f32 {
            let [r, g, b, a] = pixel;
            // The mean of |dP|^2 on black and |dP - dA|^2 on white.
            let squares = |ground: f32| [r, g, b].map(|v| (v - ground * a).powi(2)).iter().sum::<f32>();
            (squares(0.0) + squares(1.0)) / 2.0
        };
        let squared: Vec<f32> = (0..width * height).map(|i| energy([0, 1, 2, 3].map(|k| planes[k][i]))).collect();
        let coarse = |factor: usize| -> f64 {
            let mut sum = 0.0;
            for y in (0..height).step_by(factor) {
                for x in (0..width).step_by(factor) {
                    let mean = [0, 1, 2, 3].map(|k| {
                        let rows = y..height.min(y + factor);
                        let of_row = |row: usize| {
                            planes[k][row * width + x..row * width + width.min(x + factor)].iter().sum::<f32>()
                        };
                        rows.map(of_row).sum::<f32>() / (factor * factor) as f32
                    });
                    sum += f64::from(energy(mean)) * (factor * factor) as f64;
                }
            }
            sum
        };
        let sums = [squared.iter().map(|v| f64::from(*v)).sum(), coarse(2), coarse(4)];
        Self { squared, sums }
    }
}

fn measure(views: &[View], parents: &Nodes, px: f64) -> Left {
    let mut energies = vec![0.0; parents.len()];
    let mut sums = [0.0; 3];
    let each = px * px / views.len() as f64;
    for view in views {
        let splats = Splats::of(parents, view.window);
        let picture = splats.draw();
        let difference = Difference::of(&view.children, &picture);
        sums.iter_mut().zip(difference.sums).for_each(|(sum, own)| *sum += own);
        // Each parent gets the part of a pixel that it has of the sum of all weights there, which is alpha.
        let squares = difference.squared.iter().zip(&picture.transmittance);
        let share: Vec<f32> = squares.map(|(squared, t)| squared / (1.0 - t).max(1e-3)).collect();
        let mut given = 0.0;
        splats.walk(|splat, first, weights| {
            let part: f32 = share[first..].iter().zip(weights).map(|(share, weight)| share * weight).sum();
            energies[splat] += f64::from(part) * each;
            given += f64::from(part);
        });
        // What no parent covers is everybody's.
        let rest = (difference.sums[0] - given).max(0.0) * each / parents.len() as f64;
        energies.iter_mut().for_each(|energy| *energy += rest);
    }
    // Where pixels of 4 px show the part e of the difference, it falls with the square beyond 4 px sqrt(e).
    let part = if sums[0] > 0.0 { (sums[2] / sums[0]).sqrt() } else { 1.0 };
    Left { energies, detail: px * (4.0 * part).clamp(0.5, 4.0) }
}
