//! What a renderer tells of its frames and its memory.

use super::Renderer;
use crate::camera::Camera;
use crate::gpu::{MemoryUse, Results};
use crate::render::frame::Shot;
use crate::render::lod::Detailed;
use crate::render::recorded::Recorded;
use crate::render::shaders::Totals;
use crate::render::streaming::{Feed, Residency};

impl Renderer {
    /// The fewest bytes that each stage of a frame moves through device memory, by the name of its scope: each input
    /// read once, each output written once. The frame is the one recorded last, seen by `camera`, which counted
    /// `totals`.
    pub fn least_bytes(&self, totals: &Totals, camera: &Camera) -> Vec<(&'static str, u64)> {
        let camera = &camera.sampled(self.options.drawn_size(camera.size_px));
        let mut stages = self.choice.least_bytes(self.drawn.path, Shot { scene: &self.scene, camera }, totals);
        if self.upscaler.is_some() {
            let pixels = |size: [u32; 2]| size.iter().map(|side| u64::from(*side)).product::<u64>();
            stages.push(("upscale", 16 * (pixels(camera.size_px) + pixels(self.image.size()))));
        }
        stages
    }

    /// What the levels of detail of a frame were cut to, if it was drawn by them.
    pub fn detail(&self, results: &Results, recorded: &Recorded) -> Option<Detailed> {
        recorded.detail(results, &self.options)
    }

    /// How far the pages of the last picture are there, if pictures do not wait for them.
    pub fn residency(&self) -> Option<Residency> {
        self.choice.feed.as_ref().map(Feed::residency)
    }

    /// True if pages were read that the last picture did not have, or another picture is needed to ask for some.
    pub fn has_news(&mut self) -> bool {
        self.choice.feed.as_mut().is_some_and(Feed::has_news)
    }

    /// Why a page could not be read while pictures went on, once. They show coarser levels in its place.
    pub fn take_problem(&mut self) -> Option<anyhow::Error> {
        self.choice.feed.as_mut().and_then(Feed::take_problem)
    }

    /// Device memory of everything except the scene: every buffer's name and bytes.
    pub fn buffers(&self) -> Vec<(&str, u64)> {
        let mut buffers = self.choice.buffers();
        buffers.push(("image", self.image.bytes()));
        buffers.extend(self.certificate.iter().map(|certificate| ("certificate", certificate.bytes())));
        buffers.extend(self.upscaler.iter().map(|upscaler| ("drawn image", upscaler.drawn.bytes())));
        buffers
    }

    /// The state of the ledger of its device.
    pub fn memory(&self) -> MemoryUse {
        self.device.memory()
    }
}
