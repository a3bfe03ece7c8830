//! A seeded procedural scene: a potted cactus of any number of Gaussians, the object of the paper on which this project
//! is based.
//!
//! It has the properties of trained scenes: flat surface splats, needles (the spines), a heavy tail of anisotropy, many
//! faint splats, floaters, and view-dependent colour up to SH degree 3. Up is -y.

use std::f64::consts::{PI, TAU};
use std::ops::Range;

use glam::{DMat3, DQuat, DVec3, dvec3};

use crate::host_memory::OutOfMemory;
use crate::scene::Random;
use crate::scene::harmonics::{C0, basis};
use crate::scene::{Builder, Gaussians, LoadReport, Raw, Scene, USUAL_SH_DEGREE, logit};

/// Number of Gaussians of the coarsest of the four levels of detail in the paper.
pub const DEFAULT_COUNT: usize = 139_410;

/// The cactus with `count` Gaussians. The same count gives the same scene on every machine.
///
/// # Errors
/// [`OutOfMemory`] if it cannot be allocated.
pub fn cactus(count: usize) -> Result<Scene, OutOfMemory> {
    fill(count, 0..count).map(|(gaussians, report)| Scene::made("cactus", gaussians, report))
}

/// The Gaussians of a range of the cactus.
pub(crate) fn fill(count: usize, range: Range<usize>) -> Result<(Gaussians, LoadReport), OutOfMemory> {
    fill_parts(&PARTS, count, range, |point| if point.y > -0.02 { contact_shadow(point) } else { 1.0 })
}

/// The Gaussians of a range of a scene of these parts with `count` Gaussians. `shadow`: a factor on the light at a
/// point.
pub(crate) fn fill_parts(
    parts: &[Part],
    count: usize,
    range: Range<usize>,
    shadow: fn(DVec3) -> f64,
) -> Result<(Gaussians, LoadReport), OutOfMemory> {
    let mut builder = Builder::new(USUAL_SH_DEGREE, range.len())?;
    let weight: f64 = parts.iter().map(|p| p.share).sum();
    let (mut begin, mut share) = (0, 0.0);
    for part in parts {
        share += part.share;
        let end = (count as f64 * share / weight).round() as usize;
        // The surface is covered at any count: each splat gets its share of the area.
        let spacing = (part.area / (end - begin).max(1) as f64).sqrt();
        let wanted = range.start.max(begin)..range.end.min(end);
        builder.extend(wanted.len(), |i, sh| gaussian(&mut Random::of(wanted.start + i), part, spacing, shadow, sh));
        begin = end;
    }
    Ok(builder.finish())
}

/// A part of the scene: its share of the Gaussians, and their appearance.
pub(crate) struct Part {
    /// Weight of its number of Gaussians.
    pub share: f64,
    /// Area that its splats cover together, world units squared.
    pub area: f64,
    /// Fraction of its splats that are faint.
    pub faint: f64,
    /// Strength of the highlight.
    pub gloss: f64,
    pub sample: fn(&mut Random) -> Patch,
}

const PARTS: [Part; 8] = [
    Part { share: 0.38, area: 5.2, faint: 0.35, gloss: 0.25, sample: flesh },
    Part { share: 0.10, area: 0.30, faint: 0.10, gloss: 0.10, sample: spine },
    Part { share: 0.15, area: 3.0, faint: 0.35, gloss: 0.35, sample: pot },
    Part { share: 0.05, area: 0.6, faint: 0.30, gloss: 0.05, sample: soil },
    Part { share: 0.03, area: 0.35, faint: 0.25, gloss: 0.15, sample: flower },
    Part { share: 0.19, area: 16.0, faint: 0.35, gloss: 0.12, sample: table },
    Part { share: 0.06, area: 9000.0, faint: 0.60, gloss: 0.0, sample: backdrop },
    Part { share: 0.04, area: 30.0, faint: 1.0, gloss: 0.0, sample: floater },
];

