//! What the layout of a scene follows from, and the reasons to leave arrays to the host.

use crate::options::{Options, Storage};
use crate::packing::{EXAMINED, Layout, NOTHING, Statistics};
use crate::render::scene::{
    GpuScene, SELF_TEST_GAUSSIANS, SceneInput, SelfTest, SelfTestInput, self_test, self_test_camera,
};
use crate::render::shaders::Examined;
use crate::scene::{
    Arrays, Band, Bounds, Focus, Gaussians, MAX_SH_DEGREE, Requirements, StoredValues, sh_coefficients,
};

/// The reason to read the arrays on the host: it draws them otherwise, or has to say what is wrong with them.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum HostNeeded {
    #[error("no Gaussian has an opacity over 0")]
    Empty,
    #[error("some values may be out of range")]
    OutOfRange,
    #[error("the options store attributes in 8 bits")]
    Bytes,
    #[error("the values may lie on grids of 256 steps, which 8 bits hold")]
    Grids,
    #[error("the colours are so bright that the error of 16-bit floats has to be computed")]
    Bright,
    #[error("there is too little device memory for the whole scene")]
    Memory,
}

/// The means that the camera of the self-test follows from.
pub(super) const MEANS: usize = SELF_TEST_GAUSSIANS;
/// The Gaussians that decide whether values may lie on grids: as many as the host looks at first.
pub(super) const HEAD: usize = 1 << 10;

/// What the scene of some arrays follows from.
#[derive(Clone, Debug)]
pub struct Examination {
    /// The number of rows.
    count: usize,
    input: SceneInput,
}

impl Examination {
    /// From what parts of the scene report, and the first rows of the arrays.
    pub(super) fn of(
        parts: &[Examined],
        (count, sh_degree): (usize, u32),
        head: [&[f32]; 5],
        options: &Options,
    ) -> Result<Self, HostNeeded> {
        if parts.iter().any(|part| part.flawed > 0) {
            return Err(HostNeeded::OutOfRange);
        }
        let statistics = statistics(parts, sh_degree);
        if statistics.count == 0 {
            return Err(HostNeeded::Empty);
        }
        let widest = parts.iter().map(|part| double(part.widest)).fold(0.0, f64::max);
        if widest > EXAMINED && options.sh_storage == Storage::F16 {
            return Err(HostNeeded::Bright);
        }
        let rows = first_rows(head, sh_degree).ok_or(HostNeeded::Memory)?;
        let mut values = StoredValues::new(rows.len(), sh_degree);
        values.add(&rows);
        let may_be = values.may_be_on_grids();
        let seeks = [options.sh_storage, options.shape_storage].map(|storage| storage != Storage::F32);
        if may_be.iter().zip(seeks).any(|(may_be, seeks)| *may_be && seeks) {
            return Err(HostNeeded::Grids);
        }
        let input = SceneInput {
            layout: Layout::of(&statistics, options),
            extent: statistics.extent,
            alpha_min: options.rules.alpha_min,
            self_test: self_test_of(head, options.rules.near),
        };
        Ok(Self { count, input })
    }

    pub(super) fn input(&self) -> &SceneInput {
        &self.input
    }

    /// The number formats of the scene.
    pub fn layout(&self) -> &Layout {
        &self.input.layout
    }

    /// The bounding box of the means.
    pub fn extent(&self) -> Bounds {
        self.input.extent
    }

    /// True if the planes of a scene, which must be on the device of the arrays, can hold these Gaussians.
    pub fn fits(&self, scene: &GpuScene) -> bool {
        scene.has_planes_for(&self.input.layout, self.count)
    }
}

/// The first Gaussians that can be drawn; `None` if the host has no memory for them.
fn first_rows([means, rotations, scales, opacities, sh]: [&[f32]; 5], sh_degree: u32) -> Option<Gaussians> {
    let arrays = Arrays {
        means: &means.as_chunks::<3>().0[..opacities.len()],
        rotations: rotations.as_chunks().0,
        scales: scales.as_chunks().0,
        opacities,
        sh: sh.as_chunks().0,
        sh_degree,
    };
    Some(arrays.gaussians().ok()?.0)
}

/// The input of the self-test. Scenes with equal first rows share one.
fn self_test_of(head: [&[f32]; 5], near: f32) -> SelfTest {
    let head = head.map(<[f32]>::to_vec);
    self_test(move || {
        let mut hash = blake3::Hasher::new();
        hash.update(&near.to_le_bytes());
        head.iter().for_each(|part| _ = hash.update(bytemuck::cast_slice(part)));
        SelfTestInput { camera: self_test_camera(head[0].as_chunks().0, near), hash: hash.finalize() }
    })
}

/// The statistics of all Gaussians that can be drawn. The layouts that they are for need no focus, no ranges of
/// spherical harmonics, no errors of 16-bit floats and no grids.
fn statistics(parts: &[Examined], sh_degree: u32) -> Statistics {
    let count: usize = parts.iter().map(|part| part.kept as usize).sum();
    let largest = |value: fn(&Examined) -> u32| parts.iter().map(value).max().unwrap_or(0);
    let widest = |value: &dyn Fn(&Examined) -> [u32; 2]| parts.iter().map(|p| double(value(p))).fold(0.0, f64::max);
    let bands = std::array::from_fn(|l| {
        let squares: f64 = parts.iter().map(|part| double(part.squares[l])).sum();
        Band { bound: widest(&|part| part.bounds[l]), rms: (squares / (3 * count.max(1)) as f64).sqrt() }
    });
    // 0 is +0.
    let axis = |key: &dyn Fn(&Examined) -> u32| parts.iter().map(key).max().unwrap_or(0);
    let high = std::array::from_fn(|i| coordinate(axis(&|part| part.high[i])) + 0.0);
    let low = std::array::from_fn(|i| coordinate(!axis(&|part| part.low[i])) + 0.0);
    let scales = match largest(|part| part.smallest_scale) {
        0 => [0.0; 2],
        smallest => [!smallest, largest(|part| part.largest_scale)].map(f32::from_bits),
    };
    Statistics {
        count,
        sh_degree,
        extent: Bounds { low, high },
        focus: Focus { centre: [0.0; 3], radius: 1.0 },
        requirements: Requirements {
            sh_degree: (0..=MAX_SH_DEGREE).rev().find(|l| bands[*l as usize].bound > 0.0).unwrap_or(0),
            bands,
            brightest: widest(&|part| part.brightest),
            sh_grids: None,
            scale_grid: None,
        },
        scales,
        is_flat: largest(|part| part.flat_shapes) > 0,
        highest_opacity: f32::from_bits(largest(|part| part.opacity)),
        sh: [NOTHING; sh_coefficients(MAX_SH_DEGREE)],
        half_errors: [0.0; MAX_SH_DEGREE as usize + 1],
    }
}

/// The float of a key in the order of floats.
fn coordinate(key: u32) -> f32 {
    f32::from_bits(if key >> 31 == 1 { key ^ 1 << 31 } else { !key })
}

fn double([low, high]: [u32; 2]) -> f64 {
    f64::from_bits(u64::from(high) << 32 | u64::from(low))
}
