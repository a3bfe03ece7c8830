//! Fits parents to pictures of their children, and measures the remaining difference.

use multiversion::multiversion;

use super::descent::{Descent, ShapeFit, windows};
use super::difference::Difference;
use super::node::{Node, Nodes};
use super::raster::{Drawing, LANES, Picture, Splats, Window, directions};
use crate::scene::harmonics;

/// Rounds of the fit. Each moves opacities and colours towards the pictures of the children.
const ROUNDS: usize = 4;
/// Directions of a round, in turn. In fewer directions, a mostly hidden node would be fitted to its few visible pixels.
const ROUND_DIRECTIONS: usize = 3;
/// Colours of pixels with lower alphas are ignored.
const LEAST_ALPHA: f32 = 0.05;
/// Most pixels along the diagonal of a picture.
const MOST_PX: f64 = 256.0;
/// Parents narrower than this part of a pixel, by their mean area, keep what they were merged to. Pictures hardly show
/// them: in groups that also hold distant wide Gaussians, the fit would make them hard discs with gaps.
const LEAST_PX: f64 = 0.05;

/// The remaining difference between parents and children.
pub struct Residual {
    /// The squared difference of colours of each new parent, summed over the channels and over the area, world units
    /// squared: the mean over the directions and over black and white backgrounds.
    pub squared_errors: Vec<f64>,
    /// The reference pixel width, world units: in wider pixels, the difference falls with the square of the width.
    pub reference_width: f64,
}

/// Pictures of a group in one direction.
struct View {
    window: Window,
    children: Picture,
    parents: Splats,
}

/// The pixel width of pictures: the width of the median parent, world units, with at most `most_px` along the diagonal.
pub fn pixel_width(parents: &Nodes, children: &Nodes, most_px: f64) -> f64 {
    let (low, high) = children.bounds();
    let diagonal = (0..3).map(|i| f64::from(high[i] - low[i]).powi(2)).sum::<f64>().sqrt();
    parents.width().max(diagonal / most_px).max(1e-18)
}

/// The reference pixel width by the sums of [`Difference`], world units.
pub fn reference_width(sums: [f64; 3], px: f64) -> f64 {
    // If pixels of 4 px keep the fraction e of the difference, it falls with the square beyond 4 px sqrt(e).
    let kept = if sums[0] > 0.0 { (sums[2] / sums[0]).sqrt() } else { 1.0 };
    px * (4.0 * kept).clamp(0.5, 4.0)
}

/// Fits the new parents that pictures show, and measures all new ones. The others are copies of their child.
pub fn fit(children: &Nodes, parents: &mut Nodes, is_new: &[bool], shape_fit: ShapeFit) -> Residual {
    let px = pixel_width(parents, children, MOST_PX);
    let widths = Vec::from_iter(parents.nodes.iter().map(Node::width));
    let (mut drawing, mut residuals) = (Drawing::default(), Vec::new());
    let mut views = directions().map(|direction| {
        let window = Window::around(children, direction, px);
        Splats::of(children, window).draw(children, &mut drawing);
        View { window, children: drawing.picture.clone(), parents: Splats::of(parents, window) }
    });
    let is_fitted = Vec::from_iter((0..parents.len()).map(|i| is_new[i] && widths[i] >= LEAST_PX * px));
    for some in views.chunks(ROUND_DIRECTIONS).cycle().take(ROUNDS) {
        let mut corrections = vec![Correction::default(); parents.len()];
        some.iter().for_each(|view| view.compare(parents, (&mut drawing, &mut residuals), &mut corrections));
        for (i, correction) in corrections.iter().enumerate().filter(|(i, _)| is_fitted[*i]) {
            correction.apply(parents, i);
        }
    }
    let ShapeFit { rounds, fitter } = shape_fit;
    if rounds > 0 {
        let windows = windows(children, px, rounds);
        let (windows, is_fitted, bounds) = (&windows[..], &is_fitted[..], children.bounds());
        let descent = Descent { children, windows, is_fitted, bounds, rounds };
        if !fitter.is_some_and(|fitter| fitter.fit(&descent, parents)) {
            descent.on_host(parents);
        }
        views.iter_mut().for_each(|view| view.parents = Splats::of(parents, view.window));
    }
    measure(&views, (parents, is_new), px, &mut drawing)
}

/// The correction of one parent in one round.
#[derive(Clone, Copy, Default)]
struct Correction {
    /// Sums over pixels, weighted with the parent's contribution: alphas of the children and of the parents, and the
    /// missing colour.
    target: f64,
    drawn: f64,
    missing: [f64; 3],
}

impl Correction {
    fn apply(&self, parents: &mut Nodes, index: usize) {
        if self.drawn <= 0.0 {
            return;
        }
        parents.nodes[index].opacity *= (self.target / self.drawn).clamp(0.5, 2.0) as f32;
        let first = &mut parents.sh_mut(index)[0];
        for (value, missing) in first.iter_mut().zip(self.missing) {
            *value += (missing / self.drawn) as f32 / harmonics::C0 as f32;
        }
    }
}

/// The alphas of the children and of the parents at a pixel, and the missing colour. Padded to a power of two, so that
/// few instructions add one up.
type PixelResidual = [f32; 8];

