//! Front-to-back blending, with a bound on what f32 rounding may change.

use glam::{DVec2, DVec3, dvec2};
use rayon::iter::Either;
use rayon::prelude::*;

use super::{RayLists, RaySplat, Rays, Splat, Tiling};
use crate::rules::{Rules, TILE};

/// One pixel of a [`super::Rendering`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pixel {
    /// Red, green, blue over the background.
    pub colour: [f64; 3],
    /// The part of the background that is visible, 0 to 1.
    pub transmittance: f64,
    /// Sum of the depths of the blended splats, each times its share of the pixel. A depth is that of a splat's mean,
    /// in world units ([`Camera::depth`](crate::camera::Camera::depth)).
    pub depth: f64,
    /// Depth of the splat after which the transmittance is 0.5 or less; 0 where it stays above.
    pub median_depth: f64,
    /// Number of blended splats.
    pub blended: u32,
    /// Bound on the change of a colour channel when decisions within the rounding error of f32 fall the other way: an
    /// alpha at the threshold, a transmittance at the stop, a ray that leads across a splat around the camera, neither
    /// towards its greatest value nor away. The order of the splats is assumed to be right.
    pub doubt: f64,
}

impl Pixel {
    /// A pixel that sees nothing, not even the background.
    const NOTHING: Self =
        Self { colour: [0.0; 3], transmittance: 1.0, depth: 0.0, median_depth: 0.0, blended: 0, doubt: 0.0 };
}

/// Relative uncertainty of an alpha from `exp2` and the products around it; [`Met::weight_doubt`] is added to it.
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
    let brightest = brightest(lists.splats.par_iter().map(|splat| splat.colour), background);
    let pixel = |index: usize| {
        let (x, y) = (index as u32 % width, index as u32 / width);
        let centre = dvec2(f64::from(x) + 0.5, f64::from(y) + 0.5);
        let [begin, end] = lists.ranges[((y / TILE) * tiling.counts[0] + x / TILE) as usize];
        let ids = &lists.splat_ids[begin as usize..end as usize];
        let along = lists.rays.and_then(|rays| Some((rays, rays.ray(centre)?)));
        let list = Met::list(ids, |id| met(&lists.splats[id as usize], centre, rules), along);
        blend_pixel(list, background, brightest, rules)
    };
    (0..width as usize * height as usize).into_par_iter().with_min_len(256).map(pixel).collect()
}

/// Blends the pixels of a camera with a lens, row by row. Pixels without a ray are transparent black. If `rays` are
/// given, splats are sorted per pixel by their depth along its ray.
pub fn blend_rays(lists: &RayLists, rays: Option<&Rays>, background: DVec3, rules: &Rules) -> Vec<Pixel> {
    let brightest = brightest(lists.splats.par_iter().map(|splat| splat.colour), background);
    let pixel = |(index, ray): (usize, &Option<DVec3>)| {
        let Some(ray) = *ray else { return Pixel::NOTHING };
        let met = |id: u32| met_by_ray(&lists.splats[id as usize], ray, rules);
        let list = Met::list(lists.at(index), met, rays.map(|rays| (rays, ray)));
        blend_pixel(list, background, brightest, rules)
    };
    lists.rays.par_iter().enumerate().with_min_len(256).map(pixel).collect()
}

/// The largest channel of all colours.
fn brightest(colours: impl ParallelIterator<Item = DVec3>, background: DVec3) -> f64 {
    colours.map(|colour| colour.max_element()).reduce(|| 0.0, f64::max).max(background.max_element())
}

/// A splat as one pixel meets it.
struct Met {
    /// Squared Mahalanobis distance, and the one at which the splat ends.
    distance: f64,
    level: f64,
    opacity: f64,
    colour: DVec3,
    depth: f64,
    /// Relative error of the weight from rounding to f32.
    weight_doubt: f64,
    /// The weight of which rounding decides whether the splat has it or none.
    weight_at_edge: f64,
}

impl Met {
    /// The splats `ids` of a pixel in this order, or, with a ray, those that reach it, in the order in which it meets
    /// them.
    fn list(ids: &[u32], met: impl Fn(u32) -> Self, along: Option<(&Rays, DVec3)>) -> impl Iterator<Item = Self> {
        let all = ids.iter().map(move |id| (*id, met(*id)));
        match along {
            None => Either::Left(all.map(|(_, met)| met)),
            Some((rays, ray)) => {
                let reached = all.filter(|(_, met)| met.distance <= met.level);
                let mut sorted: Vec<(f64, Self)> = reached.map(|(id, met)| (rays.depth(id, ray), met)).collect();
                sorted.sort_by(|a, b| a.0.total_cmp(&b.0));
                Either::Right(sorted.into_iter().map(|(_, met)| met))
            }
        }
    }
}

fn met(splat: &Splat, centre: DVec2, rules: &Rules) -> Met {
    let distance = splat.distance(centre);
    let weight_doubt = weight_doubt(splat, centre, distance);
    let Splat { opacity, colour, depth, .. } = *splat;
    Met { distance, level: splat.level(rules), opacity, colour, depth, weight_doubt, weight_at_edge: 0.0 }
}

fn met_by_ray(splat: &RaySplat, ray: DVec3, rules: &Rules) -> Met {
    let (distance, weight_doubt) = (splat.distance(ray), splat.weight_doubt(ray));
    let RaySplat { opacity, colour, depth, kappa, .. } = *splat;
    let level = splat.level(rules);
    // Where w = 0, the squared distance is 1 / kappa on one side.
    let is_edge = kappa * level >= 1.0 && splat.is_edge_in_doubt(ray);
    let weight_at_edge = if is_edge { opacity * (-0.5 / kappa).exp() } else { 0.0 };
    Met { distance, level, opacity, colour, depth, weight_doubt, weight_at_edge }
}

fn blend_pixel(list: impl Iterator<Item = Met>, background: DVec3, brightest: f64, rules: &Rules) -> Pixel {
    let [alpha_max, transmittance_min] = [rules.alpha_max, rules.transmittance_min].map(f64::from);
    let mut colour = DVec3::ZERO;
    let mut transmittance = 1.0;
    let (mut depth, mut median_depth, mut blended) = (0.0, 0.0, 0);
    let mut doubt = 0.0;
    for splat in list {
        let weight = splat.opacity * (-0.5 * splat.distance).exp();
        // The weight where the splat ends: the alpha threshold, or the weight at three standard deviations.
        let least = splat.opacity * (-0.5 * splat.level).exp();
        if (weight / least - 1.0).abs() < ALPHA_DOUBT + splat.weight_doubt {
            doubt += transmittance * least * brightest;
        }
        doubt += transmittance * splat.weight_at_edge * brightest;
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
