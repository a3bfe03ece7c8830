//! Every intermediate buffer of a frame, and how large it must be.

use anyhow::Result;

use crate::render::shaders::{PortableDispatches, Splat, Totals};
use crate::render::portable::sort::{Pairs, SORT_CHUNK, SortScratch};
use crate::gpu::{Buffer, Commands, Device, DispatchSize};
use crate::host_memory::OutOfMemory;

/// Elements that one workgroup takes; the shaders' constants of the same names.
pub(super) const CULL_CHUNK: usize = 1024;
const WORKGROUP: usize = 256;
const SCAN_CHUNK: usize = 2048;
const DUPLICATE_CHUNK: usize = 1024;
const TILE_CLASSES: usize = 6;

/// What a frame needs room for.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Capacity {
    /// Gaussians in the scene, all of them.
    pub gaussians: usize,
    /// Gaussians that may touch the image.
    pub visible: u64,
    /// Tile rows touched, over all splats.
    pub spans: u64,
    /// Tiles touched, over all splats.
    pub instances: u64,
    /// Tiles of the image.
    pub tiles: usize,
}

impl Capacity {
    /// A first guess for a scene, within what a device binds: a frame that needs more says so, and is repeated.
    pub fn guess(device: &Device, gaussians: usize, tiles: usize) -> Self {
        let most = |bytes: usize| device.facts().limits.storage_range / bytes as u64;
        // Captured scenes at 1080p: half of the Gaussians are visible, in 2.3 rows and 6 tiles each.
        let visible = (gaussians as u64 / 4 * 3 + 1024).min(gaussians as u64).min(most(size_of::<Splat>()));
        let instances = (6 * visible).max(1 << 16);
        Self { gaussians, visible, spans: (2 * visible).min(most(4)), instances: instances.min(most(4)), tiles }
    }

    /// What the totals of a frame ask for.
    pub fn of(totals: &Totals, gaussians: usize, tiles: usize) -> Self {
        Self {
            gaussians,
            visible: totals.visible.into(),
            spans: totals.spans.into(),
            instances: u64::from(totals.listed_high) << 32 | u64::from(totals.listed_low),
            tiles,
        }
    }

    fn max(self, other: Self) -> Self {
        Self {
            gaussians: self.gaussians.max(other.gaussians),
            visible: self.visible.max(other.visible),
            spans: self.spans.max(other.spans),
            instances: self.instances.max(other.instances),
            tiles: self.tiles.max(other.tiles),
        }
    }

    /// Room for it where `room` is not enough: with some to spare, and without. What already has room stays as it is.
    pub(super) fn rooms_beyond(self, room: Self) -> [Self; 2] {
        let spare = |needed: u64, room: u64| if needed > room { needed + needed / 8 } else { room };
        let exact = self.max(room);
        let roomy = Self {
            visible: spare(self.visible, room.visible).min(exact.gaussians as u64),
            spans: spare(self.spans, room.spans),
            instances: spare(self.instances, room.instances),
            ..exact
        };
        [roomy, exact]
    }

    /// Whether there is room for it.
    pub(super) fn fits(self, room: Self) -> bool {
        self.max(room) == room
    }
}

/// Makes buffers for the first of `rooms`, or for the second if there is no memory for that.
pub(super) fn first_that_fits<T>([roomy, exact]: [Capacity; 2], make: impl Fn(Capacity) -> Result<T>) -> Result<T> {
    match make(roomy) {
        Err(error) if error.is::<OutOfMemory>() => make(exact),
        other => other,
    }
}

/// A buffer's length, if 32-bit offsets reach its end.
pub(super) fn length(name: &str, elements: u64) -> Result<usize, OutOfMemory> {
    let refusal = |_| OutOfMemory {
        name: name.to_owned(),
        bytes: Some(elements.saturating_mul(4)),
        reason: "32-bit offsets reach no further".to_owned(),
    };
    u32::try_from(elements).map(|length| length as usize).map_err(refusal)
}

