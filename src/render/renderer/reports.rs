//! The reports of a renderer: residency of pages, memory, least bytes of stages.

use super::Renderer;
use crate::camera::Camera;
use crate::gpu::{MemoryUse, Results};
use crate::render::frame::{Shot, drawn_camera};
use crate::render::lod::LodReport;
use crate::render::recorded::Recorded;
use crate::render::sample::LevelSampler;
use crate::render::shaders::Totals;
use crate::render::streaming::{PageStreamer, Residency};

impl Renderer {
    /// The fewest bytes that each stage of a frame moves through device memory, by the name of its scope: each input
    /// read once, each output written once. The frame is the one recorded last, seen by `camera`, which counted
    /// `totals`.
    #[doc(hidden)]
    pub fn least_bytes(&self, totals: &Totals, camera: &Camera) -> Vec<(&'static str, u64)> {
        let camera = &drawn_camera(&self.options, camera);
        let mut stages = self.choice.least_bytes(self.drawn.path, Shot::new(&self.scene, camera), totals);
        if self.upscaler.is_some() {
            let pixels = |size: [u32; 2]| size.iter().map(|side| u64::from(*side)).product::<u64>();
            stages.push(("upscale", 16 * (pixels(camera.size_px) + pixels(self.image.size()))));
        }
        stages
    }

    /// The report of the levels of detail of a frame, if it was drawn by them.
    #[doc(hidden)]
    pub fn detail(&self, results: &Results, recorded: &Recorded) -> Option<LodReport> {
        recorded.detail(results, &self.options)
    }

    /// The residency of the pages of the last picture, if pictures do not wait for pages.
    pub fn residency(&self) -> Option<Residency> {
        let residency = self.choice.streamer.as_ref()?.residency();
        Some(Residency { is_pending: residency.is_pending || self.choice.is_behind(), ..residency })
    }

    /// True if another picture would show pages that the last one did not, or take the stop depths of its own view, or
    /// is needed to request pages.
    #[doc(hidden)]
    pub fn has_news(&mut self) -> bool {
        let is_behind = self.choice.is_behind();
        self.choice.streamer.as_mut().is_some_and(|streamer| streamer.needs_frame() || is_behind)
    }

    /// Takes the reason why a page could not be read beside the pictures, which show coarser levels in its place.
    #[doc(hidden)]
    pub fn take_problem(&mut self) -> Option<anyhow::Error> {
        self.choice.streamer.as_mut().and_then(PageStreamer::take_problem)
    }

    /// The engines of its paths.
    #[cfg(test)]
    pub(in crate::render) fn choice(&mut self) -> &mut crate::render::path_choice::PathChoice {
        &mut self.choice
    }

    /// The page streamer of a renderer that streams.
    #[cfg(test)]
    pub(in crate::render) fn streamer(&mut self) -> &mut PageStreamer {
        self.choice.streamer.as_mut().expect("the renderer streams")
    }

    /// The name and the bytes of every buffer and image except those of the scene.
    #[doc(hidden)]
    pub fn buffers(&self) -> Vec<(&str, u64)> {
        let mut buffers = self.choice.buffers();
        buffers.push(("image", self.image.bytes()));
        buffers.extend(self.sampler.iter().flat_map(LevelSampler::buffers));
        buffers.extend(self.certificate.iter().map(|certificate| ("certificate", certificate.bytes())));
        buffers.extend(self.upscaler.iter().map(|upscaler| ("drawn image", upscaler.drawn.bytes())));
        buffers
    }

    /// The state of the memory budget of the device.
    pub fn memory(&self) -> MemoryUse {
        self.device.memory()
    }
}
