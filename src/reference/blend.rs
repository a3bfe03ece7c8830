//! Front-to-back blending, with a bound on what f32 rounding may change.

use glam::{DVec2, DVec3, dvec2};
use rayon::prelude::*;

use super::{Rays, Splat, Tiling};
use crate::rules::{Rules, TILE};

/// One pixel of a [`super::Rendering`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pixel {
    /// Red, green, blue over the background.
    pub colour: [f64; 3],
    /// The part of the background that is visible, 0 to 1.
    pub transmittance: f64,
    /// Sum of the depths of the blended splats, each times its share of the pixel. A depth is the view z of a splat's
    /// mean, in world units.
    pub depth: f64,
    /// Depth of the splat after which the transmittance is 0.5 or less; 0 where it stays above.
    pub median_depth: f64,
    /// Number of blended splats.
    pub blended: u32,
    /// Bound on the change of a colour channel when decisions within the rounding error of f32 fall the other way: an
    /// alpha at the threshold, a transmittance at the stop. The order of the splats is assumed to be right.
    pub doubt: f64,
}

/// Relative uncertainty of an alpha from `exp2` and the products around it; [`weight_doubt`] is added to it.
const ALPHA_DOUBT: f64 = 2e-5;
/// Relative uncertainty of a transmittance: factors 1 - alpha near 0.01 magnify the error of alpha a hundred times.
const STOP_DOUBT: f64 = 1e-3;
/// Transmittance below which blending ends under any rules.
const NOTHING: f64 = 1e-12;

/// The splats of every tile, front to back.
pub struct Lists<'a> {
    /// The splats that `splat_ids` index.
    pub splats: &'a [Splat],
    /// First and one past the last index into `splat_ids`, for each tile.
    pub ranges: &'a [[u32; 2]],
    /// Indices into `splats`, tile after tile.
    pub splat_ids: &'a [u32],
    /// If given, splats are sorted per pixel by their depth along its ray.
    pub rays: Option<&'a Rays>,
}

/// Blends the list of every tile. Returns the pixels row by row.
pub fn blend(lists: &Lists, tiling: Tiling, background: DVec3, rules: &Rules) -> Vec<Pixel> {
    let [width, height] = tiling.size_px;
    let brightest =
        lists.splats.par_iter().map(|s| s.colour.max_element()).reduce(|| 0.0, f64::max).max(background.max_element());
    let pixel = |index: usize| {
        let (x, y) = (index as u32 % width, index as u32 / width);
        let centre = dvec2(f64::from(x) + 0.5, f64::from(y) + 0.5);
        let [begin, end] = lists.ranges[((y / TILE) * tiling.counts[0] + x / TILE) as usize];
        let ids = &lists.splat_ids[begin as usize..end as usize];
        let splat = |id: &u32| &lists.splats[*id as usize];
        match lists.rays {
            None => blend_pixel(ids.iter().map(splat), centre, background, brightest, rules),
            Some(rays) => {
                let by_depth = sorted_along_ray(ids, rays, centre, |id| contributes(splat(&id), centre, rules));
                blend_pixel(by_depth.iter().map(splat), centre, background, brightest, rules)
            }
        }
    };
    (0..width as usize * height as usize).into_par_iter().with_min_len(256).map(pixel).collect()
}

/// The `ids` that `keep` accepts, in the order in which the ray through `centre` meets them.
fn sorted_along_ray(ids: &[u32], rays: &Rays, centre: DVec2, keep: impl Fn(u32) -> bool) -> Vec<u32> {
    let kept = ids.iter().filter(|id| keep(**id));
    let mut met: Vec<(f64, u32)> = kept.map(|id| (rays.depth(*id, centre), *id)).collect();
    met.sort_by(|a, b| a.0.total_cmp(&b.0));
    met.into_iter().map(|(_, id)| id).collect()
}

fn contributes(splat: &Splat, centre: DVec2, rules: &Rules) -> bool {
    splat.distance(centre) <= splat.level(rules)
}

fn blend_pixel<'s>(
    list: impl Iterator<Item = &'s Splat>,
    centre: DVec2,
    background: DVec3,
    brightest: f64,
    rules: &Rules,
) -> Pixel {
    let [alpha_max, transmittance_min] = [rules.alpha_max, rules.transmittance_min].map(f64::from);
    let mut colour = DVec3::ZERO;
    let mut transmittance = 1.0;
    let (mut depth, mut median_depth, mut blended) = (0.0, 0.0, 0);
    let mut doubt = 0.0;
    for splat in list {
        let distance = splat.distance(centre);
        let weight = splat.opacity * (-0.5 * distance).exp();
        // The weight where the splat ends: the alpha threshold, or the weight at three standard deviations.
        let least = splat.opacity * (-0.5 * splat.level(rules)).exp();
        if (weight / least - 1.0).abs() < ALPHA_DOUBT + weight_doubt(splat, centre, distance) {
            doubt += transmittance * least * brightest;
        }
        if weight < least {
            continue;
        }
        let alpha = weight.min(alpha_max);
        let rest = transmittance * (1.0 - alpha);
        if transmittance_min > 0.0 && (rest / transmittance_min - 1.0).abs() < STOP_DOUBT {
            doubt += transmittance * brightest;
        }
        if rest < transmittance_min {
            break;
        }
        let share = alpha * transmittance;
        colour += splat.colour * share;
        depth += splat.depth * share;
        if transmittance > 0.5 && rest <= 0.5 {
            median_depth = splat.depth;
        }
        blended += 1;
        transmittance = rest;
        if transmittance < NOTHING {
            break;
        }
    }
    let colour = (colour + transmittance * background).to_array();
    Pixel { colour, transmittance, depth, median_depth, blended, doubt }
}

/// Relative error of a weight from rounding screen positions to f32: a few times 2^-24 of their size. The short axis of
/// a splat, at least sqrt(0.3) px, converts a shift into a change of distance.
fn weight_doubt(splat: &Splat, centre: DVec2, distance: f64) -> f64 {
    let largest = (centre - splat.mean_px).abs().max_element() + centre.max_element();
    let shift = 4.0 * 0.5_f64.powi(24) * largest;
    let steepest = (splat.conic.x_axis.x + splat.conic.y_axis.y).sqrt(); // at least 1 / the short axis
    distance.sqrt() * steepest * shift
}
