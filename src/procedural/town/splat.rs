//! The Gaussian at a spot of a surface: size, opacity, light and spherical harmonics of degree 1.

use glam::{DMat3, DQuat, DVec3, dvec3};

use super::plan::Layout;
use crate::scene::Random;
use crate::scene::harmonics::{C0, basis};
use crate::scene::{Raw, logit};

/// Degree of the spherical harmonics: view-dependent gloss only.
pub const SH_DEGREE: u32 = 1;

/// Towards the sun, unit length: 49 degrees high.
pub const SUN: DVec3 = dvec3(0.52, -0.76, 0.39);

/// Roughness of surfaces, metres. On an exact plane that a camera faces, depths would be equal but for rounding, and
/// with them the order of splats undefined.
const ROUGHNESS: f64 = 0.004;

/// Fraction of the splats of a surface that are faint.
const FAINT: f64 = 0.40;

/// Fraction of the splats of a surface that lie behind it, large and opaque, so that nothing shines through.
pub const BACKING: f64 = 0.25;

/// A spot on a surface.
#[derive(Clone, Copy)]
pub struct Spot {
    pub point: DVec3,
    pub normal: DVec3,
    /// Direction in the surface along which splats are elongated.
    pub grain: DVec3,
    pub albedo: DVec3,
    /// Standard deviations along the grain, across it and along the normal, in units of the spacing.
    pub shape: DVec3,
    /// Largest standard deviations along the grain and across it, metres: edges stay sharp.
    pub limits: [f64; 2],
    pub gloss: f64,
    pub lighting: Lighting,
    /// Largest distance of the backing behind the surface, metres.
    pub depth: f64,
}

#[derive(Clone, Copy, PartialEq)]
pub enum Lighting {
    /// By the sun and the sky, with shadows of houses and trees.
    Sun,
    /// Unlit: its colour is the albedo from all sides.
    Unlit,
}

/// The layer of a surface that a splat belongs to.
#[derive(Clone, Copy, PartialEq)]
pub enum Layer {
    Front,
    Backing,
    /// Stray splats, all of them faint.
    Stray,
}

impl Spot {
    /// A spot of a matte surface without edges.
    pub fn matte(point: DVec3, normal: DVec3, grain: DVec3, albedo: DVec3) -> Self {
        let shape = dvec3(1.05, 0.66, 0.05);
        Self {
            point,
            normal,
            grain,
            albedo,
            shape,
            limits: [f64::INFINITY; 2],
            gloss: 0.04,
            lighting: Lighting::Sun,
            depth: 1.2,
        }
    }
}

/// The Gaussian at a spot of a surface whose splats in this layer are `spacing` metres apart.
pub fn gaussian(
    random: &mut Random,
    layout: &Layout,
    spot: &Spot,
    layer: Layer,
    spacing: f64,
    sh: &mut [[f32; 3]],
) -> Raw {
    let normal = spot.normal;
    let grain = (spot.grain - normal * spot.grain.dot(normal)).normalize_or(normal.any_orthonormal_vector());
    let across = normal.cross(grain);
    let tilt = DQuat::from_axis_angle(random.direction(), 0.05 * random.normal());
    let rotation = tilt * DQuat::from_mat3(&DMat3::from_cols(grain, across, normal));
    let spread = dvec3(random.normal(), random.normal(), random.normal());
    // The backing covers the surface up to its edges.
    let least = if layer == Layer::Backing { 0.6 * spacing } else { 0.16 * spacing };
    let (shape, spread) = match layer {
        Layer::Backing => (dvec3(1.55, 1.35, 0.05), spread * dvec3(0.12, 0.12, 0.6)),
        _ => (spot.shape, spread * dvec3(0.3, 0.3, 0.7)),
    };
    // Log-normal sizes. One splat in thirty is extremely anisotropic, as after training.
    let is_needle = layer == Layer::Front && random.unit() < 1.0 / 30.0;
    let tail = if is_needle { dvec3(0.1, -1.2, -2.6) * random.normal().abs() } else { DVec3::ZERO };
    let mut scale = shape * spacing * (spread + tail).map(f64::exp);
    scale.x = scale.x.min(spot.limits[0].max(least));
    scale.y = scale.y.min(spot.limits[1].max(least));
    let is_faint = layer == Layer::Stray || layer == Layer::Front && random.unit() < FAINT;
    let opacity = match layer {
        _ if is_faint => 0.01 + 0.3 * random.unit().powi(2),
        Layer::Backing => 0.93 + 0.06 * random.unit(),
        _ => 0.99 - 0.5 * random.unit(),
    };
    let behind = if layer == Layer::Backing { (0.9 * spacing).clamp(0.05, spot.depth.max(0.05)) } else { 0.0 };
    let mean = spot.point - (behind + ROUGHNESS * random.normal()) * normal;
    shade(random, layout, spot, sh);
    Raw {
        mean: mean.to_array(),
        log_scale: scale.map(f64::ln).to_array(),
        rotation: [rotation.w, rotation.x, rotation.y, rotation.z],
        opacity_logit: logit(opacity),
    }
}

fn shade(random: &mut Random, layout: &Layout, spot: &Spot, sh: &mut [[f32; 3]]) {
    let (normal, is_lit) = (spot.normal, spot.lighting == Lighting::Sun);
    let (mut light, mut sun) = (DVec3::ONE, 0.0);
    if is_lit {
        let facing = normal.dot(SUN).max(0.0);
        let outside = spot.point + 0.25 * normal;
        sun = if facing > 0.0 { facing * layout.sunlight(outside, SUN) } else { 0.0 };
        let open = (0.74 - 0.26 * normal.y) * (0.80 + 0.20 * (-spot.point.y / 9.0).clamp(0.0, 1.0));
        light = open * dvec3(0.56, 0.60, 0.67) + sun * dvec3(0.74, 0.68, 0.56);
    }
    let grit = if is_lit { 0.012 } else { 0.004 };
    let noise = grit * dvec3(random.normal(), random.normal(), random.normal());
    sh[0] = ((spot.albedo * light + noise - 0.5) / C0).to_array().map(|v| v as f32);
    if spot.gloss == 0.0 {
        return;
    }
    let mirror = 2.0 * normal.dot(SUN) * normal - SUN;
    // The highlight is visible when looking against the mirrored light, and SH take the viewing direction.
    let lobe = basis((-mirror).to_array());
    for (i, coefficient) in sh.iter_mut().enumerate().skip(1) {
        let highlight = spot.gloss * (0.35 + 0.65 * sun) * lobe[i];
        *coefficient = std::array::from_fn(|_| (highlight + grit * random.normal()) as f32);
    }
}
