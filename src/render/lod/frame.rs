//! Pictures of scenes in pages that are drawn at once and without a wait: the GPU lists the pages, and the host hears
//! afterwards whether one was missing.

use anyhow::Result;

use super::selection::Chooser;
use crate::gpu::{Access, Buffer, Commands, Device, Readback};
use crate::options::Options;
use crate::render::fast::{FastPipeline, FastWorkspace};
use crate::render::frame::{DepthKeys, Shot, Target};
use crate::render::inspect::Attribute;
use crate::render::pages::{Count, Listed, PageProjection, first_page};
use crate::render::scene::{GpuScene, Paged};
use crate::render::shaders::CutState;
use crate::render::slabs::{place_of, slab};

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
    pub fn record(
        &self,
        cmd: &mut Commands,
        (fast, work, options): (&FastPipeline, &FastWorkspace, &Options),
        chooser: &Chooser,
        Shot { scene, camera }: Shot,
        target: Target,
    ) -> Result<Readback<CutState>> {
        let grid = fast.grid(camera.size_px, scene.drawn_len(options));
        chooser.record(cmd, scene, camera, options)?;
        cmd.barrier(Access::SHADER_WRITE, Access::SHADER | Access::INDIRECT);
        let whole = slab(&(0..place_of(DepthKeys::of(camera, options, &scene.extent).limit()) + place_of(1)));
        let [indices, levels] = scene.indices_and_lod(&self.no_words);
        let listed = Listed { scene, elements: &chooser.listed, first_page: first_page(scene), indices, levels };
        cmd.scope("project", |cmd| {
            let count = Count::OnDevice(&chooser.state, Chooser::over_pages());
            self.project.record(cmd, (&listed, count), (camera, options), whole, work, grid);
        });
        fast.record_projected(cmd, work, grid, target);
        chooser.read(cmd)
    }
}

/// The pages of a picture that was not complete for want of pages: brings all of them, if they fit.
///
/// # Errors
/// If a page cannot be read.
pub fn bring_missing(
    device: &Device,
    chooser: &Chooser,
    (scene, paged): (&GpuScene, &Paged),
    state: &CutState,
) -> Result<bool> {
    let mut pages: Vec<u32> =
        chooser.listed_pages(device, scene, state)?.into_iter().map(|chosen| chosen.page).collect();
    pages.sort_unstable();
    pages.dedup();
    let mut pool = paged.cache();
    if pages.len() > pool.capacity() {
        return Ok(false);
    }
    pool.bring(device, &pages)?;
    Ok(true)
}
