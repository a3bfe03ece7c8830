//! What the stages need of a camera's lens beside rays and footprints: places of directions, rays of bins.

use std::f64::consts::TAU;

use anyhow::Result;
use glam::{DMat2, DVec2, DVec3, Vec3};
use rayon::prelude::*;

use crate::camera::Camera;
use crate::gpu::{Buffer, Device};
use crate::render::fast::BinGrid;
use crate::render::rays::{LensTables, rays, uploaded};
use crate::render::shaders::fast::{BIN_COLUMNS, BIN_ROWS, BLOCK_WIDTH};
use crate::render::shaders::fast_rays::{BIN_RAYS, CELL, CELL_ELEMENTS, CELLS, FAR_REACH, HEAD, NEAR_REACH};

/// The tables of one lens, size of picture and form of blocks, on the device.
pub struct BinTables {
    pub lens: LensTables,
    /// Bounds of the rays, places of directions: `glsl/fast_rays/frame.glsl` has the form.
    pub table: Buffer<[u32; 4]>,
    /// The rays of each block lie well within a half space around its middle, so that a plane before them meets all.
    pub have_planes: bool,
    block_height: u32,
}

impl BinTables {
    /// Makes the tables of a camera with a lens.
    ///
    /// # Errors
    /// If memory runs out, or the camera is a pinhole.
    pub fn new(device: &Device, camera: &Camera, grid: BinGrid) -> Result<Self> {
        let picture = Picture { rays: &rays(camera), camera };
        let lens = LensTables::new(device, camera, picture.rays)?;
        let (middle, spread) = picture.sphere();
        let [width, height] = grid.bin_px();
        let bins: Vec<_> = picture.parts(grid.bins, [width, height]).map(|part| picture.bin_rays(&part)).collect();
        let first_cell = HEAD + BIN_RAYS * grid.count();
        let mut table = vec![
            middle.extend(spread).to_array().map(f32::to_bits),
            [lens.half_sine.to_bits(), lens.widest.to_bits(), camera.is_parallel().into(), first_cell],
        ];
        table.extend(bins.as_flattened());
        table.extend(cells(camera).as_flattened());
        let block_px = [BLOCK_WIDTH, grid.block_height];
        let blocks = [grid.bins[0] * BIN_COLUMNS, grid.bins[1] * BIN_ROWS];
        Ok(Self {
            lens,
            table: uploaded(device, "lens table", &table)?,
            have_planes: picture.parts(blocks, block_px).all(|part| picture.has_plane(&part)),
            block_height: grid.block_height,
        })
    }

    /// True if the tables suit a camera, wherever it stands.
    pub fn suit(&self, camera: &Camera, grid: BinGrid) -> bool {
        self.block_height == grid.block_height && self.lens.suit(camera)
    }

    /// The name and the bytes of every buffer.
    pub fn buffers(&self) -> impl Iterator<Item = (&str, u64)> {
        self.lens.buffers().into_iter().chain([self.table.footprint()])
    }
}

/// The least cosine of the angle between a ray of a block and its middle.
const LEAST_COSINE: f32 = 0.5;

/// The rays of all pixels, row by row.
#[derive(Clone, Copy)]
struct Picture<'p> {
    rays: &'p [[f32; 3]],
    camera: &'p Camera,
}

/// The rays of a part of a picture, each with its place relative to the middle of the part, px.
type Part = Vec<(DVec2, DVec3)>;

