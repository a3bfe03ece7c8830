//! A scene as the shaders read it.

use std::ops::Range;

use anyhow::Result;
use rayon::prelude::*;

use crate::gpu::{Buffer, Commands, Device, Element};
use crate::options::ALPHA_MIN;
use crate::scene::{Bounds, Gaussians, sh_coefficients};

/// Gaussians in device memory, one plane per attribute: 48 bytes each and 16 per vec4 of spherical harmonics, as many as
/// the scene's degree needs (1, 3, 7 or 12).
pub struct GpuScene {
    /// The mean as bits, and the [`reach`].
    pub(super) bounds: Buffer<[u32; 4]>,
    /// w x y z.
    pub(super) rotations: Buffer<[f32; 4]>,
    /// Scale, opacity.
    pub(super) shapes: Buffer<[f32; 4]>,
    /// Coefficients without gaps, four floats a plane.
    pub(super) sh: Vec<Buffer<[f32; 4]>>,
    pub(crate) extent: Bounds,
    sh_degree: u32,
}

/// Gaussians uploaded at once: their spherical harmonics, which every plane takes a part of, stay in the cache.
const UPLOAD_CHUNK: usize = 1 << 15;

impl GpuScene {
    /// Uploads a scene.
    pub fn new(device: &Device, gaussians: &Gaussians) -> Result<Self> {
        let len = gaussians.len();
        let plane = |name: &str| Buffer::<[f32; 4]>::new(device, name, len);
        let sh_planes = (3 * sh_coefficients(gaussians.sh_degree())).div_ceil(4);
        let scene = Self {
            bounds: Buffer::new(device, "bounds", len)?,
            rotations: plane("rotations")?,
            shapes: plane("shapes")?,
            sh: (0..sh_planes).map(|i| plane(&format!("sh {i}"))).collect::<Result<_>>()?,
            extent: Bounds::of(gaussians),
            sh_degree: gaussians.sh_degree(),
        };
        let mut in_flight = None;
        for first in (0..len).step_by(UPLOAD_CHUNK) {
            let mut commands = Commands::new(device)?;
            scene.upload(&mut commands, gaussians, first..len.min(first + UPLOAD_CHUNK))?;
            // Dropping the chunk before waits for it: one is copied while the next is prepared.
            in_flight = Some(commands.submit()?);
        }
        in_flight.map(|last| last.wait()).transpose()?;
        Ok(scene)
    }

    /// Gaussians.
    pub fn len(&self) -> usize {
        self.bounds.len()
    }

    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    pub fn sh_degree(&self) -> u32 {
        self.sh_degree
    }

    /// Every buffer's name and bytes.
    pub fn buffers(&self) -> Vec<(&str, u64)> {
        let planes = [&self.rotations, &self.shapes].into_iter().chain(&self.sh).map(Buffer::footprint);
        std::iter::once(self.bounds.footprint()).chain(planes).collect()
    }

    /// Device memory in bytes that a scene of this size takes.
    pub fn bytes_for(len: usize, sh_degree: u32) -> u64 {
        16 * (3 + (3 * sh_coefficients(sh_degree)).div_ceil(4) as u64) * len as u64
    }

    fn upload(&self, commands: &mut Commands, gaussians: &Gaussians, range: Range<usize>) -> Result<()> {
        let (means, scales, opacities) = (gaussians.means(), gaussians.scales(), gaussians.opacities());
        upload_plane(commands, &self.bounds, &range, |i| {
            let [x, y, z] = means[i].map(f32::to_bits);
            [x, y, z, reach(scales[i], opacities[i])]
        })?;
        upload_plane(commands, &self.rotations, &range, |i| gaussians.rotations()[i])?;
        upload_plane(commands, &self.shapes, &range, |i| {
            let [x, y, z] = scales[i];
            [x, y, z, opacities[i]]
        })?;
        for (number, plane) in self.sh.iter().enumerate() {
            upload_plane(commands, plane, &range, |i| {
                let floats = gaussians.sh(i).as_flattened();
                std::array::from_fn(|k| floats.get(4 * number + k).copied().unwrap_or(0.0))
            })?;
        }
        Ok(())
    }
}

/// Uploads part of a plane, made on all cores.
fn upload_plane<T: Element + Send>(
    commands: &mut Commands,
    plane: &Buffer<T>,
    range: &Range<usize>,
    value: impl Fn(usize) -> T + Sync,
) -> Result<()> {
    commands.upload(plane, range.start, range.len(), |memory| {
        memory.par_iter_mut().with_min_len(4096).enumerate().for_each(|(k, slot)| *slot = value(range.start + k));
    })
}

/// Two bfloat16, rounded up: how many standard deviations from the mean alpha falls to 1/255, and in the upper half the
/// same in world units along the longest axis, or -1 where alpha starts lower.
fn reach(scale: [f32; 3], opacity: f32) -> u32 {
    let opacity = f64::from(opacity);
    if opacity < ALPHA_MIN {
        return (-1.0_f32).to_bits();
    }
    let longest = f64::from(scale[0].max(scale[1]).max(scale[2]));
    let deviations = (2.0 * (opacity / ALPHA_MIN).ln()).sqrt();
    upper_half(deviations * longest) << 16 | upper_half(deviations)
}

/// The bits of the least bfloat16 that is not less than `value`, which is not negative.
fn upper_half(value: f64) -> u32 {
    let single = (value * (1.0 + 1e-6)) as f32;
    single.to_bits().div_ceil(1 << 16)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn reach_is_rounded_up_and_hardly_more() {
        for (scale, opacity) in [(1.0_f32, 1.0_f32), (1e-8, 0.5), (3.7e5, 0.004), (f32::MAX, 1.0)] {
            let bits = reach([scale, 0.0, scale / 2.0], opacity);
            let [world, deviations] = [bits & 0xffff_0000, bits << 16].map(|b| f64::from(f32::from_bits(b)));
            let exact = (2.0 * (f64::from(opacity) / ALPHA_MIN).ln()).sqrt();
            assert!(deviations >= exact && deviations <= exact * 1.01, "{opacity}: {deviations} for {exact}");
            let exact = (exact * f64::from(scale)).min(f64::INFINITY);
            assert!(
                world >= exact && (world <= exact * 1.01 || world == f64::INFINITY),
                "{scale}: {world} for {exact}"
            );
        }
        assert!(f32::from_bits(reach([1.0; 3], 0.003) & 0xffff_0000) < 0.0);
        assert_eq!(reach([1.0; 3], (1.0_f64 / 255.0) as f32) << 16, 0, "alpha 1/255 is at the mean alone");
    }
}
