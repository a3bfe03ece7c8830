//! A scene in device memory, as the shaders read it.

use std::ops::Range;
use std::sync::{Arc, Mutex, MutexGuard};

use anyhow::{Result, ensure};
use rayon::prelude::*;

use super::page_cache::{PageCache, PagesRead};
use super::self_test_input::{SELF_TEST_GAUSSIANS, SelfTest, SelfTestInput, self_test, self_test_camera};
use crate::gpu::{Buffer, Commands, Device};
use crate::host_memory::OutOfMemory;
use crate::options::Options;
use crate::packing::{Layout, SH_PLANES, Shape, Statistics, pack_sh, pack_shapes, plane_widths};
use crate::pagefile::{LEVEL_WORDS, PAGE, Pages};
use crate::render::shaders::Grids;
use crate::render::shaders::lod::WEIGHT_SHIFT;
use crate::rules::{LISTED_ALPHA, Rules};
use crate::scene::{Bounds, Gaussians, Grid, SceneInstances, Transform};

/// Gaussians in device memory, in planes with four words per element: one plane of bounds, and as many planes of shapes
/// and of spherical harmonics as the layout needs ([`plane_widths`]). A clone shares the buffers.
#[derive(Clone)]
pub struct GpuScene {
    /// The bits of the mean, and the [`reach`](crate::packing::reach).
    pub(crate) bounds: Buffer<[u32; 4]>,
    /// Rotation, scale, opacity.
    pub(crate) shapes: Vec<Buffer<[u32; 4]>>,
    pub(crate) sh: Vec<Buffer<[u32; 4]>>,
    pub(crate) grids: Buffer<Grids>,
    pub(crate) layout: Layout,
    len: usize,
    /// The number of Gaussians at one scene instance, LOD nodes included.
    pub(crate) nodes: usize,
    pub(crate) extent: Bounds,
    pub(crate) self_test: SelfTest,
    /// Gaussians may be culled where their alpha is below this.
    pub(crate) alpha_min: f32,
    memory: SceneMemory,
}

/// What a scene has besides its planes.
#[derive(Clone, Debug)]
pub(crate) struct SceneInput {
    pub layout: Layout,
    pub extent: Bounds,
    pub alpha_min: f32,
    pub self_test: SelfTest,
}

/// The Gaussians that the planes hold.
#[derive(Clone)]
enum SceneMemory {
    /// All Gaussians of the scene.
    Whole,
    /// The resident pages of the scene.
    Paged(Box<Paged>),
}

/// The pages of a scene, some of which are resident in the planes. A clone shares them.
#[derive(Clone)]
pub(crate) struct Paged {
    cache: Arc<Mutex<PageCache>>,
    /// The slot of each page.
    pub slots: Buffer<u32>,
    /// For each page, the stamp of the last streamed frame that used it, and its priority then.
    pub last_used: Buffer<u32>,
    /// The indices of the Gaussians in the planes.
    pub indices: Buffer<u32>,
    /// The errors and levels of the nodes in the planes, if the scene has levels of detail.
    pub lod: Option<Buffer<u32>>,
    /// The scene instances; without any, the scene is drawn once, as its file holds it.
    instances: Option<SceneInstances>,
    /// The instances of each joined scene; empty if there is one scene, which has all of them.
    instances_of_scenes: Vec<Range<u32>>,
    /// The number of Gaussians at all scene instances, LOD nodes included.
    placed_nodes: usize,
    /// The reason why the pages are stored in another form than the options request.
    notice: Option<Arc<str>>,
}

/// The most scene instances, whose numbers the draw list of pages has bits for.
const MAX_INSTANCES: usize = 1 << WEIGHT_SHIFT;
/// The most instances of joined scenes, whose numbers are in floats.
const MAX_JOINED: u32 = 1 << 23;
/// The number of Gaussians uploaded at a time: enough to share among threads, few enough to need little memory.
pub(super) const UPLOAD_CHUNK: usize = 1 << 17;
/// The number of Gaussians that a thread packs at a time: a multiple of the number that shares an element.
const PACKED_CHUNK: usize = 1 << 11;

