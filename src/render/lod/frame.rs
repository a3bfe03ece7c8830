//! Pictures of scenes in pages that are drawn at once and without a wait: the GPU lists the pages, and the host hears
//! afterwards whether one was missing.

use anyhow::Result;

use super::selection::Chooser;
use crate::gpu::{Access, Buffer, Commands, Device, Readback};
use crate::render::fast::{FastFrame, FastPipeline};
use crate::render::frame::{Shot, position_of, slab};
use crate::render::inspect::Attribute;
use crate::render::pages::{Count, Listed, PageProjection, first_page};
use crate::render::scene::GpuScene;
use crate::render::shaders::CutState;

/// The stages before those of the fast path.
pub struct AtOnce {
    /// What splats show in place of their colours.
    pub attribute: Option<Attribute>,
    project: PageProjection,
    /// The indices of Gaussians and the words of levels, where no page has them.
    no_words: Buffer<u32>,
}

impl AtOnce {
    pub fn new(device: &Device, fast: &FastPipeline, attribute: Option<Attribute>) -> Result<Self> {
        let project = PageProjection::new(device, fast, attribute)?;
        Ok(Self { attribute, project, no_words: Buffer::new(device, "no words", 1)? })
    }

    /// Records a picture, which is complete if the capacity of `work` was enough and no page of the returned state is
    /// missing.
    ///
    /// # Errors
    /// If memory runs out.
    pub fn record(&self, cmd: &mut Commands, frame: &FastFrame, chooser: &Chooser) -> Result<Readback<CutState>> {
        let FastFrame { work, options, shot: Shot { scene, camera }, target, grid, .. } = *frame;
        chooser.record(cmd, scene, camera, options)?;
        cmd.barrier(Access::SHADER_WRITE, Access::SHADER | Access::INDIRECT);
        let whole = slab(&(0..position_of(frame.depth_keys().limit()) + position_of(1)));
        let [indices, levels] = scene.indices_and_lod(&self.no_words);
        let listed = Listed { elements: &chooser.listed, first_page: first_page(scene), indices, levels };
        cmd.scope("project", |cmd| {
            let count = Count::OnDevice(&chooser.state, Chooser::over_pages());
            self.project.record(cmd, frame, &listed, count, whole);
        });
        frame.pipeline.record_projected(cmd, work, grid, target);
        chooser.read(cmd)
    }
}

/// The pages of a picture that was not complete for want of pages: brings all of them, if they fit.
///
/// # Errors
/// If a page cannot be read.
pub fn bring_missing(device: &Device, chooser: &Chooser, scene: &GpuScene, state: &CutState) -> Result<bool> {
    let mut pages: Vec<u32> =
        chooser.listed_pages(device, scene, state)?.into_iter().map(|chosen| chosen.page).collect();
    pages.sort_unstable();
    pages.dedup();
    let mut pool = chooser.paged.cache();
    if pages.len() > pool.capacity() {
        return Ok(false);
    }
    pool.bring(device, &pages)?;
    Ok(true)
}
