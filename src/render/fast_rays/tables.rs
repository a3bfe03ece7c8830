//! What the stages need of a camera's lens beside rays and footprints: cells of directions, rays of bins.

use anyhow::{Context, Result};
use glam::{DMat2, DVec2, DVec3, Vec3};
use rayon::prelude::*;

use super::cells::LensCells;
use crate::camera::Camera;
use crate::gpu::{Buffer, Device};
use crate::render::band::Band;
use crate::render::fast::BinGrid;
use crate::render::rays::{LensTables, rays, uploaded};
use crate::render::shaders::fast::BLOCK_WIDTH;
use crate::render::shaders::fast_rays::BIN_RAYS;

/// The tables of a band of one lens, size of picture and form of blocks, on the device.
pub struct BinTables {
    pub lens: LensTables,
    pub cells: LensCells,
    /// Bounds of the rays: `glsl/fast_rays/frame.glsl` has the form.
    pub table: Buffer<[u32; 4]>,
    /// The rays of each block of the whole picture lie well within a half space around its middle, so that a plane
    /// before them meets all. One path draws all bands.
    pub have_planes: bool,
    block_height: u32,
}

impl BinTables {
    /// Makes the tables of a band of a camera with a lens, of which `kept` may have parts.
    ///
    /// # Errors
    /// If memory runs out, or the camera is a pinhole.
    pub fn new(device: &Device, (camera, band): (&Camera, Band), grid: BinGrid, kept: Option<Self>) -> Result<Self> {
        let known = kept.as_ref().filter(|kept| kept.lens.are_of_lens(camera) && kept.has_blocks_of(grid));
        let known = known.map(|kept| kept.have_planes);
        let (kept_cells, kept_lens) = kept.map(|kept| (kept.cells, kept.lens)).unzip();
        let cells = LensCells::new(device, camera.lens.as_ref().context("a pinhole needs no rays")?, kept_cells)?;
        let picture = Picture { rays: &rays(camera, band), camera, band };
        let lens = LensTables::new(device, (camera, band), picture.rays, kept_lens)?;
        let (middle, spread) = picture.sphere();
        let [width, height] = grid.bin_px();
        let bins: Vec<_> = picture.parts(grid.bins, [width, height]).map(|part| picture.bin_rays(&part)).collect();
        let mut table = vec![
            middle.extend(spread).to_array().map(f32::to_bits),
            [lens.footprints.half_sine.to_bits(), lens.footprints.widest.to_bits(), camera.is_parallel().into(), 0],
        ];
        table.extend(bins.as_flattened());
        let has_planes = |picture: Picture| picture.has_planes(grid.block_height);
        let whole = Band::whole(camera.size_px);
        let have_planes = || match band == whole {
            true => has_planes(picture),
            false => has_planes(Picture { rays: &rays(camera, whole), camera, band: whole }),
        };
        Ok(Self {
            lens,
            cells,
            table: uploaded(device, "lens table", &table)?,
            have_planes: known.unwrap_or_else(have_planes),
            block_height: grid.block_height,
        })
    }

    /// True if the tables suit a band of the pictures of a camera, wherever it stands.
    pub fn suit(&self, (camera, band): (&Camera, Band), grid: BinGrid) -> bool {
        self.has_blocks_of(grid) && self.lens.suit(camera, band)
    }

    fn has_blocks_of(&self, grid: BinGrid) -> bool {
        self.block_height == grid.block_height
    }

    /// The name and the bytes of every buffer.
    pub fn buffers(&self) -> impl Iterator<Item = (&str, u64)> {
        self.lens.buffers().into_iter().chain([self.cells.cells.footprint(), self.table.footprint()])
    }
}

/// The least cosine of the angle between a ray of a block and its middle.
const LEAST_COSINE: f32 = 0.5;

/// The rays of the pixels of a band, row by row.
#[derive(Clone, Copy)]
struct Picture<'p> {
    rays: &'p [[f32; 3]],
    camera: &'p Camera,
    band: Band,
}

/// The rays of a part of a picture, each with its place relative to the middle of the part, px.
type Part = Vec<(DVec2, DVec3)>;

impl Picture<'_> {
    /// The parts of a size in px of a band, in rows.
    fn parts(self, counts: [u32; 2], size_px: [u32; 2]) -> impl IndexedParallelIterator<Item = Part> {
        let [width, height] = self.band.size(self.camera.size_px);
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
        let all = || self.rays.par_iter().copied().map(Vec3::from).filter(|ray| *ray != Vec3::ZERO);
        let Some(low) = all().reduce_with(Vec3::min) else { return (Vec3::ZERO, f32::NEG_INFINITY) };
        let middle = 0.5 * low + 0.5 * all().reduce(|| low, Vec3::max);
        let spread = all().map(|ray| ray.distance(middle)).reduce(|| 0.0, f32::max);
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

    /// True if all blocks of this height have planes.
    fn has_planes(self, block_height: u32) -> bool {
        let block_px = [BLOCK_WIDTH, block_height];
        let size = self.band.size(self.camera.size_px);
        let blocks = [0, 1].map(|axis| size[axis].div_ceil(block_px[axis]));
        self.parts(blocks, block_px).all(|part| self.has_plane(&part))
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
        // A single row or column of pixels leaves the change across it open.
        let along = match along.map(|axis| axis == DVec3::ZERO) {
            [false, false] => along,
            [false, true] => [along[0], normal.cross(along[0])],
            [true, false] => [along[1].cross(normal), along[1]],
            [true, true] => [normal.any_orthonormal_vector(), normal.cross(normal.any_orthonormal_vector())],
        };
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

/// The affine map from places to rays with the least squares: the ray of the middle, and derivatives by x and y, which
/// are 0 for an axis along which all places are equal.
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
    let spread = |sum: f64| if sum > 0.0 { sum } else { 1.0 };
    (squares.x_axis.x, squares.y_axis.y) = (spread(squares.x_axis.x), spread(squares.y_axis.y));
    let inverse = squares.inverse();
    let along = [0, 1].map(|axis| products[0] * inverse.col(0)[axis] + products[1] * inverse.col(1)[axis]);
    (mean_ray - along[0] * mean_place.x - along[1] * mean_place.y, along)
}
