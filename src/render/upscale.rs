//! The enlargement of pictures that are drawn smaller.

use anyhow::Result;

use super::shaders::shared::{Upscale, UpscaleBindings, UpscalePush};
use crate::gpu::{Commands, Device, DispatchSize, Image, Stage};

/// Enlarges pictures that are drawn smaller.
pub(super) struct Upscaler {
    pub drawn: Image,
    stage: Stage<Upscale>,
}

impl Upscaler {
    pub fn new(device: &Device) -> Result<Self> {
        Ok(Self { drawn: Image::new(device, "drawn image", 1, 1)?, stage: Stage::new(device, &())? })
    }

    /// Records the enlargement of the drawn image to `image`.
    pub fn record(&self, cmd: &mut Commands, image: &Image) {
        let push = UpscalePush { drawn_size_px: self.drawn.size(), size_px: image.size() };
        let pixels = image.size().iter().map(|side| u64::from(*side)).product();
        cmd.dispatch(
            &self.stage,
            UpscaleBindings { drawn: &self.drawn, image },
            push,
            DispatchSize::Invocations(pixels),
        );
    }
}
