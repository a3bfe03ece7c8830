//! Fits parents to the pictures of their children, and measures what is left of the difference.

use super::difference::Difference;
use super::node::Nodes;
use super::raster::{Drawing, LANES, Pixel, Splats, Window, directions};
use crate::scene::harmonics;

/// Rounds of the fit. Each moves opacities and colours towards the pictures of the children in some directions, in
/// turn: in fewer directions, what is hidden there would be moved by the little that is seen of it.
const ROUNDS: usize = 4;
const TOGETHER: usize = 3;
/// Pixels with lower alphas say little about colours.
const LEAST_ALPHA: f32 = 0.05;
/// Most pixels of the diagonal of a picture.
const MOST_PX: f64 = 256.0;

/// What is left of the difference between parents and children.
pub struct Left {
    /// For each new parent, the squared difference of colours, summed over the channels and over the area, world units
    /// squared; the mean over the directions and over black and white grounds.
    pub energies: Vec<f64>,
    /// The length down to which the difference shows whole: pixels of this width and smaller ones. In larger pixels it
    /// falls with the square of their width.
    pub detail: f64,
}

/// A family seen in one direction.
struct View {
    width: usize,
    children: Vec<Pixel>,
    parents: Splats,
}

/// The width of pixels in which parents are fitted: that of the median parent.
fn pixel(parents: &Nodes, children: &Nodes) -> f64 {
    let (low, high) = children.bounds();
    let diagonal = (0..3).map(|i| f64::from(high[i] - low[i]).powi(2)).sum::<f64>().sqrt();
    parents.width().max(diagonal / MOST_PX).max(1e-18)
}

/// Fits the parents that are new, and measures them. The others are children themselves.
pub fn fit(children: &Nodes, parents: &mut Nodes, is_new: &[bool]) -> Left {
    let px = pixel(parents, children);
    let (mut drawing, mut asked) = (Drawing::default(), Vec::new());
    let views = directions().map(|direction| {
        let window = Window::around(children, direction, px);
        Splats::of(children, window).draw(children, &mut drawing);
        View { width: window.width, children: drawing.pixels.clone(), parents: Splats::of(parents, window) }
    });
    for some in views.chunks(TOGETHER).cycle().take(ROUNDS) {
        let mut changes = vec![Change::default(); parents.len()];
        some.iter().for_each(|view| view.compare(parents, (&mut drawing, &mut asked), &mut changes));
        for (i, change) in changes.iter().enumerate().filter(|(i, _)| is_new[*i]) {
            change.apply(parents, i);
        }
    }
    measure(&views, (parents, is_new), px, &mut drawing)
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

/// What a pixel asks for: the alphas of the children and of the parents, and the missing colour. Filled up to a power
/// of two, so that few instructions add one up.
type Asked = [f32; 8];

impl View {
    /// Adds what this view asks for.
    fn compare(&self, parents: &Nodes, (drawing, asked): (&mut Drawing, &mut Vec<Asked>), changes: &mut [Change]) {
        self.parents.draw(parents, drawing);
        asked.clear();
        asked.extend(self.children.iter().zip(&drawing.pixels).map(|(child, own)| {
            let (wanted, drawn) = (1.0 - child[3], 1.0 - own[3]);
            // Of the same alpha: what alpha lacks is not made up by a brighter colour.
            let missing = |k: usize| if wanted > LEAST_ALPHA { child[k] * (drawn / wanted) - own[k] } else { 0.0 };
            [wanted, drawn, missing(0), missing(1), missing(2), 0.0, 0.0, 0.0]
        }));
        for (splat, first, weights) in drawing.rows() {
            let mut sums = Asked::default();
            for (asked, weights) in asked[first..].as_chunks::<LANES>().0.iter().zip(weights) {
                for (asked, weight) in asked.iter().zip(weights) {
                    sums.iter_mut().zip(asked).for_each(|(sum, asked)| *sum += asked * weight);
                }
            }
            let change = &mut changes[splat];
            let [wanted, drawn, missing @ ..] = sums.map(f64::from);
            change.wanted += wanted;
            change.drawn += drawn;
            change.missing.iter_mut().zip(missing).for_each(|(sum, missing)| *sum += missing);
        }
    }
}

fn measure(views: &[View], (parents, is_new): (&Nodes, &[bool]), px: f64, drawing: &mut Drawing) -> Left {
    let mut energies = vec![0.0; parents.len()];
    let mut sums = [0.0; 3];
    let each = px * px / views.len() as f64;
    let news = is_new.iter().filter(|is_new| **is_new).count().max(1);
    for view in views {
        view.parents.draw(parents, drawing);
        let difference = Difference::of(view.width, &view.children, &drawing.pixels);
        sums.iter_mut().zip(difference.sums).for_each(|(sum, own)| *sum += own);
        // Each new parent gets the part of a pixel that it has of the sum of their weights there.
        let mut covered = vec![0.0_f32; drawing.pixels.len()];
        for (_, first, weights) in drawing.rows().filter(|(splat, ..)| is_new[*splat]) {
            let covered = covered[first..].iter_mut().zip(weights.as_flattened());
            covered.for_each(|(sum, weight)| *sum += weight);
        }
        let squares = difference.squared.iter().zip(&covered);
        let share: Vec<f32> = squares.map(|(squared, covered)| squared / covered.max(1e-3)).collect();
        let mut given = 0.0;
        for (splat, first, weights) in drawing.rows().filter(|(splat, ..)| is_new[*splat]) {
            let shares = share[first..].iter().zip(weights.as_flattened());
            let part: f32 = shares.map(|(share, weight)| share * weight).sum();
            energies[splat] += f64::from(part) * each;
            given += f64::from(part);
        }
        // What none of them covers is everybody's.
        let rest = (difference.sums[0] - given).max(0.0) * each / news as f64;
        energies.iter_mut().zip(is_new).filter(|(_, is_new)| **is_new).for_each(|(energy, _)| *energy += rest);
    }
    // Where pixels of 4 px show the part e of the difference, it falls with the square beyond 4 px sqrt(e).
    let part = if sums[0] > 0.0 { (sums[2] / sums[0]).sqrt() } else { 1.0 };
    Left { energies, detail: px * (4.0 * part).clamp(0.5, 4.0) }
}
