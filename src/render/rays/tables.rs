//! What the stages need of a camera's lens: rays of pixels, cones of tiles, footprints of directions.

use std::f64::consts::FRAC_PI_2;

use anyhow::{Context, Result};
use glam::{DVec2, DVec3, Vec3};
use rayon::prelude::*;

use crate::camera::{Camera, Footprints};
use crate::gpu::{Buffer, Commands, Device, Element};
use crate::render::band::Band;
use crate::render::shaders::Cone;
use crate::render::shaders::rays::{EVERYWHERE, FOOTPRINTS, NO_TILE};
use crate::rules::TILE;

/// The rays of the pixels of a band and the footprints of directions of one lens and size of picture, on the device.
pub struct LensTables {
    /// The camera that they were made for; only lens, focal lengths, principal point and size matter.
    camera: Camera,
    band: Band,
    /// The ray of each pixel of the band in view axes, 0 where there is none.
    pub rays: Buffer<[f32; 3]>,
    pub footprints: LensFootprints,
}

/// The footprints of directions of one lens and size of picture, on the device.
pub struct LensFootprints {
    /// By angle and azimuth: variance away from the axis, covariance, variance around it.
    pub table: Buffer<[f32; 3]>,
    /// The sine of half the angle of the last row.
    pub half_sine: f32,
    /// The root of the largest sum of both variances.
    pub widest: f32,
}

impl LensTables {
    /// Makes the tables of a camera with a lens from the [`rays`] of the pixels of a band. `kept` may have parts.
    ///
    /// # Errors
    /// If memory runs out, or the camera is a pinhole.
    pub fn new(
        device: &Device,
        (camera, band): (&Camera, Band),
        rays: &[[f32; 3]],
        kept: Option<Self>,
    ) -> Result<Self> {
        let known = kept.filter(|kept| kept.are_of_lens(camera)).map(|kept| kept.footprints);
        let footprints = known.map_or_else(|| LensFootprints::new(device, camera), Ok)?;
        Ok(Self { camera: camera.clone(), band, rays: uploaded(device, "rays of pixels", rays)?, footprints })
    }

    /// True if the tables suit a band of the pictures of a camera, wherever it stands.
    pub fn suit(&self, camera: &Camera, band: Band) -> bool {
        self.band == band && self.are_of_lens(camera)
    }

    /// True if they are of a band of the pictures of a camera, wherever it stands.
    pub fn are_of_lens(&self, camera: &Camera) -> bool {
        let Camera { focal_px, centre_px, size_px, lens, .. } = &self.camera;
        (focal_px, centre_px, size_px, lens) == (&camera.focal_px, &camera.centre_px, &camera.size_px, &camera.lens)
    }

    /// The name and the bytes of every buffer.
    pub fn buffers(&self) -> [(&str, u64); 2] {
        [self.rays.footprint(), self.footprints.table.footprint()]
    }
}

impl LensFootprints {
    fn new(device: &Device, camera: &Camera) -> Result<Self> {
        let of = Footprints::of(camera).context("a pinhole needs no rays")?;
        let table = footprints(&of);
        let widest = table.iter().map(|[along, _, across]| along + across).fold(0.0, f32::max).sqrt();
        let table = uploaded(device, "footprints", &table)?;
        Ok(Self { table, half_sine: half_sine(of.limit()) as f32, widest })
    }
}

/// The tables of the rays path for a band of one lens and size of picture, on the device.
pub struct RayTables {
    pub lens: LensTables,
    /// The tree of cones.
    pub cones: Buffer<Cone>,
    /// The chord beyond which a subgroup shares a splat: some tiles.
    pub large: f32,
}

impl RayTables {
    /// Makes the tables of a band of a camera with a lens, of which `kept` may have parts.
    ///
    /// # Errors
    /// If memory runs out, or the camera is a pinhole.
    pub fn new(device: &Device, (camera, band): (&Camera, Band), kept: Option<Self>) -> Result<Self> {
        let rays = rays(camera, band);
        let cones = cones(&rays, band.size(camera.size_px));
        Ok(Self {
            lens: LensTables::new(device, (camera, band), &rays, kept.map(|kept| kept.lens))?,
            cones: uploaded(device, "cones of tiles", &cones)?,
            large: LARGE_TILES * mean_spread(&cones),
        })
    }

    /// The name and the bytes of every buffer.
    pub fn buffers(&self) -> impl Iterator<Item = (&str, u64)> {
        self.lens.buffers().into_iter().chain([self.cones.footprint()])
    }
}

/// A buffer that holds `values`.
///
/// # Errors
/// If memory runs out.
pub(in crate::render) fn uploaded<T: Element>(device: &Device, name: &str, values: &[T]) -> Result<Buffer<T>> {
    let buffer = Buffer::new(device, name, values.len())?;
    let mut cmd = Commands::new(device)?;
    cmd.upload(&buffer, 0, values.len(), |memory| memory.copy_from_slice(values))?;
    cmd.submit()?.wait()?;
    Ok(buffer)
}

/// The rays of the pixels of a band in view axes, row by row; 0 where there is none.
pub(in crate::render) fn rays(camera: &Camera, band: Band) -> Vec<[f32; 3]> {
    let [width, height] = band.size(camera.size_px).map(|side| side as usize);
    let ray = |index: usize| {
        let row = f64::from(band.top) + (index / width) as f64;
        let centre = DVec2::new((index % width) as f64 + 0.5, row + 0.5);
        camera.ray(centre).unwrap_or(DVec3::ZERO).as_vec3().to_array()
    };
    (0..width * height).into_par_iter().with_min_len(1024).map(ray).collect()
}

