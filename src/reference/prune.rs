//! What Gaussians contribute to a picture, and a bound on what it changes by without some of them.

use glam::{DVec2, dvec2};
use rayon::prelude::*;

use super::{Listed, Lists, Tiling};
use crate::camera::Camera;
use crate::rules::{Background, Rules, TILE};
use crate::scene::Gaussians;

/// The share that a splat or a Gaussian has of the pixels of a picture. A share is alpha * transmittance.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Contribution {
    /// The largest at a pixel.
    pub largest: f64,
    /// The sum over all pixels.
    pub sum: f64,
}

/// What a pixel changes by at most if some splats are dropped.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Change {
    /// The shares of the dropped splats, and what is left where the pixel no longer stops.
    pub share: f64,
    /// The share times the brightest colour in the list of the tile.
    pub bound: f64,
}

/// What every Gaussian contributes to the view of a pinhole.
///
/// # Panics
/// If the camera has a lens.
pub fn contributions(gaussians: &Gaussians, camera: &Camera, rules: &Rules) -> Vec<Contribution> {
    let tiling = Tiling::of(camera.size_px);
    let listed = Listed::of(gaussians, camera, rules);
    let mut all = vec![Contribution::default(); gaussians.len()];
    for (id, found) in listed.visible.iter().zip(contribute(&listed.lists(None), tiling, rules)) {
        all[*id as usize] = found;
    }
    all
}

/// What every pixel of a pinhole's view changes by at most if only the Gaussians are drawn that `is_kept` accepts.
///
/// # Panics
/// If the camera has a lens.
pub fn changes(
    gaussians: &Gaussians,
    camera: &Camera,
    rules: &Rules,
    background: Background,
    is_kept: impl Fn(u32) -> bool + Sync,
) -> Vec<Change> {
    let tiling = Tiling::of(camera.size_px);
    let listed = Listed::of(gaussians, camera, rules);
    let background = background.colour().into_iter().fold(0.0, f32::max).into();
    bound(&listed.lists(None), tiling, rules, background, |splat| is_kept(listed.visible[splat as usize]))
}

/// What every splat contributes.
pub fn contribute(lists: &Lists, tiling: Tiling, rules: &Rules) -> Vec<Contribution> {
    let tile = |tile: usize| {
        let [begin, end] = lists.ranges[tile];
        let ids = &lists.splat_ids[begin as usize..end as usize];
        let mut found = vec![Contribution::default(); ids.len()];
        for centre in centres(tiling, tile) {
            let mut transmittance = 1.0;
            for (id, found) in ids.iter().zip(&mut found) {
                let (share, stops) = take_share(lists, *id, centre, rules, &mut transmittance);
                found.largest = found.largest.max(share);
                found.sum += share;
                if stops {
                    break;
                }
            }
        }
        ids.iter().copied().zip(found).collect::<Vec<_>>()
    };
    let tiles: Vec<_> = (0..tiling.tiles()).into_par_iter().map(tile).collect();
    let mut all = vec![Contribution::default(); lists.splats.len()];
    for (id, found) in tiles.into_iter().flatten() {
        let whole = &mut all[id as usize];
        *whole = Contribution { largest: whole.largest.max(found.largest), sum: whole.sum + found.sum };
    }
    all
}

/// What every pixel changes by at most if only the splats are drawn that `is_kept` accepts. `background` is the
/// brightest channel of the background. Returns the pixels row by row.
pub fn bound(
    lists: &Lists,
    tiling: Tiling,
    rules: &Rules,
    background: f64,
    is_kept: impl Fn(u32) -> bool + Sync,
) -> Vec<Change> {
    let [width, height] = tiling.size_px;
    let brightest = |range: &[u32; 2]| {
        let ids = &lists.splat_ids[range[0] as usize..range[1] as usize];
        ids.iter().map(|id| lists.splats[*id as usize].colour.max_element()).fold(background, f64::max)
    };
    let brightest: Vec<f64> = lists.ranges.par_iter().map(brightest).collect();
    let pixel = |index: usize| {
        let (x, y) = (index as u32 % width, index as u32 / width);
        let tile = (y / TILE * tiling.counts[0] + x / TILE) as usize;
        let [begin, end] = lists.ranges[tile];
        let centre = dvec2(f64::from(x) + 0.5, f64::from(y) + 0.5);
        let share = dropped_share(lists, &lists.splat_ids[begin as usize..end as usize], centre, rules, &is_kept);
        Change { share, bound: share * brightest[tile] }
    };
    (0..width as usize * height as usize).into_par_iter().with_min_len(256).map(pixel).collect()
}

/// The share of a pixel that dropped splats have. If the pixel no longer stops where it did, what lies behind that
/// shows, too, and the transmittance there is added.
fn dropped_share(lists: &Lists, ids: &[u32], centre: DVec2, rules: &Rules, is_kept: impl Fn(u32) -> bool) -> f64 {
    let (mut whole, mut without, mut dropped) = (1.0, 1.0, 0.0);
    for id in ids {
        let (share, stops) = take_share(lists, *id, centre, rules, &mut whole);
        if !is_kept(*id) {
            dropped += share;
        } else if share > 0.0 {
            let (_, stops_too) = take_share(lists, *id, centre, rules, &mut without);
            if stops && !stops_too {
                dropped += share;
            }
        }
        if stops {
            break;
        }
    }
    dropped
}

/// Takes a splat's share off the transmittance. Returns the share: 0 where the splat is not drawn. A splat that would
/// take the transmittance below the least is not drawn either, but it ends the pixel (the second value is true) and
/// hides all that is behind it, so its share is all that is left.
fn take_share(lists: &Lists, id: u32, centre: DVec2, rules: &Rules, transmittance: &mut f64) -> (f64, bool) {
    let splat = &lists.splats[id as usize];
    let distance = splat.distance(centre);
    if distance > splat.level(rules) {
        return (0.0, false);
    }
    let alpha = (splat.opacity * (-0.5 * distance).exp()).min(rules.alpha_max.into());
    let rest = *transmittance * (1.0 - alpha);
    if rest < f64::from(rules.transmittance_min) {
        return (*transmittance, true);
    }
    let share = alpha * *transmittance;
    *transmittance = rest;
    (share, false)
}

/// The centres of the pixels of a tile that lie in the image.
fn centres(tiling: Tiling, tile: usize) -> impl Iterator<Item = DVec2> {
    let [columns, _] = tiling.counts;
    let corner = [tile as u32 % columns * TILE, tile as u32 / columns * TILE];
    let [across, down] = [0, 1].map(|axis| corner[axis]..(corner[axis] + TILE).min(tiling.size_px[axis]));
    down.flat_map(move |y| across.clone().map(move |x| dvec2(f64::from(x) + 0.5, f64::from(y) + 0.5)))
}