/// The fraction of the free memory that the page cache takes; the rest is for pictures, lists and reads.
pub(crate) const CACHE_FRACTION: f64 = 0.65;
/// The least bytes of the lists and other buffers of a frame.
const MIN_LIST_BYTES: u64 = 8 << 20;
/// The least capacity of the page cache, in pages.
const MIN_PAGES: usize = 64;

/// The most Gaussians of all scene instances together that can be sorted.
const MAX_POSITIONS: u64 = u32::MAX as u64;

/// The name of the plane that every scene has, with an element per Gaussian.
const BOUNDS: &str = "bounds";

impl GpuScene {
    /// Uploads `gaussians`, with only the SH degree and precision that the scene needs and `options` allow. Waits for
    /// the device.
    ///
    /// # Errors
    /// If device memory runs out or a plane is longer than the device can bind.
    #[doc(hidden)]
    pub fn new(device: &Device, gaussians: &Gaussians, options: &Options) -> Result<Self> {
        Self::with(device, gaussians, &Statistics::of(gaussians), options)
    }

    /// Fails if the device cannot draw a scene of `count` Gaussians, however they are stored.
    ///
    /// # Errors
    /// [`OutOfMemory`](crate::host_memory::OutOfMemory).
    #[doc(hidden)]
    pub fn check_count(device: &Device, count: usize) -> Result<()> {
        Ok(Buffer::<[u32; 4]>::check_len(device, BOUNDS, count)?)
    }

    /// Uploads a scene for [`Renderer::certified`](crate::render::Renderer::certified), which has to draw Gaussians
    /// that other renderers may cull.
    ///
    /// # Errors
    /// As for [`new`](Self::new).
    #[doc(hidden)]
    pub fn certifiable(
        device: &Device,
        gaussians: &Gaussians,
        statistics: &Statistics,
        options: &Options,
    ) -> Result<Self> {
        let rules = Rules { alpha_min: LISTED_ALPHA, ..options.rules };
        Self::with(device, gaussians, statistics, &Options { rules, ..*options })
    }

    /// Uploads `gaussians` as [`new`](Self::new) does, with known statistics.
    ///
    /// # Errors
    /// As for [`new`](Self::new).
    #[doc(hidden)]
    pub fn with(device: &Device, gaussians: &Gaussians, statistics: &Statistics, options: &Options) -> Result<Self> {
        let len = gaussians.len();
        let tested = SelfTestInput::of(gaussians, options.rules.near);
        let input = SceneInput {
            layout: Layout::of(statistics, options),
            extent: statistics.extent,
            alpha_min: options.rules.alpha_min,
            self_test: self_test(move || tested),
        };
        let scene = Self::allocated(device, len, &input)?;
        let mut commands = Commands::new(device)?;
        scene.upload_grids(&mut commands)?;
        let mut in_flight = commands.submit()?;
        for first in (0..len).step_by(UPLOAD_CHUNK) {
            let mut commands = Commands::new(device)?;
            scene.upload(&mut commands, gaussians, first..len.min(first + UPLOAD_CHUNK))?;
            // Dropping the previous chunk waits for it, so one chunk is copied while the next is prepared.
            in_flight = commands.submit()?;
        }
        in_flight.wait()?;
        Ok(scene)
    }

    /// A scene of `len` Gaussians in planes without content.
    fn allocated(device: &Device, len: usize, input: &SceneInput) -> Result<Self> {
        let SceneInput { layout, extent, alpha_min, self_test } = input.clone();
        Ok(Self {
            bounds: Buffer::new(device, BOUNDS, len)?,
            shapes: planes(device, "shapes", layout.shape_words(), len)?,
            sh: planes(device, "sh", layout.sh_words(), len)?,
            grids: Buffer::new(device, "grids", 1)?,
            layout,
            len,
            nodes: len,
            extent,
            self_test,
            alpha_min,
            memory: SceneMemory::Whole,
        })
    }

