//! Frames of paged scenes in one submission: the GPU selects the pages, and the host reads afterwards whether a page
//! was missing.

use anyhow::Result;

use super::selection::LodSelector;
use crate::gpu::{Access, Buffer, Commands, Device, Readback};
use crate::render::fast::{FastFrame, FastPipeline};
use crate::render::frame::{position_of, slab};
use crate::render::inspect::Attribute;
use crate::render::pages::{DrawList, PageCount, PageProjection, first_page};
use crate::render::scene::GpuScene;
use crate::render::shaders::SelectionState;

/// The stages before the stages of the fast path.
pub struct PagedFrame {
    /// The attribute that splats show instead of their colours.
    pub attribute: Option<Attribute>,
    project: PageProjection,
    /// Stands for the indices of Gaussians or the words of levels if pages have none.
    no_words: Buffer<u32>,
}

impl PagedFrame {
    pub fn new(device: &Device, fast: &FastPipeline, attribute: Option<Attribute>) -> Result<Self> {
        let project = PageProjection::new(device, fast, attribute)?;
        Ok(Self { attribute, project, no_words: Buffer::new(device, "no words", 1)? })
    }

    /// Records a frame, which is complete if it fits the capacity of its buffers and the returned state has no missing
    /// page.
    ///
    /// # Errors
    /// If memory runs out.
    pub fn record(
        &self,
        cmd: &mut Commands,
        frame: &FastFrame,
        device: &Device,
        selector: &mut LodSelector,
    ) -> Result<Readback<SelectionState>> {
        let FastFrame { work, options, shot, target, grid, .. } = *frame;
        let scene = shot.scene;
        selector.record(cmd, shot, options)?;
        cmd.barrier(Access::SHADER_WRITE, Access::SHADER | Access::INDIRECT);
        let whole = slab(&(0..position_of(frame.depth_keys().limit()) + position_of(1)));
        let [indices, levels] = scene.indices_and_lod(&self.no_words);
        let draw_list = DrawList { elements: &selector.draw_list, first_page: first_page(scene), indices, levels };
        cmd.scope("project", |cmd| {
            let count = PageCount::OnDevice(&selector.state, LodSelector::page_dispatch());
            self.project.record(cmd, frame, &draw_list, count, whole);
        });
        frame.pipeline.record_projected(cmd, work, grid, target);
        selector.occlusion.record(device, cmd, frame)?;
        selector.read(cmd)
    }
}

/// Loads all pages of a frame that lacked some. Returns false if they do not fit into the page cache.
///
/// # Errors
/// If a page cannot be read.
pub fn load_missing(device: &Device, selector: &LodSelector, scene: &GpuScene, state: &SelectionState) -> Result<bool> {
    let mut pages: Vec<u32> =
        selector.selected_pages(device, scene, state)?.into_iter().map(|selected| selected.page).collect();
    pages.sort_unstable();
    pages.dedup();
    let mut cache = selector.paged.cache();
    if pages.len() > cache.capacity() {
        return Ok(false);
    }
    cache.load(device, &pages)?;
    Ok(true)
}
