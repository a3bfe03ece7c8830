//! The explanation of pictures: attributes of scenes in pages, the splats and the depth of a pixel.

use anyhow::{Context, Result, bail, ensure};

use super::{Last, Renderer};
use crate::pixels::Pixels;
use crate::render::frame::Shot;
use crate::render::inspect::{Attribute, Explanation, Inspection, Picker};

/// The reason why a picture that is drawn in slabs has no lists.
const WHOLE: &str = "a pixel can be explained only where the whole scene and its lists fit into device memory";

impl Renderer {
    /// True if pictures can show an inspection. Pictures of a scene in pages show attributes only.
    pub fn can_show(&self, inspection: &Inspection) -> bool {
        !self.scene.is_paged() || *inspection == Inspection::default() || self.shown_in_pages(inspection).is_some()
    }

    /// The attribute of an inspection, if pictures of a scene in pages can show it.
    pub(super) fn shown_in_pages(&self, inspection: &Inspection) -> Option<Attribute> {
        inspection.attribute().filter(|_| self.choice.shows_attributes())
    }

    /// The splats that a pixel of the frame recorded last consists of; where pictures are drawn smaller, the splats of
    /// the nearest drawn pixel. Waits for the device. If the portable path does not hold the lists of the frame, it
    /// draws the frame again.
    ///
    /// # Errors
    /// If no frame was recorded, or the pixel lies outside the picture.
    pub fn explain(&mut self, pixel: [u32; 2]) -> Result<Explanation> {
        let Last { camera, background, has_tile_lists, .. } = self.last_with(pixel)?;
        let size = camera.size_px;
        if !has_tile_lists {
            ensure!(!self.scene.is_paged(), "{WHOLE}");
            self.needs_tile_lists = true;
            let rendered = self.render(&camera, background);
            self.needs_tile_lists = false;
            rendered?;
            if self.drawn.in_slabs {
                // Restores the picture.
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
            let position = (f64::from(pixel[i]) + 0.5) / f64::from(size[i]) * f64::from(drawn[i]);
            (position as u32).min(drawn[i] - 1)
        });
        let sampled = camera.sampled(drawn);
        let shot = Shot::new(&self.scene, &sampled);
        let (pipeline, listed) = self.choice.listed(shot);
        let explained = picker.explain(&self.device, pipeline, listed, pixel)?;
        if !has_tile_lists {
            // Restores the picture, to the last bit.
            self.render(&camera, background)?;
        }
        Ok(explained)
    }

    /// The depth of the splats that a pixel of the frame recorded last shows; `None` if it shows none. For a scene in
    /// pages it is the mean, weighted by the shares of the pixel. Waits for the device.
    ///
    /// # Errors
    /// As [`Renderer::explain`].
    pub fn depth_at(&mut self, pixel: [u32; 2]) -> Result<Option<f32>> {
        let inspection = Inspection::of_attribute(Attribute::Depth);
        if self.shown_in_pages(&inspection).is_none() {
            return Ok(self.explain(pixel)?.depth());
        }
        let Last { camera, .. } = self.last_with(pixel)?;
        let [depth, _, _, alpha] = self.shaded_depths()?.rgba[(pixel[1] * camera.size_px[0] + pixel[0]) as usize];
        Ok((alpha > 0.0).then(|| depth / alpha))
    }

    /// The mean depths of the frame recorded last, row by row, weighted by the shares of a pixel's splats; infinite
    /// where splats have less than half of the light. Waits for the device.
    ///
    /// # Errors
    /// If no frame was recorded, or the path cannot show depths.
    pub fn depths(&mut self) -> Result<Vec<f32>> {
        let depth = |[depth, _, _, alpha]: &[f32; 4]| if *alpha >= 0.5 { depth / alpha } else { f32::INFINITY };
        Ok(self.shaded_depths()?.rgba.iter().map(depth).collect())
    }

    /// The picture of the attribute depth in the frame recorded last.
    fn shaded_depths(&mut self) -> Result<Pixels> {
        let Last { camera, background, .. } = self.last.clone().context("nothing is rendered yet")?;
        let depths = self.inspector(Inspection::of_attribute(Attribute::Depth))?;
        let before = self.inspector.replace(depths);
        let rendered = self.render(&camera, background).and_then(|_| self.pixels());
        self.inspector = before;
        // Restores the picture.
        self.render(&camera, background)?;
        rendered
    }

    /// The frame recorded last, if it has this pixel.
    fn last_with(&self, pixel: [u32; 2]) -> Result<Last> {
        let last = self.last.clone().context("nothing is rendered yet")?;
        let size = last.camera.size_px;
        ensure!(pixel[0] < size[0] && pixel[1] < size[1], "pixel {pixel:?} lies outside of a picture of {size:?}");
        Ok(last)
    }
}