/// The buffers of one frame in the making.
pub struct PortableWorkspace {
    pub(super) room: Capacity,
    pub(crate) totals: Buffer<Totals>,
    pub(crate) dispatches: Buffer<PortableDispatches>,
    /// A bit per Gaussian.
    pub(crate) visible_masks: Buffer<u32>,
    pub(super) chunk_counts: Buffer<u32>,
    pub(crate) gaussian_from_splat: Buffer<u32>,
    pub(crate) splats: Buffer<Splat>,
    /// Depth key and splat.
    pub(crate) depths: Pairs,
    pub(crate) span_ranges: Buffer<[u32; 2]>,
    pub(crate) spans: Buffer<u32>,
    pub(crate) tile_counts: Buffer<u32>,
    pub(super) scan_sums: Buffer<u32>,
    pub(crate) instance_offsets: Buffer<u32>,
    pub(super) first_ranks: Buffer<u32>,
    /// Tile key and splat.
    pub(crate) instances: Pairs,
    pub(crate) sort: SortScratch,
    pub(crate) ranges: Buffer<[u32; 2]>,
    pub(super) tiles_by_class: Buffer<u32>,
}

impl PortableWorkspace {
    pub fn new(device: &Device, room: Capacity) -> Result<Self> {
        let visible = length("visible splats", room.visible)?;
        let spans = length("tile rows", room.spans)?;
        let instances = length("splat-tile instances", room.instances)?;
        let chunks = room.gaussians.div_ceil(CULL_CHUNK);
        let words = |name: &str, len: usize| Buffer::<u32>::new(device, name, len);
        Ok(Self {
            room,
            totals: Buffer::new(device, "totals", 1)?,
            dispatches: Buffer::new(device, "dispatches", 1)?,
            visible_masks: words("visible masks", chunks * CULL_CHUNK / 32)?,
            chunk_counts: words("chunk counts", chunks)?,
            gaussian_from_splat: words("gaussian from splat", visible)?,
            splats: Buffer::new(device, "splats", visible)?,
            depths: Pairs::new(device, "depth", visible)?,
            span_ranges: Buffer::new(device, "span ranges", visible)?,
            spans: words("spans", spans)?,
            tile_counts: words("tile counts", visible)?,
            scan_sums: words("scan sums", visible.div_ceil(SCAN_CHUNK))?,
            instance_offsets: words("instance offsets", visible)?,
            first_ranks: words("first ranks", instances.div_ceil(DUPLICATE_CHUNK))?,
            instances: Pairs::new(device, "instance", instances)?,
            sort: SortScratch::new(device, visible.max(instances))?,
            ranges: Buffer::new(device, "ranges", room.tiles)?,
            tiles_by_class: words("tiles by class", TILE_CLASSES * room.tiles)?,
        })
    }

    /// Makes room for `demand` and a little more, if there is not enough; true if it had to.
    pub fn grow(&mut self, device: &Device, demand: Capacity) -> Result<bool> {
        if demand.fits(self.room) {
            return Ok(false);
        }
        let rooms = demand.rooms_beyond(self.room);
        *self = Self::new(device, Capacity::default())?; // frees what is there before the larger buffers are made
        *self = first_that_fits(rooms, |room| Self::new(device, room))?;
        Ok(true)
    }

    /// Writes the counts of a frame, and the dispatches over them, from the host.
    pub(crate) fn set_totals(&self, cmd: &mut Commands, totals: Totals) -> Result<()> {
        let groups = |elements: u32, chunk: usize| {
            let [x, y] = DispatchSize::Groups(elements.div_ceil(chunk as u32).into()).groups(1);
            [x, y, 1]
        };
        let (visible, instances) = (totals.visible_kept, totals.listed_kept);
        let dispatches = PortableDispatches {
            over_visible: groups(visible, WORKGROUP),
            sort_visible: groups(visible, SORT_CHUNK),
            scan_visible: groups(visible, SCAN_CHUNK),
            duplicate: groups(instances, DUPLICATE_CHUNK),
            sort_instances: groups(instances, SORT_CHUNK),
            over_instances: groups(instances, WORKGROUP),
        };
        cmd.upload(&self.totals, 0, 1, |memory| memory[0] = totals)?;
        cmd.upload(&self.dispatches, 0, 1, |memory| memory[0] = dispatches)
    }

    /// Every buffer's name and bytes.
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
