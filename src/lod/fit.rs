//! Fits parents to pictures of their children, and measures the remaining difference.

use multiversion::multiversion;

use super::descent::{Descent, ROUND_DIRECTIONS, shape_windows};
use super::difference::{Difference, LEAST, Sums, total};
use super::node::{Node, Nodes};
use super::raster::{Drawing, LANES, Picture, Splats, Window, directions};
use crate::scene::harmonics;

/// Rounds that move opacities and colours towards the pictures of the children.
pub const COLOUR_ROUNDS: usize = 4;
/// Directions in which opacities and colours are fitted and errors are measured.
pub const VIEWS: usize = 6;
/// Values of a pixel by which opacities and colours are fitted.
pub const RESIDUALS: usize = 5;
/// Colours of pixels with lower alphas are ignored.
pub const LEAST_ALPHA: f32 = 0.05;
/// The largest factor of an opacity in a round.
pub const MOST_FACTOR: f64 = 2.0;
/// The least sum of weights that divides the squared difference of a pixel.
pub const LEAST_COVERED: f32 = 1e-3;
/// Most pixels along the diagonal of a picture.
const MOST_PX: f64 = 256.0;
/// Parents narrower than this part of a pixel, by their mean area, keep what they were merged to. Pictures hardly show
/// them: in groups that also hold distant wide Gaussians, the fit would make them hard discs with gaps.
const LEAST_PX: f64 = 0.05;

/// The remaining difference between parents and children.
pub struct Residual {
    /// The squared difference of colours of each new parent, summed over the channels and over the area, world units
    /// squared: the mean over the directions and over black and white backgrounds. Without meaning for the others.
    pub squared_errors: Vec<f64>,
    /// The reference pixel width, world units: in wider pixels, the difference falls with the square of the width.
    pub reference_width: f64,
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
pub fn fit(children: &Nodes, parents: &mut Nodes, is_new: &[bool], options: FitOptions) -> Residual {
    let px = pixel_width(parents, children, MOST_PX);
    let is_fitted = |(node, is_new): (&Node, &bool)| *is_new && node.width() >= LEAST_PX * px;
    let is_fitted = Vec::from_iter(parents.nodes.iter().zip(is_new).map(is_fitted));
    let windows = directions().map(|direction| Window::around(children, direction, px));
    let (descent, bounds) = (shape_windows(children, px, options.shape_rounds), children.bounds());
    let descent = Descent { children, windows: descent, is_fitted: &is_fitted, bounds, rounds: options.shape_rounds };
    let group = Group { windows, is_new, descent };
    let on_device = options.fitter.and_then(|fitter| fitter.fit(&group, parents));
    on_device.unwrap_or_else(|| group.on_host(parents)).residual(px, is_new)
}

/// Children, and parents to be fitted to their pictures.
pub struct Group<'g> {
    /// The pictures in which opacities and colours are fitted and errors are measured.
    pub windows: [Window; VIEWS],
    /// For each parent, whether it stands for several children.
    pub is_new: &'g [bool],
    /// The children, and the fit of shapes.
    pub descent: Descent<'g>,
}

/// Another machine that fits parents, with the same bits as `Group::on_host`.
pub trait Fitter: Sync {
    /// Fits the parents, and measures them. Returns none, and leaves the parents, if it cannot.
    fn fit(&self, group: &Group, parents: &mut Nodes) -> Option<Measured>;
}

/// How parents are fitted.
#[derive(Clone, Copy, Default)]
pub struct FitOptions<'f> {
    /// Rounds of the fit of shapes.
    pub shape_rounds: u32,
    /// The host, if there is none.
    pub fitter: Option<&'f dyn Fitter>,
}

/// Squared differences in all windows of a group, px^2.
pub struct Measured {
    sums: Sums,
    /// What new parents have of it by their weights; 0 of the others.
    parts: Vec<f64>,
}

impl Measured {
    /// Adds up the sums of the windows, and the parts of the parents, window by window.
    pub fn of(windows: impl Iterator<Item = Sums>, parts: &[f32], is_new: &[bool]) -> Self {
        let mut all = vec![0.0; is_new.len()];
        for parts in parts.chunks(is_new.len()) {
            let new = all.iter_mut().zip(parts).zip(is_new).filter(|(_, is_new)| **is_new);
            new.for_each(|((all, part), _)| *all += f64::from(*part));
        }
        Self { sums: total(windows), parts: all }
    }

    fn residual(self, px: f64, is_new: &[bool]) -> Residual {
        let Self { sums, parts } = self;
        // What no new parent covers is divided equally.
        let new_count = is_new.iter().filter(|is_new| **is_new).count().max(1);
        let rest = (sums[0] - parts.iter().sum::<f64>()).max(0.0) / new_count as f64;
        let squared_errors = parts.iter().map(|part| (part + rest) * px * px / VIEWS as f64);
        Residual { squared_errors: squared_errors.collect(), reference_width: reference_width(sums, px) }
    }
}

/// Sums over the pixels of a parent in the pictures of a round, with its weights: the alphas of the children and of the
/// parents, and the missing colour.
type Correction = [f64; RESIDUALS];