impl Picture<'_> {
    /// The parts of a size in px of a picture, in rows.
    fn parts(self, counts: [u32; 2], size_px: [u32; 2]) -> impl IndexedParallelIterator<Item = Part> {
        let [width, height] = self.camera.size_px;
        (0..counts[0] * counts[1]).into_par_iter().map(move |index| {
            let low = [index % counts[0] * size_px[0], index / counts[0] * size_px[1]];
            let middle = DVec2::new(low[0].into(), low[1].into()) + DVec2::from(size_px.map(f64::from)) / 2.0;
            let pixels = (low[1]..(low[1] + size_px[1]).min(height))
                .flat_map(|y| (low[0]..(low[0] + size_px[0]).min(width)).map(move |x| [x, y]));
            let with_place = |[x, y]: [u32; 2]| {
                let ray = self.rays[y as usize * width as usize + x as usize];
                (DVec2::new(x.into(), y.into()) + 0.5 - middle, DVec3::from(ray.map(f64::from)))
            };
            pixels.map(with_place).filter(|(_, ray)| *ray != DVec3::ZERO).collect()
        })
    }

    /// A sphere around the ends of all rays.
    fn sphere(&self) -> (Vec3, f32) {
        let all = || self.rays.iter().copied().map(Vec3::from).filter(|ray| *ray != Vec3::ZERO);
        let Some(low) = all().reduce(Vec3::min) else { return (Vec3::ZERO, f32::NEG_INFINITY) };
        let middle = 0.5 * low + 0.5 * all().fold(low, Vec3::max);
        let spread = all().map(|ray| ray.distance(middle)).fold(0.0, f32::max);
        (middle, spread * 1.0001 + 1e-6)
    }

    /// The middle of the rays of a part, and the normal of the plane through it on which they are made to end.
    fn plane(&self, part: &Part) -> Option<(DVec3, DVec3)> {
        let all = || part.iter().map(|(_, ray)| *ray);
        let low = all().reduce(DVec3::min)?;
        let middle = 0.5 * (low + all().fold(low, DVec3::max));
        let is_parallel = self.camera.is_parallel();
        let normal = if is_parallel { DVec3::Z } else { middle.normalize_or(DVec3::Z) };
        Some((if is_parallel { middle } else { normal }, normal))
    }

    /// True if all rays of a block lie near enough to its middle.
    fn has_plane(&self, part: &Part) -> bool {
        let is_near = |(_, normal): (DVec3, DVec3)| part.iter().all(|(_, ray)| ray.dot(normal) > LEAST_COSINE.into());
        self.plane(part).is_none_or(is_near)
    }

    /// The affine rays of a bin, and the largest distance of a ray from them.
    fn bin_rays(&self, part: &Part) -> [[u32; 4]; BIN_RAYS as usize] {
        let form = |middle: DVec3, spread: f64, along: [DVec3; 2], off: f64| {
            let element = |vector: DVec3, last: f64| vector.extend(last).as_vec4().to_array().map(f32::to_bits);
            [element(middle, spread), element(along[0], off), element(along[1], 0.0)]
        };
        let Some((middle, normal)) = self.plane(part) else {
            return form(DVec3::ZERO, f64::NEG_INFINITY, [DVec3::ZERO; 2], 0.0);
        };
        if part.iter().any(|(_, ray)| ray.dot(normal) < 0.1) {
            return form(middle, f64::INFINITY, [DVec3::ZERO; 2], f64::INFINITY);
        }
        let scaled: Part = part.iter().map(|(place, ray)| (*place, *ray / ray.dot(normal))).collect();
        let (first, along) = fitted(&scaled);
        let spread = scaled.iter().map(|(_, ray)| ray.distance(first)).fold(0.0, f64::max);
        // Two directions across the plane in which distances are measured.
        let across = [normal.any_orthonormal_vector(), normal.cross(normal.any_orthonormal_vector())];
        let on_plane = |vector: DVec3| DVec2::new(vector.dot(across[0]), vector.dot(across[1]));
        let to_px = DMat2::from_cols(on_plane(along[0]), on_plane(along[1])).inverse();
        let off = |(place, ray): &(DVec2, DVec3)| {
            (to_px * on_plane(*ray - first - along[0] * place.x - along[1] * place.y)).abs().max_element()
        };
        let furthest = scaled.iter().map(off).fold(0.0, |a, b| if b.is_finite() { f64::max(a, b) } else { b });
        let off = if furthest.is_finite() { furthest * 1.01 + 1e-3 } else { f64::INFINITY };
        form(first, spread * 1.0001 + 1e-6, along, off)
    }
}

/// The affine map from places to rays with the least squares: the ray of the middle, and derivatives by x and y.
fn fitted(part: &Part) -> (DVec3, [DVec3; 2]) {
    let count = part.len() as f64;
    let (place, ray) = part.iter().fold((DVec2::ZERO, DVec3::ZERO), |sum, (a, b)| (sum.0 + *a, sum.1 + *b));
    let (mean_place, mean_ray) = (place / count, ray / count);
    let (mut squares, mut products) = (DMat2::ZERO, [DVec3::ZERO; 2]);
    for (place, ray) in part {
        let (d, r) = (*place - mean_place, *ray - mean_ray);
        squares += DMat2::from_cols(d * d.x, d * d.y);
        products = [products[0] + r * d.x, products[1] + r * d.y];
    }
    let inverse = squares.inverse();
    let along = [0, 1].map(|axis| products[0] * inverse.col(0)[axis] + products[1] * inverse.col(1)[axis]);
    (mean_ray - along[0] * mean_place.x - along[1] * mean_place.y, along)
}