    /// A scene of `len` Gaussians whose planes and grids are to be filled: those of `spare`, if they are large enough.
    ///
    /// # Errors
    /// [`OutOfMemory`] if fewer than `reserve` bytes, and some for lists, would stay free.
    pub(crate) fn unfilled(
        device: &Device,
        len: usize,
        input: &SceneInput,
        spare: Option<Self>,
        reserve: u64,
    ) -> Result<Self> {
        let SceneInput { layout, extent, alpha_min, self_test } = input.clone();
        if let Some(spare) = spare.filter(|spare| spare.is_on(device) && spare.has_planes_for(&layout, len)) {
            return Ok(Self { layout, extent, alpha_min, self_test, ..spare });
        }
        check_room(device, layout.bytes_each() * len as u64, reserve)?;
        Self::allocated(device, len, input)
    }

    /// True if the planes of this scene can hold `len` Gaussians of this layout.
    pub(crate) fn has_planes_for(&self, layout: &Layout, len: usize) -> bool {
        let words = |layout: &Layout| [layout.shape_words(), layout.sh_words()];
        !self.is_paged() && self.len == len && words(&self.layout) == words(layout)
    }

    /// Uploads the grids of the layout.
    pub(crate) fn upload_grids(&self, commands: &mut Commands) -> Result<()> {
        commands.upload(&self.grids, 0, 1, |memory| memory[0] = grids(&self.layout))
    }

    /// Uploads `gaussians` if `reserve` bytes, and some for lists, stay free.
    ///
    /// # Errors
    /// As for [`new`](Self::new).
    pub(crate) fn with_reserve(
        device: &Device,
        gaussians: &Gaussians,
        statistics: &Statistics,
        options: &Options,
        reserve: u64,
    ) -> Result<Self> {
        check_room(device, Layout::of(statistics, options).bytes_each() * gaussians.len() as u64, reserve)?;
        Self::with(device, gaussians, statistics, options)
    }

    /// Makes a page cache for a scene, of a fraction of the free device memory less `reserve` bytes. It has a slot for
    /// every page if they fit.
    ///
    /// # Errors
    /// If the least number of pages does not fit, or a page cannot be read.
    pub(crate) fn of_pages(device: &Device, pages: &Pages, options: &Options, reserve: u64) -> Result<Self> {
        let (all, each, free) = (pages.pages().len(), PageCache::bytes_each(pages), device.free_bytes());
        let least = MIN_PAGES.min(all) as u64 * each;
        let needed = reserve + ((least as f64 / CACHE_FRACTION) as u64).max(least + MIN_LIST_BYTES);
        if free < needed {
            let limit = device.memory().user_limit.map_or_else(String::new, |limit| format!(", the limit is {limit}"));
            let reason = format!("{free} bytes of device memory are left for them{limit}");
            return Err(
                OutOfMemory { name: "pages, lists and pictures".to_owned(), bytes: Some(needed), reason }.into()
            );
        }
        let layout = pages.layout().clone();
        let limits = &device.capabilities().limits;
        let widest = plane_widths(layout.sh_words()).fold(4, usize::max);
        let longest = limits.storage_range.min(limits.allocation) / (4 * widest * PAGE) as u64;
        let room = (CACHE_FRACTION * (free - reserve) as f64) as u64 / each;
        let slots = (room.min(longest) as usize).min(all);
        let len = slots * PAGE;
        let bounds = Buffer::new(device, BOUNDS, len)?;
        let shapes = planes(device, "shapes", layout.shape_words(), len)?;
        let sh = planes(device, "sh", layout.sh_words(), len)?;
        let indices = Buffer::<u32>::new(device, "indices of Gaussians", len)?;
        let all = std::iter::once(&bounds).chain(&shapes).map(Buffer::words);
        let has_lod = pages.levels().is_some();
        let lod = has_lod.then(|| Buffer::<u32>::new(device, "levels", LEVEL_WORDS * len)).transpose()?;
        let all = all.chain([indices.words()]).chain(sh.iter().map(Buffer::words));
        let all = all.chain(lod.iter().map(Buffer::words)).collect();
        let mut cache = PageCache::new(device, pages.clone(), all, slots)?;
        let first: Vec<u32> = (0..slots.min(SELF_TEST_GAUSSIANS / PAGE) as u32).collect();
        cache.load(device, &first)?;
        let mut geometry = vec![0; first.len() * pages.geometry_words()];
        pages.read_geometry(0..first.len(), &mut geometry)?;
        // Pages of the first scene, without those of its levels.
        let own = (0..first.len().min(pages.scenes()[0].end)).take_while(|page| pages.level(*page).level == 0);
        let elements = own
            .zip(geometry.chunks(pages.geometry_words()))
            .flat_map(|(page, words)| words.as_chunks::<4>().0[..pages.pages()[page].count as usize].iter());
        let means: Vec<_> = elements.map(|[x, y, z, _]| [*x, *y, *z].map(f32::from_bits)).collect();
        let count = pages.statistics().count;
        let hash = blake3::hash(bytemuck::cast_slice(&geometry));
        let tested = SelfTestInput { camera: self_test_camera(&means, options.rules.near), hash };
        let scene = Self {
            bounds,
            shapes,
            sh,
            grids: Buffer::new(device, "grids", 1)?,
            len: count,
            extent: pages.statistics().extent,
            self_test: self_test(move || tested),
            alpha_min: pages.alpha_min(),
            layout,
            nodes: pages.nodes(),
            memory: SceneMemory::Paged(Box::new(Paged {
                slots: cache.slots().clone(),
                last_used: cache.last_used().clone(),
                cache: Arc::new(Mutex::new(cache)),
                indices,
                lod,
                instances: None,
                instances_of_scenes: Vec::new(),
                placed_nodes: pages.nodes(),
                notice: pages.notice().map(Arc::from),
            })),
        };
        let mut commands = Commands::new(device)?;
        scene.upload_grids(&mut commands)?;
        commands.submit()?.wait()?;
        Ok(scene)
    }

