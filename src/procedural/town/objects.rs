//! Objects: trees, cars, lamps, and boxes such as chimneys and market stalls.

use std::f64::consts::TAU;

use glam::{DVec2, DVec3, dvec2, dvec3};

use super::layout::{Tree, dice};
use super::splat::Spot;
use crate::scene::Random;

/// A box with faces along the axes, `heading` or its opposite is its long side.
#[derive(Clone, Copy)]
pub struct Cuboid {
    /// The middle of its lower side.
    pub foot: DVec3,
    /// Half of its length along x and z, and its height.
    pub half: DVec2,
    pub height: f64,
    pub colour: DVec3,
    pub top: DVec3,
}

impl Cuboid {
    pub fn area(&self) -> f64 {
        4.0 * self.height * (self.half.x + self.half.y) + 4.0 * self.half.x * self.half.y
    }

    /// The point of the surface at `u` and `v` from 0 to 1.
    pub fn spot(&self, u: f64, v: f64) -> Spot {
        let [x, z, h] = [self.half.x, self.half.y, self.height];
        let areas = [4.0 * x * z, 2.0 * x * h, 2.0 * x * h, 2.0 * z * h, 2.0 * z * h];
        let mut rest = u * areas.iter().sum::<f64>();
        let face = areas[..4].iter().position(|area| {
            let is_here = rest < *area;
            rest -= if is_here { 0.0 } else { *area };
            is_here
        });
        let face = face.unwrap_or(4);
        let (along, up) = ((rest / areas[face]).clamp(0.0, 1.0) * 2.0 - 1.0, v);
        let (offset, normal, size) = match face {
            0 => (dvec3(along * x, -h, (2.0 * v - 1.0) * z), dvec3(0.0, -1.0, 0.0), [2.0 * x, 2.0 * z]),
            1 => (dvec3(along * x, -h * up, -z), dvec3(0.0, 0.0, -1.0), [2.0 * x, h]),
            2 => (dvec3(along * x, -h * up, z), dvec3(0.0, 0.0, 1.0), [2.0 * x, h]),
            3 => (dvec3(-x, -h * up, along * z), dvec3(-1.0, 0.0, 0.0), [2.0 * z, h]),
            _ => (dvec3(x, -h * up, along * z), dvec3(1.0, 0.0, 0.0), [2.0 * z, h]),
        };
        let grain = if face == 0 || face == 1 || face == 2 { DVec3::X } else { DVec3::Z };
        let colour = if face == 0 { self.top } else { self.colour };
        let mut spot = Spot::matte(self.foot + offset, normal, grain, colour);
        let edge = |t: f64, size: f64| 0.6 * (t.min(1.0 - t) * size).max(0.02);
        spot.depth = 0.3 * x.min(z).min(h);
        spot.limits = [edge(0.5 + 0.5 * along, size[0]), edge(v, size[1])];
        spot
    }
}

/// A crown of leaves in clumps, above a trunk.
pub fn tree(tree: &Tree, random: &mut Random, [u, v]: [f64; 2]) -> Spot {
    let foot = dvec3(tree.at.x, -0.1, tree.at.y);
    if u < 0.07 {
        let angle = TAU * v;
        let out = dvec3(angle.cos(), 0.0, angle.sin());
        let height = (tree.height - 0.4 * tree.radius) * u / 0.07;
        let point = foot + out * 0.12 * (1.3 - 0.5 * u / 0.07) - DVec3::Y * height;
        let bark = dvec3(0.30, 0.25, 0.20) * (0.9 + 0.2 * (9.0 * angle).sin().abs());
        return Spot { limits: [0.3, 0.06], ..Spot::matte(point, out, DVec3::Y, bark) };
    }
    let number = (random.unit() * 40.0) as usize;
    let mut clump = dice(tree.seed * 64 + number + (1 << 34));
    let centre = clump.direction() * dvec3(0.72, 0.80, 0.72) * clump.unit().cbrt();
    let tone = 0.82 + 0.36 * clump.unit();
    let out = random.direction();
    let at = centre + 0.34 * out * random.unit().powf(0.25);
    let point = foot - DVec3::Y * tree.height + tree.radius * at;
    let normal = (out + 0.7 * random.direction()).normalize_or(DVec3::NEG_Y);
    // The inside of the crown is dark.
    let depth = 0.45 + 0.6 * at.length().min(1.1);
    let warm = dice(tree.seed).unit();
    let leaf = dvec3(0.24, 0.40, 0.13).lerp(dvec3(0.36, 0.42, 0.14), warm) * tone * depth;
    let mut spot = Spot::matte(point, normal, random.direction(), leaf * (1.0 + 0.12 * random.normal()));
    spot.shape = dvec3(0.95, 0.6, 0.10);
    spot
}

/// Area of the splats of a tree, metres squared.
pub fn tree_area(tree: &Tree) -> f64 {
    9.0 * tree.radius * tree.radius
}

/// A parked car.
#[derive(Clone, Copy)]
pub struct Car {
    pub at: DVec2,
    /// Parked along z instead of x.
    pub is_along_z: bool,
    pub paint: DVec3,
}

const PAINTS: [DVec3; 7] = [
    dvec3(0.70, 0.71, 0.72),
    dvec3(0.13, 0.14, 0.16),
    dvec3(0.55, 0.09, 0.08),
    dvec3(0.12, 0.23, 0.45),
    dvec3(0.88, 0.88, 0.86),
    dvec3(0.36, 0.38, 0.40),
    dvec3(0.66, 0.50, 0.16),
];

/// Area of the surface of a car, metres squared.
pub const CAR_AREA: f64 = 27.0;

