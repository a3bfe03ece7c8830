//! Frames of the first picture that several devices share.

use anyhow::Result;

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

/// What the other devices need for a picture.
pub struct SharingPlan {
    pub options: Options,
    pub source: Source,
    /// The scene on each of them, if it is there; otherwise empty.
    pub scenes: Vec<GpuScene>,
    /// The number of the picture's build.
    pub generation: u64,
}

impl SharingPlan {
    /// Uploads the scene to all `others` at the same time, and makes their renderers. `device` is that of the picture.
    ///
    /// # Errors
    /// If memory runs out, a device is lost, or the scene does not fit as a whole.
    pub fn build(self, device: &Device, others: &[Device]) -> Result<Sharing> {
        let Self { options, source, scenes, .. } = &self;
        let made = threads::scope(|threads| -> Result<Vec<_>> {
            let make = |(place, other): (usize, &Device)| -> Result<(Renderer, GpuScene)> {
                let scene = match scenes.get(place) {
                    Some(scene) => scene.clone(),
                    None => source.upload(other, options, Upload::default())?,
                };
                Ok((Renderer::new(other, options, &scene)?, scene))
            };
            let making = others.iter().enumerate().map(|numbered| threads.spawn(move || make(numbered)));
            let making = making.collect::<Result<Vec<_>, _>>()?;
            making.into_iter().map(joined).collect()
        })?;
        let (renderers, scenes): (Vec<_>, Vec<_>) = made.into_iter().unzip();
        let devices = OtherDevices::new(device, options, others.iter().zip(renderers).collect())?;
        Ok(Sharing { devices, scenes })
    }
}