    /// The scene at these scene instances, which share its pages.
    ///
    /// # Errors
    /// If the scene instances have more Gaussians than can be sorted.
    ///
    /// # Panics
    /// If the scene is not in pages.
    pub(crate) fn placed(self, instances: &SceneInstances) -> Result<Self> {
        let SceneMemory::Paged(paged) = self.memory else { panic!("a scene with instances is paged") };
        let (places, count) = (instances.all().len(), self.nodes);
        ensure!(
            (places as u64).saturating_mul(count as u64) <= MAX_POSITIONS,
            "{places} places of {count} Gaussians are more than {MAX_POSITIONS} Gaussians, which is the most that can \
             be ordered"
        );
        ensure!(
            places <= MAX_INSTANCES,
            "{places} places are more than {MAX_INSTANCES}, which is the most that are drawn"
        );
        let (instances_of, placed_nodes) = (Some(instances.clone()), places * count);
        let memory = SceneMemory::Paged(Box::new(Paged { instances: instances_of, placed_nodes, ..*paged }));
        Ok(Self { extent: instances.extent(&self.extent), memory, ..self })
    }

    /// Joined scenes, each at its own scene instances.
    ///
    /// # Errors
    /// As [`GpuScene::placed`].
    ///
    /// # Panics
    /// If the pages are not those of as many scenes.
    pub(crate) fn with_placed_scenes(self, scenes: &[(SceneInstances, Bounds)]) -> Result<Self> {
        let mut ranges: Vec<Range<u32>> = Vec::new();
        for (instances, _) in scenes {
            let first = ranges.last().map_or(0, |range| range.end);
            ranges.push(first..first + instances.all().len() as u32);
        }
        let views = ranges.last().map_or(0, |range| range.end);
        ensure!(
            views <= MAX_JOINED,
            "{views} places are more than {MAX_JOINED}, which several scenes can have together"
        );
        let all = scenes.iter().flat_map(|(instances, _)| instances.all().iter().copied()).collect();
        let extents = scenes.iter().map(|(instances, extent)| instances.extent(extent));
        let extent = extents.reduce(Bounds::around).expect("there is a scene");
        let mut scene = self.placed(&SceneInstances::new(all)?)?;
        let SceneMemory::Paged(paged) = &mut scene.memory else { panic!("joined scenes are paged") };
        let nodes = paged.cache().pages().nodes_of_scenes();
        assert_eq!(nodes.len(), ranges.len(), "each scene has its instances");
        paged.placed_nodes = nodes.into_iter().zip(&ranges).map(|(nodes, views)| nodes * views.len()).sum();
        paged.instances_of_scenes = ranges;
        Ok(Self { extent, ..scene })
    }

