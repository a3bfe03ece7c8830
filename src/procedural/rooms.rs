//! Seeded procedural scenes that surround the camera: a furnished room and a plain with a horizon.
//!
//! In the room most Gaussians are hidden: behind furniture, in it, and outside. On the plain nearly all that lie ahead
//! are in view, and most of them are a few pixels large. Up is -y.

use std::f64::consts::TAU;
use std::ops::Range;

use glam::{DVec3, dvec3};

use super::cactus::{Part, Patch, fill_parts};
use crate::host_memory::OutOfMemory;
use crate::scene::Random;
use crate::scene::{Gaussians, LoadReport};

/// Half the extent of the room in world units (metres): 9 by 2.8 by 7.
const ROOM: DVec3 = dvec3(4.5, 1.4, 3.5);

const ROOM_PARTS: [Part; 4] = [
    Part { share: 0.40, area: 215.0, faint: 0.30, gloss: 0.10, sample: shell },
    Part { share: 0.42, area: 120.0, faint: 0.30, gloss: 0.20, sample: furniture },
    Part { share: 0.15, area: 900.0, faint: 0.40, gloss: 0.0, sample: garden },
    Part { share: 0.03, area: 20.0, faint: 1.0, gloss: 0.0, sample: dust },
];

/// The distances from the middle of the plain to its nearest grass and to its horizon, world units.
const PLAIN: [f64; 2] = [2.0, 800.0];

const PLAIN_PARTS: [Part; 3] = [
    // The spacing grows with the distance: 2 pi ln(800 / 2) is the area in units of the distance squared.
    Part { share: 0.55, area: 37.6, faint: 0.30, gloss: 0.05, sample: ground },
    Part { share: 0.35, area: 12.0, faint: 0.25, gloss: 0.05, sample: grass },
    Part { share: 0.10, area: 7.0e6, faint: 0.40, gloss: 0.0, sample: sky },
];

/// The Gaussians of a range of the room with `count` Gaussians. The same count gives the same scene on every machine.
///
/// # Errors
/// [`OutOfMemory`] if they cannot be allocated.
pub fn room(count: usize, range: Range<usize>) -> Result<(Gaussians, LoadReport), OutOfMemory> {
    fill_parts(&ROOM_PARTS, count, range, |_| 1.0)
}

/// The Gaussians of a range of the plain with `count` Gaussians. The same count gives the same scene on every machine.
///
/// # Errors
/// [`OutOfMemory`] if they cannot be allocated.
pub fn plain(count: usize, range: Range<usize>) -> Result<(Gaussians, LoadReport), OutOfMemory> {
    fill_parts(&PLAIN_PARTS, count, range, |_| 1.0)
}

/// How rough surfaces are, world units. On an exact plane that a camera faces, depths would be equal but for rounding,
/// and with them the order of splats undefined.
const ROUGHNESS: f64 = 0.004;

/// A point on the inside or outside of a box around the origin, and the normal there. `inward`: 1 or -1.
fn on_box(random: &mut Random, half: DVec3, inward: f64) -> (DVec3, DVec3) {
    let areas = [half.y * half.z, half.x * half.z, half.x * half.y];
    let pick = random.unit() * areas.iter().sum::<f64>();
    let axis = if pick < areas[0] {
        0
    } else if pick < areas[0] + areas[1] {
        1
    } else {
        2
    };
    let side = if random.unit() < 0.5 { -1.0 } else { 1.0 };
    let mut at = dvec3(random.unit(), random.unit(), random.unit()) * 2.0 - 1.0;
    at[axis] = side;
    let mut normal = DVec3::ZERO;
    normal[axis] = -side * inward;
    (at * half, normal)
}

/// Floor of planks, papered walls with windows, a white ceiling.
fn shell(random: &mut Random) -> Patch {
    let mut found = on_box(random, ROOM, 1.0);
    while is_window(found.0) {
        found = on_box(random, ROOM, 1.0);
    }
    let (point, normal) = found;
    let albedo = if normal.y < 0.0 {
        let plank = (point.z / 0.18).floor();
        dvec3(0.52, 0.36, 0.22) * (0.85 + 0.15 * (plank * 12.9898).sin()) * (0.95 + 0.05 * (point.x * 30.0).sin())
    } else if normal.y > 0.0 {
        dvec3(0.92, 0.91, 0.88)
    } else {
        let stripe = ((point.x + point.z) * 14.0).sin();
        dvec3(0.74, 0.70, 0.58).lerp(dvec3(0.60, 0.66, 0.58), 0.5 + 0.5 * stripe.signum() * stripe.abs().sqrt())
    };
    let grain = if normal.y.abs() > 0.5 { DVec3::X } else { DVec3::Y };
    let point = point + ROUGHNESS * random.normal() * normal;
    Patch { point, normal, grain, albedo, shape: dvec3(1.4, 0.7, 0.08), is_lit: true }
}

/// Two windows in each long wall.
fn is_window(point: DVec3) -> bool {
    point.z.abs() > 0.999 * ROOM.z && (point.x.abs() - 2.2).abs() < 0.7 && (point.y + 0.2).abs() < 0.7
}

