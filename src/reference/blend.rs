//! Front-to-back blending, and where an f32 renderer may rightly decide otherwise.

use glam::{DVec2, DVec3, dvec2};
use rayon::prelude::*;

use super::{Splat, Tiling};
use crate::options::{ALPHA_MAX, ALPHA_MIN, TILE, TRANSMITTANCE_MIN};

/// One pixel of a [`super::Rendering`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pixel {
    /// Over the background.
    pub colour: [f64; 3],
    pub transmittance: f64,
    /// How far a colour channel may move when decisions that lie within the rounding of f32 arithmetic fall the other
    /// way: an alpha at the threshold, a transmittance at the stop. The order of the splats is not in doubt.
    pub doubt: f64,
}

/// Relative width of a doubtful alpha besides what [`weight_doubt`] adds: `exp2` and the products around it.
const ALPHA_DOUBT: f64 = 2e-5;
/// Relative width of a doubtful transmittance: factors 1 - alpha near 0.01 magnify an alpha's error a hundred times.
const STOP_DOUBT: f64 = 1e-3;

/// Blends every tile's list. Returns the pixels row by row.
pub fn blend(
    splats: &[Splat],
    ranges: &[[u32; 2]],
    splat_ids: &[u32],
    tiling: Tiling,
    background: [f64; 3],
) -> Vec<Pixel> {
    let [width, height] = tiling.size_px;
    let background = DVec3::from(background);
    let brightest =
        splats.par_iter().map(|s| s.colour.max_element()).reduce(|| 0.0, f64::max).max(background.max_element());
    let pixel = |index: usize| {
        let (x, y) = (index as u32 % width, index as u32 / width);
        let [begin, end] = ranges[((y / TILE) * tiling.counts[0] + x / TILE) as usize];
        let list = splat_ids[begin as usize..end as usize].iter().map(|id| &splats[*id as usize]);
        blend_pixel(list, dvec2(f64::from(x) + 0.5, f64::from(y) + 0.5), background, brightest)
    };
    (0..width as usize * height as usize).into_par_iter().with_min_len(256).map(pixel).collect()
}

fn blend_pixel<'s>(list: impl Iterator<Item = &'s Splat>, centre: DVec2, background: DVec3, brightest: f64) -> Pixel {
    let mut colour = DVec3::ZERO;
    let mut transmittance = 1.0;
    let mut doubt = 0.0;
    for splat in list {
        let distance = splat.distance(centre);
        let alpha = (splat.opacity * (-0.5 * distance).exp()).min(ALPHA_MAX);
        if (alpha / ALPHA_MIN - 1.0).abs() < ALPHA_DOUBT + weight_doubt(splat, centre, distance) {
            doubt += transmittance * ALPHA_MIN * brightest;
        }
        if alpha < ALPHA_MIN {
            continue;
        }
        let rest = transmittance * (1.0 - alpha);
        if (rest / TRANSMITTANCE_MIN - 1.0).abs() < STOP_DOUBT {
            doubt += transmittance * brightest;
        }
        if rest < TRANSMITTANCE_MIN {
            break;
        }
        colour += splat.colour * (alpha * transmittance);
        transmittance = rest;
    }
    Pixel { colour: (colour + transmittance * background).to_array(), transmittance, doubt }
}

/// Relative error of a weight from rounding positions on the screen to f32, 2^-24 of their size a few times over.
/// A splat's short axis, at least sqrt(0.3) px, turns a shift into a change of distance.
fn weight_doubt(splat: &Splat, centre: DVec2, distance: f64) -> f64 {
    let largest = (centre - splat.mean_px).abs().max_element() + centre.max_element();
    let shift = 4.0 * 0.5_f64.powi(24) * largest;
    let steepest = (splat.conic.x_axis.x + splat.conic.y_axis.y).sqrt(); // over 1 / the short axis
    distance.sqrt() * steepest * shift
}