impl View {
    /// Adds the corrections of this view.
    fn compare(
        &self,
        parents: &Nodes,
        (drawing, residuals): (&mut Drawing, &mut Vec<PixelResidual>),
        corrections: &mut [Correction],
    ) {
        self.parents.draw(parents, drawing);
        residuals.clear();
        residuals.extend(self.children.pixels().zip(drawing.picture.pixels()).map(|(child, own)| {
            let (target, drawn) = (1.0 - child[3], 1.0 - own[3]);
            // At equal alpha: a brighter colour must not make up for a lower alpha.
            let missing = |k: usize| if target > LEAST_ALPHA { child[k] * (drawn / target) - own[k] } else { 0.0 };
            [target, drawn, missing(0), missing(1), missing(2), 0.0, 0.0, 0.0]
        }));
        add_corrections(drawing, residuals, corrections);
    }
}

/// Adds the residuals of pixels to the corrections of the splats that cover them. All versions make the same bits, as
/// those of [`Splats::draw`] do.
#[multiversion(targets("x86_64+avx2"))]
fn add_corrections(drawing: &Drawing, residuals: &[PixelResidual], corrections: &mut [Correction]) {
    for (splat, first, weights) in drawing.rows() {
        let mut sums = PixelResidual::default();
        for (residuals, weights) in residuals[first..].as_chunks::<LANES>().0.iter().zip(weights) {
            for (residual, weight) in residuals.iter().zip(weights) {
                sums.iter_mut().zip(residual).for_each(|(sum, value)| *sum += value * weight);
            }
        }
        let correction = &mut corrections[splat];
        let [target, drawn, missing @ ..] = sums.map(f64::from);
        correction.target += target;
        correction.drawn += drawn;
        correction.missing.iter_mut().zip(missing).for_each(|(sum, missing)| *sum += missing);
    }
}

fn measure(views: &[View], (parents, is_new): (&Nodes, &[bool]), px: f64, drawing: &mut Drawing) -> Residual {
    let mut squared_errors = vec![0.0; parents.len()];
    let mut sums = [0.0; 3];
    let each = px * px / views.len() as f64;
    let new_count = is_new.iter().filter(|is_new| **is_new).count().max(1);
    for view in views {
        view.parents.draw(parents, drawing);
        let difference = Difference::of(view.window.width, &view.children, &drawing.picture);
        sums.iter_mut().zip(difference.sums).for_each(|(sum, own)| *sum += own);
        // The squared difference of a pixel is divided among the new parents by their weights there.
        let mut covered = vec![0.0_f32; difference.squared.len()];
        for (_, first, weights) in drawing.rows().filter(|(splat, ..)| is_new[*splat]) {
            let covered = covered[first..].iter_mut().zip(weights.as_flattened());
            covered.for_each(|(sum, weight)| *sum += weight);
        }
        let squares = difference.squared.iter().zip(&covered);
        let share: Vec<f32> = squares.map(|(squared, covered)| squared / covered.max(1e-3)).collect();
        let mut attributed = 0.0;
        for (splat, first, weights) in drawing.rows().filter(|(splat, ..)| is_new[*splat]) {
            let shares = share[first..].iter().zip(weights.as_flattened());
            let part: f32 = shares.map(|(share, weight)| share * weight).sum();
            squared_errors[splat] += f64::from(part) * each;
            attributed += f64::from(part);
        }
        // The rest, which no new parent covers, is divided equally.
        let rest = (difference.sums[0] - attributed).max(0.0) * each / new_count as f64;
        squared_errors
            .iter_mut()
            .zip(is_new)
            .filter(|(_, is_new)| **is_new)
            .for_each(|(squared_error, _)| *squared_error += rest);
    }
    Residual { squared_errors, reference_width: reference_width(sums, px) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lod::merge::parent;

    /// Four Gaussians at one place that are merged to one, before and after the fit. A fifth, at this distance, stays.
    fn merged_and_fitted(distance: f32) -> [Node; 2] {
        let (mut children, sh) = (Nodes::new(0), [[0.5; 3]]);
        for x in [0.0, 0.0, 0.0, 0.0, distance] {
            children.push(Node::leaf([x, 0.0, 0.0], [1.0, 0.0, 0.0, 0.0], [0.01; 3], 1.0), &sh);
        }
        let (merged, sh_of_merged) = parent(&children, &[0, 1, 2, 3]);
        let mut parents = Nodes::new(0);
        parents.push(merged, &sh_of_merged);
        parents.push(children.nodes[4], &sh);
        fit(&children, &mut parents, &[true, false], ShapeFit { rounds: 3, fitter: None });
        assert_eq!(parents.nodes[1], children.nodes[4], "a copy is not fitted");
        [merged, parents.nodes[0]]
    }

    /// Where pixels are 25 times as wide, the four are below the threshold of alphas, and the merged one is not.
    #[test]
    fn parents_that_pictures_hardly_show_stay_as_merged() {
        let [merged, fitted] = merged_and_fitted(0.1);
        assert!(merged.opacity != fitted.opacity && merged.scale != fitted.scale, "{merged:?}");
        let [merged, fitted] = merged_and_fitted(110.0);
        assert_eq!(merged, fitted);
    }
}