/// Cupboards along the walls, tables and boxes between them: each a box on the floor.
fn furniture(random: &mut Random) -> Patch {
    const PIECES: usize = 34;
    let number = (random.unit() * PIECES as f64) as usize;
    let mut piece = Random::of((1 << 31) + number); // beyond the Gaussians
    let half = dvec3(0.2 + 0.5 * piece.unit(), 0.15 + 0.6 * piece.unit().powi(2), 0.2 + 0.4 * piece.unit());
    let angle = TAU * number as f64 / PIECES as f64;
    // Nothing stands in the middle, where the camera is.
    let away = 0.45 + 0.5 * piece.unit();
    let place = dvec3(angle.cos() * away * (ROOM.x - half.x), 0.0, angle.sin() * away * (ROOM.z - half.z));
    let colour = dvec3(0.25, 0.2, 0.15) + 0.5 * dvec3(piece.unit(), piece.unit(), piece.unit());
    let (on, normal) = on_box(random, half, -1.0);
    let shelf = if normal.y == 0.0 && (on.y / 0.16).rem_euclid(1.0) < 0.12 { 0.5 } else { 1.0 };
    Patch {
        point: place + on + DVec3::Y * (ROOM.y - half.y) + ROUGHNESS * random.normal() * normal,
        normal,
        grain: if normal.y == 0.0 { DVec3::Y } else { DVec3::X },
        albedo: colour * shelf * (1.0 + 0.05 * random.normal()),
        shape: dvec3(1.2, 0.7, 0.1),
        is_lit: true,
    }
}

/// Leaves and sky outside, seen through the windows.
fn garden(random: &mut Random) -> Patch {
    let angle = TAU * random.unit();
    let out = dvec3(angle.cos(), 0.0, angle.sin());
    let height = 6.0 * random.unit() - 4.6;
    let leaf = dvec3(0.20, 0.38, 0.14) * (1.0 + 0.35 * random.normal());
    Patch {
        point: out * (9.0 + 6.0 * random.unit()) + DVec3::Y * height,
        normal: -out,
        grain: random.direction(),
        albedo: if height < -2.5 { dvec3(0.70, 0.80, 0.92) } else { leaf },
        shape: dvec3(1.6, 1.1, 0.3),
        is_lit: false,
    }
}

/// Stray splats in the air of the room.
fn dust(random: &mut Random) -> Patch {
    let at = dvec3(random.unit(), random.unit(), random.unit()) * 2.0 - 1.0;
    Patch {
        point: 0.95 * at * ROOM,
        normal: random.direction(),
        grain: random.direction(),
        albedo: dvec3(0.6, 0.58, 0.55),
        shape: dvec3(0.25, 0.12, 0.03),
        is_lit: false,
    }
}

/// A place on the plain and its distance from the middle. There are as many between 2 and 4 as between 4 and 8.
fn place_on_plain(random: &mut Random) -> (DVec3, f64) {
    let angle = TAU * random.unit();
    let distance = PLAIN[0] * (PLAIN[1] / PLAIN[0]).powf(random.unit());
    let hill = (distance / PLAIN[1]) * 30.0 * (3.0 * angle).sin() * (distance / 130.0).sin();
    (dvec3(distance * angle.cos(), hill, distance * angle.sin()), distance)
}

fn ground(random: &mut Random) -> Patch {
    let (point, distance) = place_on_plain(random);
    let field = ((point.x / 60.0).floor() * 7.3 + (point.z / 45.0).floor() * 3.1).sin();
    let soil = dvec3(0.42, 0.36, 0.20).lerp(dvec3(0.34, 0.44, 0.18), 0.5 + 0.5 * field);
    Patch {
        point,
        normal: -DVec3::Y,
        grain: random.direction(),
        albedo: in_haze(soil * (1.0 + 0.1 * random.normal()), distance),
        shape: dvec3(1.2, 0.9, 0.1) * distance,
        is_lit: true,
    }
}

/// Blades that stand on the ground.
fn grass(random: &mut Random) -> Patch {
    let (point, distance) = place_on_plain(random);
    let up = (-DVec3::Y + 0.3 * random.direction()).normalize();
    Patch {
        point: point - DVec3::Y * 0.002 * distance * random.unit(),
        normal: up.any_orthonormal_vector(),
        grain: up,
        albedo: in_haze(dvec3(0.30, 0.45, 0.16) * (1.0 + 0.25 * random.normal()), distance),
        shape: dvec3(2.0, 0.35, 0.2) * distance,
        is_lit: true,
    }
}

/// A dome beyond the horizon, bright there and blue above.
fn sky(random: &mut Random) -> Patch {
    let direction = random.direction();
    let direction = dvec3(direction.x, -direction.y.abs() + 0.05, direction.z).normalize();
    let tone = dvec3(0.88, 0.90, 0.92).lerp(dvec3(0.36, 0.55, 0.82), (-direction.y).max(0.0).sqrt());
    Patch {
        point: direction * (1.2 + 0.1 * random.unit()) * PLAIN[1],
        normal: -direction,
        grain: random.direction(),
        albedo: tone * (1.0 + 0.01 * random.normal()),
        shape: dvec3(2.0, 1.8, 0.1),
        is_lit: false,
    }
}

/// A colour at this distance: half of it is haze at 400.
fn in_haze(albedo: DVec3, distance: f64) -> DVec3 {
    dvec3(0.80, 0.84, 0.88).lerp(albedo, 0.5_f64.powf(distance / 400.0))
}