    /// The numbers of the views of each joined scene, or of the only one.
    pub(crate) fn views_of_scenes(&self) -> Vec<Range<u32>> {
        match self.paged() {
            Some(paged) if !paged.instances_of_scenes.is_empty() => paged.instances_of_scenes.clone(),
            _ => std::iter::once(0..self.transforms().len() as u32).collect(),
        }
    }

    /// True if the scene has scene instances.
    pub fn is_placed(&self) -> bool {
        self.instances().is_some()
    }

    /// The transforms at which the scene is drawn.
    pub(crate) fn transforms(&self) -> &[Transform] {
        self.instances().map_or(&[Transform::IDENTITY], SceneInstances::all)
    }

    /// The number of Gaussians at all scene instances, LOD nodes included.
    pub(crate) fn placed_len(&self) -> usize {
        self.paged().map_or(self.nodes, |paged| paged.placed_nodes)
    }

    /// The approximate number of Gaussians that a picture draws at most.
    pub(crate) fn drawn_len(&self, options: &Options) -> usize {
        if options.splats > 0 { self.placed_len().min(options.splats as usize) } else { self.placed_len() }
    }

    /// True if the planes hold the resident pages of the scene.
    pub fn is_paged(&self) -> bool {
        self.paged().is_some()
    }

    /// The pages of the scene; `None` if the planes hold all of its Gaussians.
    pub(crate) fn paged(&self) -> Option<&Paged> {
        match &self.memory {
            SceneMemory::Whole => None,
            SceneMemory::Paged(paged) => Some(paged),
        }
    }

    fn instances(&self) -> Option<&SceneInstances> {
        self.paged()?.instances.as_ref()
    }

