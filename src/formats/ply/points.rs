//! Point clouds without Gaussians: each point becomes a ball whose size fits the distance to its neighbours.

use anyhow::Result;
use glam::DVec3;

use super::header::Element;
use super::layout::{Colour, all};
use super::rows::Rows;
use crate::formats::input::Input;
use crate::host_memory::host_vec;
use crate::scene::{BLOCK, Raw, Scene, logit, morton};

/// Points before and after a point on the Z-order curve that are searched for its nearest neighbour.
const NEIGHBOURS: usize = 8;
/// Opacity of a ball.
const OPACITY: f64 = 0.9;
/// Coefficients of degree 0 for a point without a colour.
const GREY: [f32; 3] = [0.0; 3];

pub(crate) fn read(input: &mut Input, rows: &mut Rows, kept: &Element) -> Result<Scene> {
    let position = all(kept, ["x", "y", "z"])?;
    let colour = Colour::channels(kept)?.map(|_| Colour::of(kept)).transpose()?;
    let mut means: Vec<[f64; 3]> = host_vec(rows.count, "points")?;
    let mut colours: Vec<[f32; 3]> = host_vec(rows.count, "colours of points")?;
    let stride = kept.stride();
    for first in (0..rows.count).step_by(BLOCK) {
        let block = BLOCK.min(rows.count - first);
        let bytes = rows.next(input, first, block)?;
        for row in bytes.chunks_exact(stride) {
            means.push(position.map(|p| p.read(row)));
            colours.push(colour.map_or(GREY, |colour| colour.read(row)));
        }
    }
    let radii = radii(&means);
    let mut builder = input.builder(0, means.len())?;
    builder.extend(means.len(), |index, sh| {
        sh[0] = colours[index];
        Raw {
            mean: means[index],
            log_scale: [f64::from(radii[index]).ln(); 3],
            rotation: [1.0, 0.0, 0.0, 0.0],
            opacity_logit: logit(OPACITY),
        }
    });
    let (gaussians, report) = builder.finish();
    let notice = "it is a point cloud without Gaussians, and is drawn as balls between its neighbours".to_owned();
    Ok(Scene {
        gaussians,
        report,
        format: "PLY, points".to_owned(),
        is_antialiased: false,
        notices: vec![notice],
        levels: Vec::new(),
    })
}

/// Half the distance of each point to the nearest of its neighbours on the Z-order curve, limited to four times the
/// median so that a remote point does not become a large ball.
fn radii(means: &[[f64; 3]]) -> Vec<f32> {
    // Neighbours far from the origin must not fall together.
    let origin = means.iter().map(|mean| DVec3::from(*mean)).find(|mean| mean.is_finite()).unwrap_or(DVec3::ZERO);
    let means: Vec<[f32; 3]> = means.iter().map(|mean| (DVec3::from(*mean) - origin).as_vec3().to_array()).collect();
    let means = &means;
    let mut order: Vec<u32> = (0..means.len() as u32).collect();
    order.retain(|i| means[*i as usize].iter().all(|v| v.is_finite()));
    morton::sort(means, &mut order);
    let mut radii = vec![0.0; means.len()];
    for (place, index) in order.iter().enumerate() {
        let mean = glam::Vec3::from(means[*index as usize]);
        let near = &order[place.saturating_sub(NEIGHBOURS)..order.len().min(place + NEIGHBOURS + 1)];
        let distances = near.iter().map(|other| mean.distance(means[*other as usize].into())).filter(|d| *d > 0.0);
        radii[*index as usize] = distances.fold(f32::INFINITY, f32::min) / 2.0;
    }
    let mut sorted: Vec<f32> = radii.iter().copied().filter(|r| r.is_finite() && *r > 0.0).collect();
    let middle = sorted.len() / 2;
    let most = if sorted.is_empty() { 1.0 } else { 4.0 * *sorted.select_nth_unstable_by(middle, f32::total_cmp).1 };
    radii.iter().map(|radius| radius.min(most)).collect()
}