/// A piece of surface.
pub(crate) struct Patch {
    pub point: DVec3,
    pub normal: DVec3,
    /// Direction in the surface along which splats are elongated.
    pub grain: DVec3,
    pub albedo: DVec3,
    /// Standard deviations along the grain, across it and along the normal, in units of the spacing.
    pub shape: DVec3,
    /// Lit by the light; otherwise it has its albedo from all sides.
    pub is_lit: bool,
}

const LIGHT: DVec3 = dvec3(-0.48, -0.72, -0.5); // towards the light, nearly unit length

fn gaussian(random: &mut Random, part: &Part, spacing: f64, shadow: fn(DVec3) -> f64, sh: &mut [[f32; 3]]) -> Raw {
    let patch = (part.sample)(random);
    let any = patch.normal.any_orthonormal_vector();
    let grain = (patch.grain - patch.normal * patch.grain.dot(patch.normal)).normalize_or(any);
    let across = patch.normal.cross(grain);
    let tilt = DQuat::from_axis_angle(random.direction(), 0.08 * random.normal());
    let rotation = tilt * DQuat::from_mat3(&DMat3::from_cols(grain, across, patch.normal));
    // Log-normal sizes. One splat in thirty is extremely anisotropic, as after training.
    let tail = if random.unit() < 1.0 / 30.0 { dvec3(0.3, -1.2, -2.6) * random.normal().abs() } else { DVec3::ZERO };
    let spread = dvec3(random.normal(), random.normal(), random.normal()) * dvec3(0.3, 0.3, 0.6);
    let log_scale = (patch.shape * spacing).map(f64::ln) + spread + tail;
    let is_faint = random.unit() < part.faint;
    let opacity = if is_faint { 0.003 + 0.25 * random.unit().powi(3) } else { 1.0 - 0.6 * random.unit().powi(2) };

    let diffuse = if patch.is_lit { 0.42 + 0.62 * patch.normal.dot(LIGHT).max(0.0) } else { 1.0 };
    let shadow = if patch.is_lit { shadow(patch.point) } else { 1.0 };
    let grit = if patch.is_lit { 0.02 } else { 0.004 };
    let noise = grit * dvec3(random.normal(), random.normal(), random.normal());
    sh[0] = ((patch.albedo * diffuse * shadow + noise - 0.5) / C0).to_array().map(|v| v as f32);
    let mirror = 2.0 * patch.normal.dot(LIGHT) * patch.normal - LIGHT;
    // The highlight is visible when looking against the mirrored light, and SH take the viewing direction.
    let lobe = basis((-mirror.normalize_or(DVec3::Y)).to_array());
    for (i, coefficient) in sh.iter_mut().enumerate().skip(1) {
        let band = (i as f64).sqrt().floor();
        let highlight = part.gloss * lobe[i] * (-0.25 * band * band).exp();
        *coefficient = std::array::from_fn(|_| (highlight + 1.5 * grit / band * random.normal()) as f32);
    }
    Raw {
        mean: patch.point.to_array(),
        log_scale: log_scale.to_array(),
        rotation: [rotation.w, rotation.x, rotation.y, rotation.z],
        opacity_logit: logit(opacity),
    }
}

/// The plant: a ribbed column with two arms, circles along an axis.
fn flesh(random: &mut Random) -> Patch {
    let (centre, direction, radius, _) = limb(random);
    let angle = TAU * random.unit();
    let (side, other) = direction.any_orthonormal_pair();
    let out = side * angle.cos() + other * angle.sin();
    let rib = (RIBS * angle).cos();
    let valley = 0.5 - 0.5 * rib;
    let green = dvec3(0.26, 0.50, 0.20).lerp(dvec3(0.10, 0.27, 0.13), valley) * (1.0 + 0.08 * random.normal());
    Patch {
        point: centre + out * radius * (1.0 + 0.09 * rib) * (1.0 - 0.02 * random.unit()),
        normal: (out - side.lerp(other, 0.5) * 0.05 * rib).normalize(),
        grain: direction,
        albedo: green,
        shape: dvec3(1.5, 0.55, 0.12),
        is_lit: true,
    }
}