/// Splats that reach over more tiles, by their number along a side, are shared by subgroups.
const LARGE_TILES: f32 = 6.0;

/// The mean spread of the cones of tiles.
fn mean_spread(cones: &[Cone]) -> f32 {
    let spreads = cones.iter().filter(|cone| cone.tile != NO_TILE).map(|cone| f32::from_bits(cone.sphere[3]));
    let (sum, count) = spreads.fold((0.0, 0), |(sum, count), spread| (sum + spread, count + 1));
    sum / count.max(1) as f32
}

/// A sphere that holds the ends of rays.
#[derive(Clone, Copy)]
struct Sphere {
    middle: Vec3,
    spread: f32,
}

impl Sphere {
    /// The sphere around the box of the rays; none without a ray.
    fn around(rays: impl Iterator<Item = Vec3> + Clone) -> Option<Self> {
        let low = rays.clone().reduce(Vec3::min)?;
        let middle = 0.5 * low + 0.5 * rays.clone().fold(low, Vec3::max);
        let spread = rays.map(|ray| ray.distance(middle)).fold(0.0, f32::max);
        Some(Self { middle, spread }.rounded_up())
    }

    /// Room for the rounding of this sphere, and of what the shaders compute with it.
    fn rounded_up(self) -> Self {
        Self { spread: self.spread * 1.000_01 + 4e-6 * self.middle.abs().max_element().max(1.0), ..self }
    }

    fn around_both(self, other: Self) -> Self {
        let middle = 0.5 * self.middle + 0.5 * other.middle;
        let reach = |of: Self| of.middle.distance(middle) + of.spread;
        Self { middle, spread: reach(self).max(reach(other)) }.rounded_up()
    }
}

/// Cones around the tiles of an image in depth-first order. Tiles without a ray have none.
fn cones(rays: &[[f32; 3]], size_px: [u32; 2]) -> Vec<Cone> {
    let counts = size_px.map(|side| side.div_ceil(TILE));
    let of_tile = |tile: u32| {
        let low = [tile % counts[0] * TILE, tile / counts[0] * TILE];
        let rows = low[1]..(low[1] + TILE).min(size_px[1]);
        let columns = low[0]..(low[0] + TILE).min(size_px[0]);
        let pixels = rows.flat_map(|y| columns.clone().map(move |x| y as usize * size_px[0] as usize + x as usize));
        Sphere::around(pixels.map(|pixel| Vec3::from(rays[pixel])).filter(|ray| *ray != Vec3::ZERO))
    };
    let tiles: Vec<_> = (0..counts[0] * counts[1]).into_par_iter().map(of_tile).collect();
    let mut cones = Vec::new();
    if add_cones(&mut cones, &tiles, counts, [0, 0], counts).is_none() {
        // A cone that no splat meets.
        let sphere = [0.0, 0.0, 0.0, -3.0 * EVERYWHERE].map(f32::to_bits);
        cones.push(Cone { sphere, next: 1, tile: NO_TILE });
    }
    cones
}

/// Adds the cone around the tiles from `low` on, `size` of them, and the cones within. Halves the longer side.
fn add_cones(
    cones: &mut Vec<Cone>,
    tiles: &[Option<Sphere>],
    counts: [u32; 2],
    low: [u32; 2],
    size: [u32; 2],
) -> Option<Sphere> {
    let place = cones.len();
    let cone = |sphere: Sphere, next: usize, tile: u32| {
        let Sphere { middle, spread } = sphere;
        let sphere = [middle.x, middle.y, middle.z, spread].map(f32::to_bits);
        Cone { sphere, next: next as u32, tile }
    };
    if size == [1, 1] {
        let tile = low[1] * counts[0] + low[0];
        let sphere = tiles[tile as usize]?;
        cones.push(cone(sphere, place + 1, tile));
        return Some(sphere);
    }
    let axis = usize::from(size[1] > size[0]);
    let (mut first, mut second, mut from) = (size, size, low);
    first[axis] = size[axis] / 2;
    second[axis] -= first[axis];
    from[axis] += first[axis];
    cones.push(bytemuck::Zeroable::zeroed());
    let spheres = [add_cones(cones, tiles, counts, low, first), add_cones(cones, tiles, counts, from, second)];
    match spheres {
        [Some(one), Some(other)] => {
            let both = one.around_both(other);
            cones[place] = cone(both, cones.len(), NO_TILE);
            Some(both)
        }
        // The cone of the half that has rays is enough.
        [one, other] => {
            cones.remove(place);
            cones[place..].iter_mut().for_each(|cone| cone.next -= 1);
            one.or(other)
        }
    }
}

/// The footprints at the corners of the table: rows by the sine of half the angle from the axis, up to that of the
/// limit; columns around the axis, by the place on the square with corners on the axes.
fn footprints(of: &Footprints) -> Vec<[f32; 3]> {
    let side = FOOTPRINTS + 1;
    let part = |i: u32| f64::from(i) / f64::from(FOOTPRINTS);
    let corner = |place: u32| {
        let angle = 2.0 * (part(place / side) * half_sine(of.limit())).asin();
        let around = 4.0 * part(place % side);
        let (edge, along) = (around.floor(), around.fract());
        let azimuth = DVec2::from_angle(FRAC_PI_2 * edge).rotate(DVec2::new(1.0 - along, along).normalize());
        of.in_frame(angle.min(of.limit()), azimuth).map(|value| value as f32)
    };
    (0..side * side).into_par_iter().map(corner).collect()
}

fn half_sine(angle: f64) -> f64 {
    (angle / 2.0).sin()
}
