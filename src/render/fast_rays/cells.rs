//! The cells of directions of a lens: where directions are on the picture, and how far from there.

use std::f64::consts::TAU;
use std::sync::{Arc, Mutex, PoisonError};

use anyhow::Result;
use glam::{DVec2, DVec3};
use rayon::prelude::*;

use crate::camera::Lens;
use crate::gpu::{Buffer, Device};
use crate::render::rays::uploaded;
use crate::render::shaders::fast_rays::{CELL, CELL_ELEMENTS, CELLS, FAR_REACH, NEAR_REACH};

/// The cells of a lens on the device, for all focal lengths and sizes of picture.
pub struct LensCells {
    lens: Arc<Lens>,
    /// `glsl/fast_rays/frame.glsl` has the form.
    pub cells: Buffer<[u32; 4]>,
}

impl LensCells {
    /// Uploads the cells of a lens, unless `kept` has them.
    ///
    /// # Errors
    /// If memory runs out.
    pub fn new(device: &Device, lens: &Arc<Lens>, kept: Option<Self>) -> Result<Self> {
        if let Some(kept) = kept.filter(|kept| kept.lens == *lens) {
            return Ok(kept);
        }
        Ok(Self { lens: lens.clone(), cells: uploaded(device, "cells of directions", known(lens).as_flattened())? })
    }
}

/// The lenses whose cells the host keeps, of 12 MB each: all renderers of a process share them.
const KEPT: usize = 6;

/// The cells of a lens: those of the lenses used last are kept, since making them takes seconds of processor time.
fn known(lens: &Arc<Lens>) -> Arc<[Cell]> {
    type Known = Vec<(Arc<Lens>, Arc<[Cell]>)>;
    static LAST: Mutex<Known> = Mutex::new(Vec::new());
    let last = || LAST.lock().unwrap_or_else(PoisonError::into_inner);
    let found = last().iter().find(|(of, _)| of == lens).map(|(_, cells)| cells.clone());
    // The lock is not held meanwhile: the threads that make the cells may take up other work, which needs it.
    let cells = found.unwrap_or_else(|| cells(lens).into());
    let mut last = last();
    last.retain(|(of, _)| of != lens);
    last.truncate(KEPT - 1);
    last.insert(0, (lens.clone(), cells.clone()));
    cells
}

/// Room for directions between those at which a lens is measured.
const BETWEEN: f64 = 1.1;
const AZIMUTHS: u32 = 16;
/// Cells along the side of a region in which the bend is measured once.
const REGION: u32 = 4;

type Cell = [[u32; 4]; CELL_ELEMENTS as usize];

/// The cells of all faces of the cube.
fn cells(lens: &Lens) -> Vec<Cell> {
    // A parallel lens has no directions.
    let faces = if lens.is_parallel() { 0 } else { 6 };
    let regions = CELLS / REGION;
    let bends_of = |index: u32| {
        let low = DVec2::new((index % regions).into(), (index / regions % regions).into()) / f64::from(regions);
        bends(lens, index / (regions * regions), 2.0 * low - 1.0)
    };
    let bends: Vec<_> = (0..faces * regions * regions).into_par_iter().map(bends_of).collect();
    let cell = |index: u32| {
        let [face, row, column] = [index / (CELLS * CELLS), index / CELLS % CELLS, index % CELLS];
        let middle = (DVec2::new(column.into(), row.into()) + 0.5) * (2.0 / f64::from(CELLS)) - 1.0;
        let bends = bends[((face * regions + row / REGION) * regions + column / REGION) as usize];
        let plane = Plane::around(lens, face, middle);
        // Without a plane, no bend is finite.
        let bends = bends.map(|bend| if plane.is_none() && bend >= 0.0 { f64::INFINITY } else { bend });
        let Plane { place, by, .. } = plane.unwrap_or_default();
        let element = |values: [f64; 4]| values.map(|value| (value as f32).to_bits());
        [element([place.x, place.y, by[0].x, by[0].y]), element([by[1].x, by[1].y, bends[0], bends[1]])]
    };
    (0..faces * CELLS * CELLS).into_par_iter().map(cell).collect()
}