    /// The indices of the Gaussians and their levels of detail; `none` for each that the scene lacks.
    pub(crate) fn indices_and_lod<'a>(&'a self, none: &'a Buffer<u32>) -> [&'a Buffer<u32>; 2] {
        self.paged().map_or([none; 2], |paged| [&paged.indices, paged.lod.as_ref().unwrap_or(none)])
    }

    /// True if the scene has levels of detail.
    pub(crate) fn has_lod(&self) -> bool {
        self.paged().is_some_and(|paged| paged.lod.is_some())
    }

    /// The reason why a scene in pages is stored in another form than the options request.
    pub(crate) fn notice(&self) -> Option<&str> {
        self.paged()?.notice.as_deref()
    }

    /// The pages that were read so far; `None` if the planes hold the whole scene.
    pub fn pages_read(&self) -> Option<PagesRead> {
        self.paged().map(|paged| paged.cache().read)
    }

    /// The number of Gaussians.
    pub fn len(&self) -> usize {
        self.len
    }

    /// The first `count` Gaussians of the scene, as a whole scene.
    pub(crate) fn first(&self, count: usize) -> Self {
        let len = self.len.min(count);
        Self { len, nodes: len, memory: SceneMemory::Whole, ..self.clone() }
    }

    /// The scene with other bounds of as many Gaussians.
    pub(crate) fn with_bounds(&self, bounds: Buffer<[u32; 4]>) -> Self {
        assert_eq!(bounds.len(), self.bounds.len(), "every Gaussian has bounds");
        Self { bounds, ..self.clone() }
    }

    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// True if the scene is in the memory of this device.
    pub fn is_on(&self, device: &Device) -> bool {
        self.bounds.is_on(device)
    }

    pub fn layout(&self) -> &Layout {
        &self.layout
    }

    /// The bytes of device memory of a Gaussian.
    pub fn bytes_each(&self) -> u64 {
        self.layout.bytes_each()
    }

    /// The name and the bytes of every buffer.
    pub fn buffers(&self) -> Vec<(&str, u64)> {
        let planes = self.planes().map(Buffer::footprint);
        let words = self.paged().into_iter().flat_map(Paged::buffers).map(Buffer::footprint);
        planes.chain(words).chain([self.grids.footprint()]).collect()
    }

    /// The planes of bounds, of shapes and of spherical harmonics.
    #[doc(hidden)]
    pub fn planes(&self) -> impl Iterator<Item = &Buffer<[u32; 4]>> {
        std::iter::once(&self.bounds).chain(&self.shapes).chain(&self.sh)
    }

    /// The planes of shapes. The last one is repeated where the layout has fewer planes: pipelines do not read it
    /// again.
    pub(crate) fn shape_planes(&self) -> [&Buffer<[u32; 4]>; 2] {
        std::array::from_fn(|i| &self.shapes[i.min(self.shapes.len() - 1)])
    }

    /// The planes of spherical harmonics. The last one is repeated where the layout has fewer planes.
    pub(crate) fn sh_planes(&self) -> [&Buffer<[u32; 4]>; SH_PLANES] {
        std::array::from_fn(|i| &self.sh[i.min(self.sh.len() - 1)])
    }

    fn upload(&self, commands: &mut Commands, gaussians: &Gaussians, range: Range<usize>) -> Result<()> {
        let layout = &self.layout;
        let widths = [4].into_iter().chain(plane_widths(layout.shape_words())).chain(plane_widths(layout.sh_words()));
        let places: Vec<_> = self
            .planes()
            .zip(widths.clone())
            .map(|(plane, width)| (plane, range.start * width / 4..(range.end * width).div_ceil(4)))
            .collect();
        commands.upload_together(&places, |memory| {
            let mut parts: Vec<Vec<_>> = range.clone().step_by(PACKED_CHUNK).map(|_| Vec::new()).collect();
            for (plane, width) in memory.into_iter().zip(widths) {
                let chunks = plane.chunks_mut(PACKED_CHUNK * width / 4);
                parts.iter_mut().zip(chunks).for_each(|(part, plane)| part.push(plane));
            }
            let parts = parts.into_par_iter().enumerate();
            parts.for_each(|(i, planes)| {
                let mut planes = planes.into_iter();
                let bounds = planes.next().expect("every scene has a plane of bounds");
                let mut shapes: Vec<_> = planes.by_ref().take(self.shapes.len()).collect();
                let (first, count) = (range.start + i * PACKED_CHUNK, bounds.len());
                pack_shapes(layout, self.alpha_min, |k| Shape::of(gaussians, first + k), bounds, &mut shapes);
                pack_sh(layout, count, |k| gaussians.sh(first + k), &mut planes.collect::<Vec<_>>());
            });
        })
    }
}

impl Paged {
    /// The page cache, locked for as long as the guard lives.
    pub fn cache(&self) -> MutexGuard<'_, PageCache> {
        self.cache.lock().expect("no holder of the page cache panics")
    }

    fn buffers(&self) -> impl Iterator<Item = &Buffer<u32>> {
        [&self.indices, &self.slots, &self.last_used].into_iter().chain(&self.lod)
    }
}

/// Fails if a scene of this size would leave fewer than `reserve` bytes, and some for lists.
fn check_room(device: &Device, bytes: u64, reserve: u64) -> Result<()> {
    let free = device.free_bytes();
    let room = free.saturating_sub(reserve + MIN_LIST_BYTES);
    // Without memory for the pictures pages do not help: their own allocation then reports the failure.
    if bytes > room && (room > 0 || bytes > free) {
        let reason = format!("{room} bytes of device memory are left for it");
        return Err(OutOfMemory { name: "scene".to_owned(), bytes: Some(bytes), reason }.into());
    }
    Ok(())
}

/// The planes of attributes of `words` words per Gaussian.
fn planes(device: &Device, name: &str, words: usize, len: usize) -> Result<Vec<Buffer<[u32; 4]>>> {
    let plane = |(i, width): (usize, usize)| Buffer::new(device, &format!("{name} {i}"), (len * width).div_ceil(4));
    plane_widths(words).enumerate().map(plane).collect()
}

/// The grids and the base that the shaders unpack with.
fn grids(layout: &Layout) -> Grids {
    let pair = |grid: Grid| [grid.offset, grid.step];
    let (sh, log2_scale) = layout.grids();
    Grids { sh: sh.map(pair), log2_scale: pair(log2_scale), scale_base: layout.scale_base() as f32 }
}
