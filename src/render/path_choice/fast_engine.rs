//! Frames that are drawn in slabs, and frames of scenes in pages.

use std::sync::MutexGuard;

use anyhow::Result;

use super::PathChoice;
use crate::gpu::{Device, Results};
use crate::host_memory::OutOfMemory;
use crate::render::capacity::{Capacity, has_memory};
use crate::render::fast::FastWorkspace;
use crate::render::frame::{Shot, Target};
use crate::render::inspect::Inspector;
use crate::render::lod::bring_missing;
use crate::render::path::Path;
use crate::render::portable::PortableWorkspace;
use crate::render::recorded::OfPages;
use crate::render::scene::{GpuScene, Pool};
use crate::render::slabs::{Drawn, PortableSlabs, Slabs};
use crate::render::streaming::Feed;

impl PathChoice {
    /// Draws what is in device memory from now on, and reads pages meanwhile. Does nothing where pictures are drawn in
    /// another way: of scenes without levels, and on the portable path.
    ///
    /// # Errors
    /// If the coarsest pages cannot be read.
    pub fn stream(&mut self, device: &Device, scene: &GpuScene) -> Result<()> {
        let chooser = self.chooser.as_mut().filter(|chooser| chooser.has_levels() && self.fast.is_some());
        if let (Some(chooser), Some(paged)) = (chooser, scene.paged()) {
            self.feed = Some(Feed::new(device, paged, chooser, self.options.lod_fade > 0.0)?);
        }
        Ok(())
    }

    /// Draws a frame in slabs on a path, and waits for it.
    ///
    /// # Errors
    /// If memory runs out, a page cannot be read, or what is inspected needs the whole scene on the device.
    pub fn draw_in_slabs(
        &mut self,
        device: &Device,
        path: Path,
        shot: Shot,
        target: Target,
        inspector: Option<&Inspector>,
    ) -> Result<Drawn> {
        if path == Path::Portable {
            return self.draw_portable_slabs(device, shot, target, inspector);
        }
        ensure_whole(inspector.is_none())?;
        let Self { fast, options, work, chooser, .. } = self;
        let fast = fast.as_mut().expect("a frame in slabs was prepared");
        let gaussians = shot.scene.placed_len();
        let grid = fast.pipeline.grid(shot.camera.size_px, shot.scene.drawn_len(options));
        let slabs = match &mut fast.slabs {
            Some(slabs) => slabs,
            none => none.insert(Slabs::new(device, &fast.pipeline, shot.scene)?),
        };
        if !has_memory(slabs.fit(device, &mut fast.work, &fast.pipeline, grid, gaussians))? {
            // The buffers of the other path leave too little.
            *work = PortableWorkspace::new(device, Capacity::default())?;
            slabs.fit(device, &mut fast.work, &fast.pipeline, grid, gaussians)?;
        }
        let drawn = slabs.draw(device, (&fast.pipeline, &fast.work, options), chooser.as_mut(), shot, target)?;
        // What fits into one slab fits at once, unless its pages do not.
        let fits = |pool: MutexGuard<Pool>| drawn.parts.pages_in_view <= pool.capacity() as u64;
        fast.needs_slabs = match shot.scene.paged() {
            Some(paged) => !fits(paged.cache()),
            None => drawn.parts.slabs > 1,
        };
        Ok(drawn)
    }

    fn draw_portable_slabs(
        &mut self,
        device: &Device,
        shot: Shot,
        target: Target,
        inspector: Option<&Inspector>,
    ) -> Result<Drawn> {
        ensure_whole(inspector.is_none_or(Inspector::is_of_depths))?;
        let Self { portable, options, work, slabs, fast, chooser, .. } = self;
        let pipeline = portable.as_ref().expect("a frame on the portable path was prepared");
        let slabs = match slabs {
            Some(slabs) => slabs,
            none => none.insert(PortableSlabs::new(device, pipeline, shot.scene)?),
        };
        if !has_memory(slabs.fit(device, work, shot.camera.size_px, shot.scene))? {
            // The buffers of the other path leave too little.
            if let Some(fast) = fast {
                fast.work = FastWorkspace::new(device, Capacity::default(), fast.pipeline.splat_elements())?;
            }
            slabs.fit(device, work, shot.camera.size_px, shot.scene)?;
        }
        let drawn = slabs.draw(device, (pipeline, work, options), chooser.as_mut(), shot, target, inspector)?;
        self.needs_slabs = drawn.parts.slabs > 1;
        Ok(drawn)
    }

    /// True if a frame of a scene in pages lacked no page. If it did, the next one has it, or is drawn in slabs. A
    /// frame that does not wait for pages lacks none.
    ///
    /// # Errors
    /// If a page cannot be read, or memory runs out.
    pub fn judge_pages(
        &mut self,
        device: &Device,
        scene: &GpuScene,
        results: &Results,
        of_pages: &OfPages,
    ) -> Result<bool> {
        let (Some(chooser), Some(fast), Some(paged)) = (&mut self.chooser, &mut self.fast, scene.paged()) else {
            return Ok(true);
        };
        let state = &results.view(&of_pages.state)[0];
        if !chooser.has_room(device, scene, state)? {
            return Ok(false);
        }
        if let Some(demand) = &of_pages.demand {
            if let Some(feed) = &mut self.feed {
                feed.take(state, results, demand);
            }
            return Ok(true);
        }
        if state.missing > 0 {
            fast.needs_slabs = !bring_missing(device, chooser, (scene, paged), state)?;
        }
        Ok(state.missing == 0)
    }
}

/// Fails if a frame in slabs cannot show what is inspected.
fn ensure_whole(can_show: bool) -> Result<()> {
    let reason = "this view needs the whole scene and its lists on the device, which has too little memory".to_owned();
    let problem = OutOfMemory { name: "view".to_owned(), bytes: None, reason };
    if can_show { Ok(()) } else { Err(problem.into()) }
}
