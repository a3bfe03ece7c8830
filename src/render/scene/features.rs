//! Features of Gaussians in device memory, which are drawn in the place of the colours of their scene.

use anyhow::{Result, ensure};
use rayon::prelude::*;

use super::gpu_scene::{GpuScene, UPLOAD_CHUNK};
use crate::gpu::{Buffer, Commands, Device, Handle};
use crate::host_memory::OutOfMemory;
use crate::options::Storage;
use crate::packing::Layout;
use crate::scene::harmonics;

/// Three features of each Gaussian of a scene. A clone shares them.
#[derive(Clone)]
pub struct Features(Buffer<[u32; 4]>);

impl Features {
    /// Memory for the features of `count` Gaussians, which another API writes: four floats each, of which the first
    /// three are the features divided by the constant basis function of spherical harmonics, rounded once.
    ///
    /// # Errors
    /// If the device exports no memory, a limit of memory is set, or memory runs out.
    pub fn exportable(device: &Device, count: usize) -> Result<Self> {
        Ok(Self(Buffer::exportable(device, "features", count)?))
    }

    /// A handle with which another API opens the memory.
    ///
    /// # Errors
    /// If it is not exportable, or the driver makes no handle.
    pub fn export(&self) -> Result<Handle> {
        self.0.export()
    }
}

impl GpuScene {
    /// Uploads three features for each Gaussian of this scene. [`Rules::features`](crate::rules::Rules) draws them.
    ///
    /// # Errors
    /// If the scene is in pages, or device memory runs out.
    ///
    /// # Panics
    /// If the scene has colours of more than degree 0 or in fewer than 32 bits, or another number of Gaussians.
    pub fn upload_features(&self, device: &Device, features: &[[f32; 3]]) -> Result<Features> {
        assert_eq!(features.len(), self.len(), "every Gaussian has features");
        assert!(has_room(self.layout()), "features take the place of colours in 32-bit floats");
        let why = || "features are drawn only if the whole scene fits into device memory".to_owned();
        ensure!(!self.is_paged(), OutOfMemory { name: "features".to_owned(), bytes: None, reason: why() });
        let plane = Buffer::new(device, "features", features.len())?;
        // The constant basis function of degree 0, by which the shaders multiply.
        let word = |value: f32| ((f64::from(value) / harmonics::C0) as f32).to_bits();
        for (i, chunk) in features.chunks(UPLOAD_CHUNK).enumerate() {
            let mut commands = Commands::new(device)?;
            commands.upload(&plane, i * UPLOAD_CHUNK, chunk.len(), |memory| {
                let pairs = memory.par_iter_mut().zip(chunk);
                pairs.for_each(|(words, [a, b, c])| *words = [word(*a), word(*b), word(*c), 0]);
            })?;
            commands.submit()?.wait()?;
        }
        Ok(Features(plane))
    }

    /// This scene with these features in the place of its colours.
    ///
    /// # Panics
    /// If the features are of another number of Gaussians.
    pub fn with_features(&self, features: &Features) -> Self {
        assert_eq!(features.0.len(), self.len(), "every Gaussian has features");
        let mut scene = self.clone();
        scene.sh = vec![features.0.clone()];
        scene
    }
}

/// True if the colours of a layout have the form of features.
fn has_room(layout: &Layout) -> bool {
    layout.sh_degree == 0 && matches!(layout.sh.storage, Storage::Lossless | Storage::F32)
}
