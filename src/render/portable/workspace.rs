//! Every intermediate buffer of a frame of the portable path.

use anyhow::Result;

use super::sort::{Pairs, SortScratch};
use crate::gpu::{Buffer, Device};
use crate::render::capacity::{Capacity, length};
use crate::render::shaders::portable::{CULL_CHUNK, DUPLICATE_CHUNK, SCAN_CHUNK};
use crate::render::shaders::shared::TILE_CLASSES;
use crate::render::shaders::{PortableDispatches, Splat, Totals};

/// The buffers of one frame of the portable path. Those that [`PortableStages`](super::PortableStages) shows are
/// public.
pub struct PortableWorkspace {
    pub(in crate::render) capacity: Capacity,
    pub totals: Buffer<Totals>,
    pub dispatches: Buffer<PortableDispatches>,
    /// A bit per Gaussian.
    pub visible_masks: Buffer<u32>,
    pub(in crate::render) chunk_counts: Buffer<u32>,
    pub gaussian_from_splat: Buffer<u32>,
    pub splats: Buffer<Splat>,
    /// Depth key and number of every splat.
    pub depths: Pairs,
    pub span_ranges: Buffer<[u32; 2]>,
    pub spans: Buffer<u32>,
    pub tile_counts: Buffer<u32>,
    pub(in crate::render) scan_sums: Buffer<u32>,
    pub instance_offsets: Buffer<u32>,
    pub(in crate::render) first_ranks: Buffer<u32>,
    /// Tile key and splat of every instance.
    pub instances: Pairs,
    pub sort: SortScratch,
    pub ranges: Buffer<[u32; 2]>,
    pub(in crate::render) tiles_by_class: Buffer<u32>,
}

impl PortableWorkspace {
    /// Makes buffers of this capacity.
    ///
    /// # Errors
    /// If device memory runs out.
    pub fn new(device: &Device, capacity: Capacity) -> Result<Self> {
        Self::with_splats(device, capacity, capacity.visible)
    }

    /// Makes buffers of this capacity, with another number of splats.
    ///
    /// # Errors
    /// If device memory runs out.
    pub(in crate::render) fn with_splats(device: &Device, capacity: Capacity, splats: u64) -> Result<Self> {
        let visible = length("visible splats", capacity.visible)?;
        let spans = length("tile rows", capacity.spans)?;
        let instances = length("splat-tile instances", capacity.listed)?;
        let chunks = capacity.gaussians.div_ceil(CULL_CHUNK as usize);
        let words = |name: &str, len: usize| Buffer::<u32>::new(device, name, len);
        Ok(Self {
            capacity,
            totals: Buffer::new(device, "totals", 1)?,
            dispatches: Buffer::new(device, "dispatches", 1)?,
            visible_masks: words("visible masks", chunks * CULL_CHUNK as usize / 32)?,
            chunk_counts: words("chunk counts", chunks)?,
            gaussian_from_splat: words("gaussian from splat", visible)?,
            splats: Buffer::new(device, "splats", length("splats", splats)?)?,
            depths: Pairs::new(device, "depth", visible)?,
            span_ranges: Buffer::new(device, "span ranges", visible)?,
            spans: words("spans", spans)?,
            tile_counts: words("tile counts", visible)?,
            scan_sums: words("scan sums", visible.div_ceil(SCAN_CHUNK as usize))?,
            instance_offsets: words("instance offsets", visible)?,
            first_ranks: words("first ranks", instances.div_ceil(DUPLICATE_CHUNK as usize))?,
            instances: Pairs::new(device, "instance", instances)?,
            sort: SortScratch::new(device, visible.max(instances))?,
            ranges: Buffer::new(device, "ranges", capacity.cells)?,
            tiles_by_class: words("tiles by class", TILE_CLASSES as usize * capacity.cells)?,
        })
    }

    /// Makes the buffers large enough for `demand`. Returns true if they were too small.
    ///
    /// # Errors
    /// If device memory runs out. The buffers are then empty.
    pub fn grow(&mut self, device: &Device, demand: Capacity) -> Result<bool> {
        let current = self.capacity;
        if demand.fits(current) {
            return Ok(false);
        }
        *self = Self::new(device, Capacity::default())?; // frees the old buffers before larger ones are made
        *self = demand.grow(current, |capacity| Self::new(device, capacity))?;
        Ok(true)
    }

    /// The name and the bytes of every buffer.
    pub fn buffers(&self) -> Vec<(&str, u64)> {
        let words = [
            &self.visible_masks,
            &self.chunk_counts,
            &self.gaussian_from_splat,
            &self.spans,
            &self.tile_counts,
            &self.scan_sums,
            &self.instance_offsets,
            &self.first_ranks,
            &self.tiles_by_class,
        ];
        let sorted = [self.depths.buffers(), self.instances.buffers()].into_iter().flatten().chain(self.sort.buffers());
        let mut all: Vec<_> = words.into_iter().chain(sorted).map(Buffer::footprint).collect();
        all.extend([
            self.totals.footprint(),
            self.dispatches.footprint(),
            self.splats.footprint(),
            self.span_ranges.footprint(),
            self.ranges.footprint(),
        ]);
        all
    }
}