/// A direction of a face, at coordinates from -1 to 1.
fn on_face(face: u32, at: DVec2) -> DVec3 {
    let ahead = if face.is_multiple_of(2) { 1.0 } else { -1.0 };
    match face / 2 {
        0 => DVec3::new(ahead, at.x, at.y),
        1 => DVec3::new(at.y, ahead, at.x),
        _ => DVec3::new(at.x, at.y, ahead),
    }
}

/// The plane coordinates of directions around one, as an affine map of coordinates of a face.
#[derive(Clone, Copy, Default)]
struct Plane {
    at: DVec2,
    place: DVec2,
    by: [DVec2; 2],
}

impl Plane {
    /// `None` where a direction has no place.
    fn around(lens: &Lens, face: u32, at: DVec2) -> Option<Self> {
        let step = 0.25 / f64::from(CELLS);
        let place = |offset: DVec2| lens.plane(on_face(face, at + offset));
        let by = |axis: DVec2| Some((place(axis * step)? - place(-axis * step)?) / (2.0 * step));
        Some(Self { at, place: place(DVec2::ZERO)?, by: [by(DVec2::X)?, by(DVec2::Y)?] })
    }

    fn place(&self, at: DVec2) -> DVec2 {
        let offset = at - self.at;
        self.place + offset.x * self.by[0] + offset.y * self.by[1]
    }
}

/// The bends of the cells of a region of a face, whose lowest coordinates are `low`, for near and for far directions:
/// infinite if some direction has no place, negative if none has one.
fn bends(lens: &Lens, face: u32, low: DVec2) -> [f64; 2] {
    let side = 2.0 * f64::from(REGION) / f64::from(CELLS);
    let of_region = [0.0, 0.5, 1.0].map(|y| [0.0, 0.5, 1.0].map(|x| low + side * DVec2::new(x, y)));
    let (mut bends, mut seen, mut unseen) = ([0.0_f64; 2], [0; 2], [0; 2]);
    for at in of_region.into_iter().flatten() {
        // The cell whose corner is here, towards the middle of the face.
        let plane = Plane::around(lens, face, at - at.signum() / f64::from(CELLS));
        let normal = on_face(face, at).normalize();
        let across = [normal.any_orthonormal_vector(), normal.cross(normal.any_orthonormal_vector())];
        // The coordinates of the face change with the direction by their derivative here.
        let (depth, along) = of_face(face, normal);
        let rings = [0.3, 0.6, 1.0].map(|ring| (0, ring * f64::from(NEAR_REACH)));
        let far_rings = [0.6, 1.0].map(|ring| (1, ring * f64::from(FAR_REACH)));
        for (reach, ring) in rings.into_iter().chain(far_rings) {
            for azimuth in 0..AZIMUTHS {
                let turn = DVec2::from_angle(TAU * f64::from(azimuth) / f64::from(AZIMUTHS));
                let change = BETWEEN * ring * (across[0] * turn.x + across[1] * turn.y);
                let exact = lens.plane(normal + change);
                seen[reach] += u32::from(exact.is_some());
                let (Some(exact), Some(plane)) = (exact, &plane) else {
                    unseen[reach] += 1;
                    continue;
                };
                let (depth_by, along_by) = of_face(face, change);
                let moved = at + (along_by - along * (depth_by / depth)) / depth.abs();
                let bend = exact.distance(plane.place(moved)) / (BETWEEN * ring + f64::from(CELL)).powi(2);
                bends[reach] = bends[reach].max(bend);
            }
        }
    }
    // Directions that are near are far ones, too.
    let of_reach = |reach: usize| match (seen[..=reach].iter().sum::<u32>(), unseen[..=reach].iter().sum::<u32>()) {
        (0, _) => -1.0,
        (_, 0) => BETWEEN * bends[..=reach].iter().copied().fold(0.0, f64::max),
        _ => f64::INFINITY,
    };
    [of_reach(0), of_reach(1)]
}

/// The component of a vector along the axis of a face, and the others, in the order of its coordinates.
fn of_face(face: u32, vector: DVec3) -> (f64, DVec2) {
    let DVec3 { x, y, z } = vector;
    match face / 2 {
        0 => (x, DVec2::new(y, z)),
        1 => (y, DVec2::new(z, x)),
        _ => (z, DVec2::new(x, y)),
    }
}