const RIBS: f64 = 12.0;

/// A point on the axis of the column or of an arm: centre, direction, radius, and position along the axis from 0 to 1.
fn limb(random: &mut Random) -> (DVec3, DVec3, f64, f64) {
    let t = random.unit();
    let pick = random.unit();
    let dome = |t: f64| (1.0 - ((t - 0.86).max(0.0) / 0.14).powi(2)).max(0.0).sqrt();
    if pick < 0.62 {
        let bulge = 0.30 + 0.05 * (PI * t).sin();
        return (dvec3(0.03 * (3.0 * t).sin(), -0.62 - 1.75 * t, 0.0), -DVec3::Y, bulge * dome(t).max(0.02), t);
    }
    // An arm leaves the column sideways and turns upwards in a quarter circle.
    let (side, height, length, yaw) = if pick < 0.83 { (1.0, -1.02, 0.62, 0.35) } else { (-1.0, -1.3, 0.38, -0.5) };
    let outward = dvec3(side * f64::cos(yaw), 0.0, f64::sin(yaw));
    let turn = 0.34;
    let start = dvec3(0.0, height, 0.0) + outward * 0.18;
    let (arc, straight) = (turn * PI / 2.0, length);
    let s = t * (arc + straight);
    let (point, direction) = if s < arc {
        let a = s / turn;
        (start + outward * turn * a.sin() - DVec3::Y * turn * (1.0 - a.cos()), outward * a.cos() - DVec3::Y * a.sin())
    } else {
        (start + outward * turn - DVec3::Y * (turn + s - arc), -DVec3::Y)
    };
    (point, direction, 0.155 * dome(t).max(0.02), t)
}

/// Needles in tufts along the ribs.
fn spine(random: &mut Random) -> Patch {
    let (centre, direction, radius, _) = limb(random);
    let rib = (random.unit() * RIBS).floor();
    let (side, other) = direction.any_orthonormal_pair();
    let angle = TAU * rib / RIBS;
    let out = side * angle.cos() + other * angle.sin();
    let lean = (out + 0.55 * random.direction()).normalize();
    let along = random.unit();
    Patch {
        point: centre + out * radius * 1.09 + lean * 0.09 * along,
        normal: lean.any_orthonormal_vector(),
        grain: lean,
        albedo: dvec3(0.90, 0.82, 0.62) * (1.0 - 0.3 * along),
        shape: dvec3(9.0, 0.22, 0.18),
        is_lit: true,
    }
}

/// The terracotta pot: a cone that widens upwards, with a rim.
fn pot(random: &mut Random) -> Patch {
    let angle = TAU * random.unit();
    let out = dvec3(angle.cos(), 0.0, angle.sin());
    let t = random.unit();
    let is_rim = t > 0.74;
    let radius = if is_rim { 0.66 } else { 0.42 + 0.24 * t };
    let height = -0.62 * t;
    let band = if is_rim || (t * 22.0).sin() > 0.93 { 0.88 } else { 1.0 };
    Patch {
        point: out * radius + DVec3::Y * height,
        normal: (out + dvec3(0.0, 0.3, 0.0)).normalize(),
        grain: dvec3(-out.z, 0.0, out.x),
        albedo: dvec3(0.72, 0.36, 0.22) * band * (1.0 + 0.05 * random.normal()),
        shape: dvec3(1.1, 0.7, 0.10),
        is_lit: true,
    }
}

fn soil(random: &mut Random) -> Patch {
    let (angle, radius) = (TAU * random.unit(), 0.63 * random.unit().sqrt());
    let pebble = if random.unit() < 0.15 { dvec3(0.62, 0.58, 0.52) } else { dvec3(0.24, 0.17, 0.12) };
    Patch {
        point: dvec3(radius * angle.cos(), -0.57 - 0.03 * random.unit(), radius * angle.sin()),
        normal: (-DVec3::Y + 0.4 * random.direction()).normalize(),
        grain: random.direction(),
        albedo: pebble * (1.0 + 0.2 * random.normal()),
        shape: dvec3(0.9, 0.7, 0.4),
        is_lit: true,
    }
}