/// The outline of a car from its rear to its front, and of its cabin: metres along it and above the road.
const OUTLINE: [[f64; 2]; 10] = [
    [-2.10, 0.35],
    [-2.12, 0.80],
    [-2.00, 0.95],
    [-1.55, 1.02],
    [-1.05, 1.44],
    [0.25, 1.46],
    [0.95, 1.00],
    [1.85, 0.86],
    [2.10, 0.70],
    [2.10, 0.35],
];

impl Car {
    pub fn new(at: DVec2, is_along_z: bool, random: &mut Random) -> Self {
        Self { at, is_along_z, paint: PAINTS[(random.unit() * 7.0) as usize] }
    }

    pub fn spot(&self, [u, v]: [f64; 2]) -> Spot {
        // The upper side and the ends follow the outline; the flanks fill it; the wheels stand before them.
        let (local, normal, albedo, gloss) = match u {
            u if u < 0.5 => self.shell(u / 0.5, v),
            u if u < 0.9 => self.flank((u - 0.5) / 0.4, v),
            u => wheel((u - 0.9) / 0.1, v),
        };
        let turned = |p: DVec3| if self.is_along_z { dvec3(-p.z, p.y, p.x) } else { p };
        let foot = dvec3(self.at.x, 0.0, self.at.y);
        let mut spot = Spot::matte(foot + turned(local), turned(normal), turned(DVec3::X), albedo);
        spot.limits = [0.25, 0.12];
        spot.depth = 0.25;
        spot.gloss = gloss;
        spot
    }

    fn shell(&self, along: f64, v: f64) -> (DVec3, DVec3, DVec3, f64) {
        let at = along * (OUTLINE.len() - 1) as f64;
        let k = (at as usize).min(OUTLINE.len() - 2);
        let [from, to] = [OUTLINE[k], OUTLINE[k + 1]].map(DVec2::from_array);
        let here = from.lerp(to, at - k as f64);
        let slope = (to - from).normalize();
        let width = half_width(here.y) * (2.0 * v - 1.0);
        let is_glass = (k == 3 || k == 5) && here.y > 1.06;
        let normal = dvec3(-slope.y, -slope.x, 0.0);
        let (albedo, gloss) = if is_glass { (GLASS, 0.5) } else { (self.paint, 0.3) };
        (dvec3(here.x, -here.y, width), normal, albedo, gloss)
    }

    fn flank(&self, along: f64, v: f64) -> (DVec3, DVec3, DVec3, f64) {
        let side = if along < 0.5 { -1.0 } else { 1.0 };
        let x = -2.1 + 4.2 * (2.0 * along).fract();
        let k = OUTLINE[1..9].windows(2).position(|pair| x <= pair[1][0]).unwrap_or(7) + 1;
        let [from, to] = [OUTLINE[k], OUTLINE[(k + 1).min(9)]];
        let t = if to[0] > from[0] { ((x - from[0]) / (to[0] - from[0])).clamp(0.0, 1.0) } else { 0.0 };
        let roof = from[1] + t * (to[1] - from[1]);
        let height = 0.28 + v * (roof - 0.28);
        let is_glass = height > 1.0 && height < roof - 0.05 && (x + 0.35).abs() > 0.05;
        let seam = if height < 0.95 && ((x + 0.35).abs() - 0.9).abs() < 0.015 { 0.6 } else { 1.0 };
        let sill = if height < 0.36 { 0.35 } else { 1.0 };
        let (albedo, gloss) = if is_glass { (GLASS, 0.5) } else { (self.paint * seam * sill, 0.3) };
        (dvec3(x, -height, side * half_width(height)), dvec3(0.0, -0.2, side).normalize(), albedo, gloss)
    }
}

const GLASS: DVec3 = dvec3(0.14, 0.17, 0.20);

fn half_width(height: f64) -> f64 {
    0.86 - 0.34 * (height - 0.95).max(0.0)
}

fn wheel(u: f64, v: f64) -> (DVec3, DVec3, DVec3, f64) {
    let number = (u * 4.0).floor();
    let (side, x) = (if number % 2.0 < 1.0 { -1.0 } else { 1.0 }, if number < 2.0 { -1.3 } else { 1.32 });
    let (angle, radius) = (TAU * (4.0 * u).fract(), 0.33 * v.sqrt());
    let albedo = if radius < 0.2 { dvec3(0.55, 0.56, 0.58) } else { dvec3(0.06, 0.06, 0.07) };
    let point = dvec3(x + radius * angle.cos(), -0.33 - radius * angle.sin(), side * 0.88);
    (point, dvec3(0.0, 0.0, side), albedo, 0.1)
}

/// A street lamp on a post.
pub fn lamp(at: DVec2, [u, v]: [f64; 2]) -> Spot {
    let angle = TAU * v;
    let out = dvec3(angle.cos(), 0.0, angle.sin());
    let foot = dvec3(at.x, -0.12, at.y);
    let height = 4.6 * u / 0.75;
    if u < 0.75 {
        let dark = dvec3(0.13, 0.16, 0.15);
        let radius = if height < 0.7 { 0.09 } else { 0.05 };
        let point = foot + radius * out - DVec3::Y * height;
        return Spot { limits: [0.3, 0.03], ..Spot::matte(point, out, DVec3::Y, dark) };
    }
    let t = (u - 0.75) * 4.0;
    let ball = dvec2((t * 0.5 * TAU).sin(), (t * 0.5 * TAU).cos());
    let normal = out * ball.x - DVec3::Y * ball.y;
    let point = foot - DVec3::Y * 4.75 + 0.2 * normal;
    Spot { limits: [0.08; 2], ..Spot::matte(point, normal, DVec3::Y, dvec3(0.93, 0.91, 0.84)) }
}

/// Area of the surface of a lamp, metres squared.
pub const LAMP_AREA: f64 = 2.2;