/// Room for directions between those at which a lens is measured.
const BETWEEN: f64 = 1.1;
const AZIMUTHS: u32 = 16;
/// Cells along the side of a region in which the bend is measured once.
const REGION: u32 = 4;

type Cell = [[u32; 4]; CELL_ELEMENTS as usize];

/// The cells of all faces of the cube.
fn cells(camera: &Camera) -> Vec<Cell> {
    // A parallel lens has no directions.
    let faces = if camera.is_parallel() { 0 } else { 6 };
    let regions = CELLS / REGION;
    let bends_of = |index: u32| {
        let low = DVec2::new((index % regions).into(), (index / regions % regions).into()) / f64::from(regions);
        bends(camera, index / (regions * regions), 2.0 * low - 1.0)
    };
    let bends: Vec<_> = (0..faces * regions * regions).into_par_iter().map(bends_of).collect();
    let cell = |index: u32| {
        let [face, row, column] = [index / (CELLS * CELLS), index / CELLS % CELLS, index % CELLS];
        let middle = (DVec2::new(column.into(), row.into()) + 0.5) * (2.0 / f64::from(CELLS)) - 1.0;
        let bends = bends[((face * regions + row / REGION) * regions + column / REGION) as usize];
        let plane = Plane::around(camera, face, middle);
        // Without a plane, no bend is finite.
        let bends = bends.map(|bend| if plane.is_none() && bend >= 0.0 { f64::INFINITY } else { bend });
        let Plane { px, by, .. } = plane.unwrap_or_default();
        let element = |values: [f64; 4]| values.map(|value| (value as f32).to_bits());
        [element([px.x, px.y, by[0].x, by[0].y]), element([by[1].x, by[1].y, bends[0], bends[1]])]
    };
    (0..faces * CELLS * CELLS).into_par_iter().map(cell).collect()
}

/// The place of a direction of view axes, px.
fn place(camera: &Camera, direction: DVec3) -> Option<DVec2> {
    let plane = camera.lens.as_ref()?.plane(direction)?;
    Some(plane * camera.focal_px + camera.centre_px)
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

/// The places of directions around one, as an affine map of coordinates of a face.
#[derive(Clone, Copy, Default)]
struct Plane {
    at: DVec2,
    px: DVec2,
    by: [DVec2; 2],
}

impl Plane {
    /// `None` where a direction has no place.
    fn around(camera: &Camera, face: u32, at: DVec2) -> Option<Self> {
        let step = 0.25 / f64::from(CELLS);
        let px = |offset: DVec2| place(camera, on_face(face, at + offset));
        let by = |axis: DVec2| Some((px(axis * step)? - px(-axis * step)?) / (2.0 * step));
        Some(Self { at, px: px(DVec2::ZERO)?, by: [by(DVec2::X)?, by(DVec2::Y)?] })
    }

    fn px(&self, at: DVec2) -> DVec2 {
        let offset = at - self.at;
        self.px + offset.x * self.by[0] + offset.y * self.by[1]
    }
}

/// The bends of the cells of a region of a face, whose lowest coordinates are `low`, for near and for far directions:
/// infinite if some direction has no place, negative if none has one.
fn bends(camera: &Camera, face: u32, low: DVec2) -> [f64; 2] {
    let side = 2.0 * f64::from(REGION) / f64::from(CELLS);
    let of_region = [0.0, 0.5, 1.0].map(|y| [0.0, 0.5, 1.0].map(|x| low + side * DVec2::new(x, y)));
    let (mut bends, mut seen, mut unseen) = ([0.0_f64; 2], [0; 2], [0; 2]);
    for at in of_region.into_iter().flatten() {
        // The cell whose corner is here, towards the middle of the face.
        let plane = Plane::around(camera, face, at - at.signum() / f64::from(CELLS));
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
                let exact = place(camera, normal + change);
                seen[reach] += u32::from(exact.is_some());
                let (Some(exact), Some(plane)) = (exact, &plane) else {
                    unseen[reach] += 1;
                    continue;
                };
                let (depth_by, along_by) = of_face(face, change);
                let moved = at + (along_by - along * (depth_by / depth)) / depth.abs();
                let bend = exact.distance(plane.px(moved)) / (BETWEEN * ring + f64::from(CELL)).powi(2);
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