/// Moves the opacity and the colour of a parent.
fn correct(parents: &mut Nodes, index: usize, [target, drawn, missing @ ..]: Correction) {
    if drawn <= 0.0 {
        return;
    }
    parents.nodes[index].opacity *= (target / drawn).clamp(1.0 / MOST_FACTOR, MOST_FACTOR) as f32;
    for (value, missing) in parents.sh_mut(index)[0].iter_mut().zip(missing) {
        *value += (missing / drawn) as f32 / harmonics::C0 as f32;
    }
}

/// Pictures of a group in one direction.
struct View {
    window: Window,
    children: Picture,
    parents: Splats,
}

impl Group<'_> {
    fn on_host(&self, parents: &mut Nodes) -> Measured {
        let Self { windows, is_new, descent } = self;
        let (mut drawing, mut pixels) = (Drawing::default(), PixelResiduals::default());
        let mut views = windows.map(|window| {
            Splats::of(descent.children, window).draw(descent.children, &mut drawing);
            View { window, children: drawing.picture.clone(), parents: Splats::of(parents, window) }
        });
        for some in views.chunks(ROUND_DIRECTIONS).cycle().take(COLOUR_ROUNDS) {
            let mut corrections = vec![Correction::default(); parents.len()];
            for view in some {
                view.parents.draw(parents, &mut drawing);
                pixels.compare(&view.children, &drawing.picture);
                let add = |(splat, sums): (usize, [f32; RESIDUALS])| {
                    corrections[splat].iter_mut().zip(sums).for_each(|(sum, own)| *sum += f64::from(own));
                };
                weighted_sums(&drawing, &pixels.0).into_iter().for_each(add);
            }
            for (i, correction) in corrections.into_iter().enumerate().filter(|(i, _)| descent.is_fitted[*i]) {
                correct(parents, i, correction);
            }
        }
        if descent.rounds > 0 {
            descent.on_host(parents);
            views.iter_mut().for_each(|view| view.parents = Splats::of(parents, view.window));
        }
        let (mut sums, mut parts) = (Vec::new(), vec![0.0; VIEWS * parents.len()]);
        for (view, parts) in views.iter().zip(parts.chunks_mut(parents.len())) {
            view.parents.draw(parents, &mut drawing);
            let difference = Difference::of(view.window, &view.children, &drawing.picture);
            sums.push(difference.sums);
            let shares = [shares(&difference.squared, &drawing, is_new)];
            weighted_sums(&drawing, &shares).into_iter().for_each(|(splat, [part])| parts[splat] = part);
        }
        Measured::of(sums.into_iter(), &parts, is_new)
    }
}

/// For each pixel, the squared difference by the sum of the weights of the new parents there.
fn shares(squared: &[f32], drawing: &Drawing, is_new: &[bool]) -> Vec<f32> {
    let mut covered = vec![0.0_f32; squared.len()];
    for (_, first, weights) in drawing.rows().filter(|(splat, ..)| is_new[*splat]) {
        covered[first..].iter_mut().zip(weights.as_flattened()).for_each(|(sum, weight)| *sum += weight);
    }
    squared.iter().zip(&covered).map(|(squared, covered)| squared / covered.max(LEAST_COVERED)).collect()
}

/// The alphas of the children and of the parents at each pixel, and the missing colour.
#[derive(Default)]
struct PixelResiduals([Vec<f32>; RESIDUALS]);

impl PixelResiduals {
    fn compare(&mut self, children: &Picture, parents: &Picture) {
        self.0.iter_mut().for_each(Vec::clear);
        for (child, own) in children.pixels().zip(parents.pixels()) {
            let (target, drawn) = (1.0 - child[3], 1.0 - own[3]);
            // At equal alpha: a brighter colour must not make up for a lower alpha.
            let missing = |k: usize| if target > LEAST_ALPHA { child[k] * (drawn / target) - own[k] } else { 0.0 };
            let values = [target, drawn, missing(0), missing(1), missing(2)];
            self.0.iter_mut().zip(values).for_each(|(plane, value)| plane.push(value));
        }
    }
}

/// For each splat that is drawn, the sums over its pixels of its weight times some values; small ones are 0. All
/// versions make the same bits, as those of [`Splats::draw`] do.
#[multiversion(targets("x86_64+avx2"))]
fn weighted_sums<const N: usize>(drawing: &Drawing, values: &[Vec<f32>; N]) -> Vec<(usize, [f32; N])> {
    let (mut rows, mut found) = (drawing.rows().peekable(), Vec::new());
    while let Some((splat, ..)) = rows.peek().copied() {
        let mut sums = [[0.0_f32; LANES]; N];
        while let Some((_, first, weights)) = rows.next_if(|row| row.0 == splat) {
            // Loops, as closures would be calls here.
            let mut of_row: [&[[f32; LANES]]; N] = [&[]; N];
            for k in 0..N {
                of_row[k] = values[k][first..].as_chunks().0;
            }
            for (at, weights) in weights.iter().enumerate() {
                for k in 0..N {
                    for i in 0..LANES {
                        sums[k][i] += of_row[k][at][i] * weights[i];
                    }
                }
            }
        }
        let sums = sums.map(|lanes| lanes.iter().sum());
        found.push((splat, sums.map(|sum: f32| if sum.abs() < LEAST { 0.0 } else { sum })));
    }
    found
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
        fit(&children, &mut parents, &[true, false], FitOptions { shape_rounds: 3, fitter: None });
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
