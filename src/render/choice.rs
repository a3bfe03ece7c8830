//! The two ways to draw a frame, and which of them one takes.

use anyhow::Result;

use crate::render::portable::blend::{Target, Variation};
use crate::render::fast::pipeline::FastPipeline;
use crate::render::fast::workspace::FastWorkspace;
use crate::render::gpu_scene::GpuScene;
use crate::render::inspect::inspector::Inspector;
use crate::render::portable::pipeline::PortablePipeline;
use crate::render::trial;
use crate::render::shaders::Totals;
use crate::render::frame::tiles;
use crate::render::portable::workspace::{Capacity, PortableWorkspace};
use crate::camera::Camera;
use crate::gpu::{Buffer, Commands, Device};
use crate::host_memory::OutOfMemory;
use crate::options::Options;

/// The portable path, which draws everything, and the fast one where it can be taken.
pub(super) struct PathChoice {
    pub renderer: PortablePipeline,
    pub work: PortableWorkspace,
    passes: u32,
    fast: Option<(FastPipeline, FastWorkspace)>,
    /// The frame at hand has longer lists than the fast path draws.
    is_too_long: bool,
    /// Why the fast path is not taken though the device has it.
    pub notice: Option<String>,
}

/// What a frame has to keep to.
#[derive(Clone, Copy, PartialEq)]
pub(super) struct Limits {
    pub is_fast: bool,
    /// What it has room for.
    pub room: Capacity,
    pub longest_list: u32,
}

impl PathChoice {
    pub fn new(device: &Device, options: &Options, scene: &GpuScene, variation: Variation) -> Result<Self> {
        let layout = scene.layout();
        // What is counted, certified or looked at are the lists of the portable path.
        let fast = if variation == Variation::default() { FastPipeline::new(device, options, layout)? } else { None };
        let guess = Capacity::guess(device, scene.len(), 1);
        let fast = fast.map(|fast| {
            let work = FastWorkspace::new(device, FastWorkspace::guess(device, guess), fast.splat_elements())?;
            anyhow::Ok((fast, work))
        });
        let fast = fast.transpose()?;
        let mut paths = Self {
            renderer: PortablePipeline::varied(device, options, layout, variation)?,
            // What is drawn on the fast path needs no room on the other.
            work: PortableWorkspace::new(device, if fast.is_some() { Capacity::default() } else { guess })?,
            passes: 1,
            fast,
            is_too_long: false,
            notice: None,
        };
        if paths.fast.is_some() && self_test::is_due(device) {
            paths.try_fast(device, scene)?;
        }
        Ok(paths)
    }

    /// Drops the fast path if it does not draw what the portable one does.
    fn try_fast(&mut self, device: &Device, scene: &GpuScene) -> Result<()> {
        let disagreement = self.disagreement(device, scene)?;
        (self.passes, self.is_too_long) = (1, false);
        let mut room = Capacity::default();
        if let Some(difference) = disagreement {
            self.fast = None;
            room = Capacity::guess(device, scene.len(), 1);
            self.notice = Some(format!(
                "the device's fast path differs from the portable one by {difference:.3} and is not taken"
            ));
        }
        self.work = PortableWorkspace::new(device, room)?;
        Ok(())
    }

    #[cfg(test)]
    pub fn replace_fast(&mut self, device: &Device, scene: &GpuScene, fast: FastPipeline) -> Result<()> {
        self.fast.as_mut().expect("there is a fast path").0 = fast;
        self.try_fast(device, scene)
    }

    /// Which of the heights of blocks the fast path takes, if not the picture's own.
    pub fn set_block_height(&mut self, height: Option<usize>) {
        if let Some((fast, _)) = &mut self.fast {
            fast.block_height = height;
        }
    }

    /// Starts from this much room.
    pub fn set_room(&mut self, device: &Device, room: Capacity) -> Result<()> {
        match &mut self.fast {
            Some((fast, work)) => *work = FastWorkspace::new(device, room, fast.splat_elements())?,
            None => self.work = PortableWorkspace::new(device, room)?,
        }
        Ok(())
    }

    /// Every buffer's name and bytes.
    pub fn buffers(&self) -> Vec<(&str, u64)> {
        self.work.buffers().into_iter().chain(self.fast.iter().flat_map(|(_, work)| work.buffers())).collect()
    }

    /// What the frame of these limits counts.
    pub fn totals(&self, limits: Limits) -> &Buffer<Totals> {
        match &self.fast {
            Some((_, work)) if limits.is_fast => &work.totals,
            _ => &self.work.totals,
        }
    }

    /// Makes room for a frame of this size, on the path that it takes.
    pub fn prepare(&mut self, device: &Device, gaussians: usize, size: [u32; 2], needs_lists: bool) -> Result<Limits> {
        let demand = |counted: [u32; 2]| {
            let tiles = counted.iter().map(|n| *n as usize).product();
            Capacity { gaussians, tiles, ..Capacity::default() }
        };
        let is_ruled_out = needs_lists || self.is_too_long;
        let fast = self.fast.as_mut().filter(|(fast, _)| !is_ruled_out && fast.takes(size, gaussians));
        if let Some((fast, work)) = fast
            && grown(work.grow(device, demand(fast.bins(size, gaussians)), 0))?
        {
            fast.prepare(device, size, gaussians, work.has_long_lists())?;
            return Ok(Limits {
                is_fast: true,
                room: work.room,
                longest_list: fast.longest_list().min(work.longest_list()),
            });
        }
        self.work.grow(device, demand(tiles(size)))?;
        Ok(Limits { is_fast: false, room: self.work.room, longest_list: self.renderer.longest_list(self.passes) })
    }

    /// Records a frame that is prepared.
    pub fn record(
        &self,
        cmd: &mut Commands,
        view: (&GpuScene, &Camera),
        target: Target,
        limits: Limits,
        inspector: Option<&Inspector>,
    ) {
        match &self.fast {
            Some((fast, work)) if limits.is_fast => fast.record(cmd, view, work, target),
            _ => self.renderer.record(cmd, view, &self.work, target, self.passes, inspector),
        }
    }

    /// Whether a frame that counted `totals` kept to its limits. If it did not, the next one has more room, or takes the
    /// portable path where the fast one has not enough.
    pub fn judge(&mut self, device: &Device, totals: &Totals, limits: Limits) -> Result<bool> {
        let demand = Capacity::of(totals, limits.room.gaussians, limits.room.tiles);
        let is_whole = demand.fits(limits.room) && totals.longest_list <= limits.longest_list;
        match &mut self.fast {
            Some((fast, work)) if limits.is_fast => {
                self.is_too_long = totals.longest_list > fast.longest_list();
                if !grown(work.grow(device, demand, totals.longest_list))? {
                    self.fast = None;
                    self.work = PortableWorkspace::new(device, Capacity::guess(device, limits.room.gaussians, 1))?;
                }
            }
            _ if limits.is_fast => {}
            _ => {
                self.work.grow(device, demand)?;
                self.passes = self.passes.max(self.renderer.passes(totals.longest_list));
                // The next frame is judged by its own lists: no picture depends on those before it.
                self.is_too_long &= !is_whole;
            }
        }
        Ok(is_whole)
    }

    /// Whether the portable path still holds a frame of these limits.
    pub fn holds(&self, limits: Limits) -> bool {
        !limits.is_fast && self.work.room == limits.room
    }
}

/// Whether there is memory to grow.
fn grown(result: Result<()>) -> Result<bool> {
    match result {
        Err(error) if error.is::<OutOfMemory>() => Ok(false),
        other => other.map(|()| true),
    }
}
