//! The surroundings of the town: fields to the horizon, woods, and the sky.

use std::f64::consts::TAU;

use glam::{DVec3, dvec3};

use super::splat::{Lighting, Spot};
use crate::scene::Random;

/// Distance of the horizon from the middle of a small town, metres.
const HORIZON: f64 = 4000.0;

/// The extents of the surroundings: half that of the town, and the distance of the horizon.
#[derive(Clone, Copy)]
pub struct Surroundings {
    pub town: f64,
    pub horizon: f64,
}

impl Surroundings {
    pub fn new(town: f64) -> Self {
        Self { town, horizon: HORIZON + 2.0 * town }
    }

    /// Area of the fields, or of the woods on a quarter of them, in units of the distance squared: spacing grows with
    /// the distance.
    pub fn area(self) -> f64 {
        TAU * (self.horizon / self.town).ln()
    }

    /// Area of the sky, metres squared.
    pub fn sky_area(self) -> f64 {
        0.58 * 2.0 * TAU * self.horizon * self.horizon
    }

    /// A place outside of the town and its distance from the middle, by two numbers from 0 to 1.
    fn place(self, [u, v]: [f64; 2]) -> (DVec3, f64) {
        let angle = TAU * u;
        let out = dvec3(angle.cos(), 0.0, angle.sin());
        // From the edge of the square town outwards.
        let edge = self.town / out.x.abs().max(out.z.abs());
        let distance = edge * (self.horizon / edge).powf(v);
        let far = ((distance - edge) / self.horizon).powi(2);
        let hill = 70.0 * far * (0.6 + (3.0 * angle).sin() * 0.5 + 0.4 * (7.0 * angle + 1.0).sin()).max(0.0);
        (out * distance - DVec3::Y * hill, distance)
    }

    pub fn field(self, random: &mut Random, at: [f64; 2]) -> Spot {
        let (point, distance) = self.place(at);
        let field =
            ((point.x / 90.0 + 0.2 * (point.z / 70.0).floor()).floor() * 7.3 + (point.z / 70.0).floor() * 3.1).sin();
        let soil = dvec3(0.50, 0.47, 0.26).lerp(dvec3(0.33, 0.44, 0.19), 0.5 + 0.5 * field);
        let albedo = self.in_haze(soil * (1.0 + 0.05 * random.normal()), distance);
        let mut spot = Spot::matte(point, DVec3::NEG_Y, random.direction(), albedo);
        spot.shape = dvec3(1.7, 1.5, 0.05) * distance;
        spot.lighting = Lighting::Unlit;
        spot
    }

    pub fn wood(self, random: &mut Random, [u, v]: [f64; 2]) -> Spot {
        // In patches: the angle is drawn towards a few directions.
        let angle = u + 0.013 * (TAU * 17.0 * u).sin() + 0.02 * (TAU * 5.0 * u + 9.0 * v).sin();
        let (point, distance) = self.place([angle, 0.15 + 0.85 * v]);
        let leaf = dvec3(0.20, 0.32, 0.13) * (1.0 + 0.25 * random.normal());
        let height = (5.0 + 0.006 * distance) * random.unit();
        let albedo = self.in_haze(leaf * (0.7 + 0.3 * height / (5.0 + 0.006 * distance)), distance);
        let mut spot = Spot::matte(point - DVec3::Y * height, random.direction(), random.direction(), albedo);
        spot.shape = dvec3(0.5, 0.4, 0.2) * distance;
        spot.lighting = Lighting::Unlit;
        spot
    }

    /// A dome with clouds, bright at the horizon.
    pub fn sky(self, random: &mut Random, [u, v]: [f64; 2]) -> Spot {
        // Even on the sphere, from a little below the horizon upwards.
        let (up, angle) = (1.08 * v - 0.08, TAU * u);
        let side = (1.0 - up * up).max(0.0).sqrt();
        let direction = dvec3(side * angle.cos(), -up, side * angle.sin());
        let blue = dvec3(0.80, 0.87, 0.93).lerp(dvec3(0.27, 0.48, 0.80), up.max(0.0).powf(0.55));
        // Clouds on a plane above.
        let plane = direction / (up.max(0.0) + 0.12);
        let wave = |x: f64, z: f64, phase: f64| (x * plane.x + z * plane.z + phase).sin();
        let cloud = wave(1.3, 0.7, 0.0) * wave(-0.6, 1.9, 1.0)
            + 0.5 * wave(3.1, -2.3, 2.0) * wave(2.2, 3.7, 0.5)
            + 0.25 * wave(7.3, 5.1, 0.3) * wave(-5.9, 8.3, 1.7);
        let cover = ((cloud - 0.12) / 0.7).clamp(0.0, 1.0) * (up / 0.08).clamp(0.0, 1.0);
        let tone = blue.lerp(dvec3(0.96, 0.96, 0.97), 0.85 * cover) * (1.0 + 0.004 * random.normal());
        let mut spot =
            Spot::matte(direction * self.horizon * (1.15 + 0.05 * random.unit()), -direction, DVec3::X, tone);
        spot.grain = random.direction();
        spot.shape = dvec3(1.9, 1.7, 0.05);
        spot.lighting = Lighting::Unlit;
        spot.gloss = 0.0;
        spot
    }

    /// A colour at this distance: half of it is haze at 800 metres beyond the town.
    fn in_haze(self, albedo: DVec3, distance: f64) -> DVec3 {
        dvec3(0.76, 0.82, 0.88).lerp(albedo, 0.5_f64.powf((distance - self.town).max(0.0) / 800.0))
    }
}
