//! The splats of a pixel.

use anyhow::{Context, Result, bail, ensure};

use super::{Last, Renderer};
use crate::render::frame::Shot;
use crate::render::inspect::{Explanation, Picker};

/// Why there are no lists of a picture that is drawn in parts.
const WHOLE: &str = "a pixel can be explained only where the whole scene and its lists fit into device memory";

impl Renderer {
    /// The splats that a pixel of the frame recorded last is made of; where pictures are drawn smaller, those of the
    /// nearest drawn pixel. Waits for the device. If the portable path does not hold the lists of the frame, it draws
    /// the frame again.
    ///
    /// # Errors
    /// If no frame was recorded, or the pixel lies outside the picture.
    pub fn explain(&mut self, pixel: [u32; 2]) -> Result<Explanation> {
        let Last { camera, background, has_tile_lists, .. } = self.last.clone().context("nothing is rendered yet")?;
        let size = camera.size_px;
        ensure!(pixel[0] < size[0] && pixel[1] < size[1], "pixel {pixel:?} lies outside of a picture of {size:?}");
        if !has_tile_lists {
            ensure!(!self.scene.is_paged(), "{WHOLE}");
            self.needs_tile_lists = true;
            let rendered = self.render(&camera, background);
            self.needs_tile_lists = false;
            rendered?;
            if self.drawn.in_slabs {
                // The picture stays what it was.
                self.render(&camera, background)?;
                bail!(WHOLE);
            }
        }
        let picker = match &mut self.picker {
            Some(picker) => picker,
            none => none.insert(Picker::new(&self.device, &self.options, self.scene.layout())?),
        };
        let drawn = self.options.drawn_size(size);
        let pixel = std::array::from_fn(|i| {
            let place = (f64::from(pixel[i]) + 0.5) / f64::from(size[i]) * f64::from(drawn[i]);
            (place as u32).min(drawn[i] - 1)
        });
        let shot = Shot { scene: &self.scene, camera: &camera.sampled(drawn) };
        let explained = picker.explain(&self.device, self.choice.portable(), shot, &self.choice.work, pixel)?;
        if !has_tile_lists {
            // The picture stays what it was, to the last bit.
            self.render(&camera, background)?;
        }
        Ok(explained)
    }
}