/// Petals on the crown of the column and on the long arm.
fn flower(random: &mut Random) -> Patch {
    let crown = if random.unit() < 0.7 { dvec3(0.03 * 3.0_f64.sin(), -2.36, 0.0) } else { dvec3(0.49, -1.95, 0.18) };
    let petal = (random.unit() * 9.0).floor() / 9.0 * TAU;
    let (t, width) = (random.unit(), random.normal() * 0.22);
    let out = dvec3((petal + width).cos(), 0.0, (petal + width).sin());
    let is_heart = t < 0.18;
    let colour =
        if is_heart { dvec3(0.98, 0.80, 0.25) } else { dvec3(0.93, 0.30, 0.52).lerp(dvec3(1.0, 0.72, 0.80), t) };
    Patch {
        point: crown + out * 0.20 * t - DVec3::Y * (0.16 * (t * 2.2).sin() - 0.02),
        normal: (-DVec3::Y + 0.8 * out).normalize(),
        grain: out,
        albedo: colour * 1.1,
        shape: dvec3(1.3, 0.7, 0.1),
        is_lit: true,
    }
}

/// A wooden table: planks along x.
fn table(random: &mut Random) -> Patch {
    let (angle, radius) = (TAU * random.unit(), 2.4 * random.unit().sqrt());
    let point = dvec3(radius * angle.cos(), 0.0, radius * angle.sin());
    let plank = (point.z / 0.42).floor();
    let tone = 0.85 + 0.15 * (plank * 12.9898).sin();
    let grain = 0.94 + 0.06 * (point.z * 90.0 + 3.0 * (point.x * 1.7 + plank).sin()).sin();
    let gap = if (point.z / 0.42).fract().abs() < 0.02 { 0.45 } else { 1.0 };
    Patch {
        point: point + DVec3::Y * 0.004 * random.normal(),
        normal: -DVec3::Y,
        grain: DVec3::X,
        albedo: dvec3(0.66, 0.49, 0.33) * tone * grain * gap,
        shape: dvec3(1.8, 0.5, 0.05),
        is_lit: true,
    }
}

/// Large soft splats far away, warm at the horizon and cool above, as training makes them for a background.
fn backdrop(random: &mut Random) -> Patch {
    let direction = random.direction();
    let height = 0.5 - 0.5 * direction.y;
    let (floor, horizon, sky) = (dvec3(0.36, 0.30, 0.27), dvec3(0.93, 0.84, 0.72), dvec3(0.50, 0.63, 0.72));
    let tone = if height < 0.5 { floor.lerp(horizon, 2.0 * height) } else { horizon.lerp(sky, 2.0 * height - 1.0) };
    Patch {
        point: direction * (26.0 + 4.0 * random.unit()),
        normal: -direction,
        grain: random.direction(),
        albedo: tone * (1.0 + 0.015 * random.normal()),
        shape: dvec3(2.2, 1.8, 0.1),
        is_lit: false,
    }
}

/// Stray splats in the air, a few of them very far away.
fn floater(random: &mut Random) -> Patch {
    let far = if random.unit() < 0.02 { 200.0 * random.unit() } else { 0.0 };
    let direction = random.direction();
    Patch {
        point: dvec3(0.0, -1.2, 0.0) + direction * (0.6 + 2.6 * random.unit() + far),
        normal: random.direction(),
        grain: random.direction(),
        albedo: dvec3(0.6, 0.57, 0.52) + 0.2 * random.direction(),
        shape: dvec3(0.25, 0.12, 0.03),
        is_lit: false,
    }
}

/// The shadow of the pot on the table, as a factor on the light.
fn contact_shadow(point: DVec3) -> f64 {
    let from_pot = dvec3(point.x - 0.25, 0.0, point.z - 0.25).length();
    1.0 - 0.55 * (-(from_pot / 0.75).powi(4)).exp()
}
