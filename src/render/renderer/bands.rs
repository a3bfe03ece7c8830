//! Bands of pictures, and pictures that are joined from bands.

use anyhow::Result;

use super::Renderer;
use crate::camera::Camera;
use crate::gpu::{Access, Commands, Image};
use crate::options::Options;
use crate::render::band::Band;
use crate::render::frame::Shot;
use crate::render::recorded::{Counted, FRAME, Frame, Recorded};
use crate::render::slabs::SlabbedFrame;
use crate::rules::{Background, Response};

impl Renderer {
    /// Draws only these rows of all pictures from now on, or again all rows. The image and [`Renderer::pixels`] have
    /// the size of the band.
    pub fn set_band(&mut self, band: Option<Band>) {
        self.band = band;
        self.last.iter_mut().for_each(|last| last.has_tile_lists = false);
    }

    /// Bands of the pictures of a camera may begin at multiples of this many rows.
    pub fn band_rows(&self, camera: &Camera) -> u32 {
        self.choice.band_rows(Shot::new(&self.scene, camera))
    }

    /// The reason why pictures of a camera by these options are not drawn in bands; `None` if they can be.
    pub fn whole_because(options: &Options, camera: &Camera) -> Option<&'static str> {
        if options.scale != 1.0 {
            Some("pictures that are drawn smaller and then enlarged are drawn as a whole")
        } else if options.simplifies_hidden() {
            Some("pictures whose hidden parts are drawn coarser are drawn as a whole")
        } else if Self::is_along_rays(options, camera) && Band::is_needed(camera.size_px) {
            // The path rays is faster from end to end: the tables of bands take longer on the host than they save.
            Some("pictures along rays of more than 29 megapixels are drawn as a whole")
        } else {
            None
        }
    }

    /// True if pictures of a camera by these options are drawn along the rays of their pixels.
    pub fn is_along_rays(options: &Options, camera: &Camera) -> bool {
        camera.lens.is_some() || options.rules.response == Response::Ray
    }

    /// Renders a band of a picture into `image`, in the place of the renderer's own.
    ///
    /// # Errors
    /// As [`Renderer::render`].
    pub(in crate::render) fn render_band(
        &mut self,
        image: &mut Image,
        band: Band,
        camera: &Camera,
        background: Background,
    ) -> Result<Frame> {
        std::mem::swap(&mut self.image, image);
        self.set_band(Some(band));
        let rendered = self.render(camera, background);
        self.set_band(None);
        std::mem::swap(&mut self.image, image);
        rendered
    }

    /// Records `copies` of finished bands into the renderer's image, as the picture of the frame that was rendered
    /// last. `joined` has the counts and times of all bands.
    ///
    /// # Errors
    /// If memory runs out.
    pub(in crate::render) fn record_joined(
        &mut self,
        cmd: &mut Commands,
        camera: &Camera,
        joined: SlabbedFrame,
        copies: impl FnOnce(&mut Commands, &Image),
    ) -> Result<Recorded> {
        self.fit_images(camera.size_px, Band::whole(camera.size_px))?;
        // Like one in slabs, the frame is complete whatever its buffers hold.
        self.drawn.in_slabs = true;
        cmd.scope(FRAME, |cmd| cmd.scope("join", |cmd| copies(cmd, &self.image)));
        cmd.barrier(Access::SHADER_WRITE, Access::SHADER_READ | Access::COPY_READ);
        let number = self.last.as_ref().map_or(0, |last| last.number);
        let counted = Counted::Slabbed(Box::new(joined));
        Ok(Recorded { number, counted, limits: self.drawn, sampled: None, first_picture_ms: 0.0 })
    }
}
