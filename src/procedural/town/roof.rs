//! Roofs: tiles on slopes, gravel behind parapets, spires.

use glam::{DVec3, dvec2, dvec3};

use super::facade::Style;
use super::layout::{House, Roof};
use super::splat::Spot;

/// Overhang of a roof over the wall below its eaves, metres.
const EAVES: f64 = 0.35;

/// Number of the parts of the roof.
pub fn slopes(house: &House) -> usize {
    match house.roof {
        Roof::Flat => 1,
        Roof::Gable(_) => 2,
        Roof::Spire => 4,
    }
}

/// Area of one part of the roof, metres squared.
pub fn area(house: &House) -> f64 {
    let (size, rise) = (house.rect.size(), house.top - house.eaves);
    match house.roof {
        Roof::Flat => size.x * size.y,
        Roof::Gable(axis) => size[axis] * (0.5 * size[1 - axis] + EAVES).hypot(rise),
        Roof::Spire => 0.5 * size.x * (0.5 * size.y).hypot(rise),
    }
}

/// The spot of a part of the roof at `u` and `v` from 0 to 1.
pub fn spot(house: &House, style: &Style, slope: usize, [u, v]: [f64; 2]) -> Spot {
    match house.roof {
        Roof::Flat => flat(house, style, [u, v]),
        Roof::Gable(axis) => gable(house, style, axis, slope, [u, v]),
        Roof::Spire => spire(house, slope, [u, v]),
    }
}

fn flat(house: &House, style: &Style, [u, v]: [f64; 2]) -> Spot {
    let at = house.rect.low + house.rect.size() * dvec2(u, v);
    let stain = 1.0 + 0.06 * (0.7 * at.x).sin() * (0.9 * at.y).sin() + 0.04 * (2.9 * at.x + 1.7 * at.y).sin();
    let inside = (at - house.rect.low).min(house.rect.high - at).min_element();
    let (height, albedo, edge) = if inside < 0.3 {
        (house.eaves, dvec3(0.72, 0.70, 0.66), inside.min(0.3 - inside))
    } else {
        (house.eaves - 0.5, style.roof * stain, inside - 0.3)
    };
    let mut spot = Spot::matte(dvec3(at.x, -height, at.y), DVec3::NEG_Y, DVec3::X, albedo);
    spot.limits = [0.6 * edge.max(0.03); 2];
    spot
}

fn gable(house: &House, style: &Style, axis: usize, slope: usize, [u, v]: [f64; 2]) -> Spot {
    let (size, across) = (house.rect.size(), 1 - axis);
    let (run, rise) = (0.5 * size[across], house.top - house.eaves);
    let from_eaves = -EAVES + v * (run + EAVES);
    let mut at = house.rect.low;
    at[axis] += u * size[axis];
    at[across] = if slope == 0 { at[across] + from_eaves } else { house.rect.high[across] - from_eaves };
    let height = house.eaves + rise * from_eaves / run + 0.06;
    let mut normal = dvec3(0.0, -run, 0.0);
    normal[2 * across] = if slope == 0 { -rise } else { rise };
    let mut grain = DVec3::ZERO;
    grain[2 * axis] = 1.0;
    let along = v * (run + EAVES).hypot(rise);
    let row = (along / 0.33).floor();
    let tile = ((row * 12.9898 + (u * size[axis] / 0.25 + 0.5 * row).floor() * 78.233).sin() * 43_758.545).fract();
    let shade = if (along / 0.33).fract() < 0.2 { 0.84 } else { 1.0 };
    let moss = 1.0 + 0.07 * (0.8 * at.x + 0.3 * at.y).sin() * (0.5 * at.y - 0.6 * at.x).sin();
    let mut spot = Spot::matte(dvec3(at.x, -height, at.y), normal.normalize(), grain, 0.0 * grain + style.roof);
    spot.albedo *= (1.0 + 0.10 * tile) * shade * moss;
    let ends = (u.min(1.0 - u) * size[axis]).max(0.03);
    spot.limits = [0.6 * ends, 0.6 * (v.min(1.0 - v) * (run + EAVES)).max(0.05)];
    spot
}

fn spire(house: &House, slope: usize, [u, v]: [f64; 2]) -> Spot {
    let (half, rise) = (0.5 * house.rect.size(), house.top - house.eaves);
    // Even on the triangle.
    let up = 1.0 - (1.0 - v).sqrt();
    let (side, out) = ((2.0 * u - 1.0) * (1.0 - up), 1.0 - up);
    let sign = if slope.is_multiple_of(2) { -1.0 } else { 1.0 };
    let (offset, normal) = if slope < 2 {
        (dvec2(sign * out, side), dvec3(sign * rise, -half.x, 0.0))
    } else {
        (dvec2(side, sign * out), dvec3(0.0, -half.y, sign * rise))
    };
    let at = house.rect.centre() + half * offset;
    let copper = dvec3(0.36, 0.56, 0.48) * if (8.0 * up * rise).sin() > 0.9 { 0.85 } else { 1.0 };
    let point = dvec3(at.x, -(house.eaves + up * rise), at.y);
    let mut spot = Spot::matte(point, normal.normalize(), normal.cross(DVec3::Y), copper);
    spot.limits = [0.6 * ((u.min(1.0 - u)) * 2.0 * half.x * out).max(0.03), 0.4];
    spot
}
