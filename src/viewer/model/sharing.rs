//! Frames of the first picture that several devices share.

use anyhow::{Result, ensure};

use super::source::Source;
use crate::gpu::Device;
use crate::options::Options;
use crate::render::{GpuScene, OtherDevices, Renderer, Upload};
use crate::threads::{self, joined};

/// The other devices of a picture.
pub struct Sharing {
    pub devices: OtherDevices,
    /// The scene on each of them, for the next picture of the same scene.
    pub scenes: Vec<GpuScene>,
}

impl Sharing {
    /// True if the last picture is that of one kind of devices: others may round otherwise.
    #[cfg(feature = "serve")]
    pub fn is_of_one_kind(&self) -> bool {
        let bands = self.devices.last_bands();
        bands.windows(2).all(|pair| pair[0].device == pair[1].device)
    }
}

/// What the other devices need for a picture.
pub struct SharingPlan {
    pub options: Options,
    pub source: Source,
    /// The scene on each of them, if it is there; otherwise empty.
    pub scenes: Vec<GpuScene>,
    /// Memory to leave for pictures.
    pub reserve: Upload,
    /// The number of the picture's build.
    pub generation: u64,
}

impl SharingPlan {
    /// Uploads the scene to all `others` at the same time, and makes their renderers. `device` is that of the picture.
    /// Returns those that can draw, and for each that cannot its name and the reason.
    ///
    /// # Errors
    /// If the system refuses threads, or none can draw.
    pub fn build(self, device: &Device, others: &[Device]) -> Result<(Sharing, Vec<String>)> {
        let Self { options, source, scenes, reserve, .. } = &self;
        let make = |other: &Device| -> Result<(Renderer, GpuScene)> {
            let scene = match scenes.iter().find(|scene| scene.is_on(other)) {
                Some(scene) => scene.clone(),
                None => source.upload(other, options, *reserve)?,
            };
            // A device that reads pages in every frame would keep the others waiting.
            ensure!(!scene.is_paged(), "the scene does not fit into its memory as a whole");
            Ok((Renderer::new(other, options, &scene)?, scene))
        };
        let made = threads::scope(|threads| -> Result<Vec<_>> {
            let making = others.iter().map(|other| threads.spawn(move || make(other)));
            let making = making.collect::<Result<Vec<_>, _>>()?;
            Ok(making.into_iter().map(joined).collect())
        })?;
        let (mut renderers, mut scenes, mut failed) = (Vec::new(), Vec::new(), Vec::new());
        for (other, made) in others.iter().zip(made) {
            match made {
                Ok((renderer, scene)) => {
                    renderers.push((other, renderer));
                    scenes.push(scene);
                }
                Err(problem) => failed.push(format!("{}: {problem:#}", other.capabilities().name)),
            }
        }
        ensure!(!renderers.is_empty(), failed.join("; "));
        Ok((Sharing { devices: OtherDevices::new(device, options, renderers)?, scenes }, failed))
    }
}
