//! The pruner: draws views of a scene with all Gaussians or without some, by the portable path, and measures on the
//! lists of a frame the contribution of each Gaussian and the largest change of each pixel.

use anyhow::{Result, bail};

use crate::camera::Camera;
use crate::gpu::{Access, Buffer, Commands, Device, DispatchSize, Image, Stage};
use crate::options::Options;
use crate::packing::Statistics;
use crate::pixels::Pixels;
use crate::render::capacity::{Capacity, MAX_ATTEMPTS};
use crate::render::constants::shared;
use crate::render::frame::{Shot, Target, tiles};
use crate::render::portable::{Pass, PortablePipeline, PortableWorkspace, Walk, chunks};
use crate::render::readback::read_pixels;
use crate::render::scene::GpuScene;
use crate::render::shaders::Contribution;
use crate::render::shaders::portable::CULL_CHUNK;
use crate::render::shaders::prune::*;
use crate::rules::Background;
use crate::scene::Gaussians;

/// The share that a Gaussian has of all pixels of the views that were noted. A share is alpha * transmittance.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Share {
    /// The largest at a pixel.
    pub largest: f32,
    /// The sum over all pixels, to 2^-25 for each of them.
    pub sum: f64,
}

/// The largest change of a picture without the dropped Gaussians.
#[derive(Clone, Debug, PartialEq)]
pub struct Bounds {
    /// For every pixel (bound, w, D, number of blended splats): w is the share of the dropped splats, D is
    /// the brightest colour near it, and the bound is D * w with an allowance for the rounding of f32.
    pub pixels: Pixels,
}

impl Bounds {
    /// The largest bound of a pixel.
    pub fn largest(&self) -> f64 {
        self.pixels.rgba.iter().map(|pixel| f64::from(pixel[0])).fold(0.0, f64::max)
    }

    /// The mean of the squares of all bounds: no mean squared error is larger.
    pub fn mean_square(&self) -> f64 {
        let sum: f64 = self.pixels.rgba.iter().map(|pixel| f64::from(pixel[0]).powi(2)).sum();
        sum / self.pixels.rgba.len().max(1) as f64
    }
}

/// A scene of which views are drawn over a black background, and the shares of its Gaussians.
pub struct Pruner {
    device: Device,
    scene: GpuScene,
    pipeline: PortablePipeline,
    work: PortableWorkspace,
    /// The picture of the frame that `work` holds.
    image: Image,
    /// The picture that a stage of the pruner makes from these lists.
    found: Image,
    /// The number of blend dispatches of a frame.
    passes: u32,
    /// A bit per Gaussian: 1 if it is kept.
    kept: Buffer<u32>,
    contributions: Buffer<Contribution>,
    /// Splats that were blended into each pixel, between the passes over long lists.
    counts: Buffer<u32>,
    keep: Stage<Keep>,
    /// The first of each pair begins pixels, the second resumes them.
    contribute: [Stage<Contribute>; 2],
    bound: [Stage<Bound>; 2],
}

/// The Gaussians that a frame shows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Shown {
    All,
    Kept,
}

const BACKGROUND: Background = Background::BLACK;

impl Pruner {
    /// Uploads a scene and builds the pipelines. All Gaussians are kept.
    ///
    /// # Errors
    /// If only the reference draws by these options, or device memory runs out.
    ///
    /// # Panics
    /// If the options stop pixels early: the pruner measures exact pictures.
    pub fn new(device: &Device, gaussians: &Gaussians, statistics: &Statistics, options: &Options) -> Result<Self> {
        Self::of(device, &GpuScene::with(device, gaussians, statistics, options)?, options)
    }

    /// Builds the pipelines for a scene on the device, of which the Gaussians that are marked as left out have no part.
    ///
    /// # Errors
    /// As [`new`](Self::new).
    ///
    /// # Panics
    /// As [`new`](Self::new), and if the scene is in pages.
    pub fn of(device: &Device, scene: &GpuScene, options: &Options) -> Result<Self> {
        assert!(options.stop == 0.0, "splats behind a stop have no share");
        assert!(!scene.is_paged(), "the pruner draws whole scenes");
        let constants = shared(options, scene.layout(), device.capabilities().subgroup_size[1]);
        let contribute =
            |resume| Stage::new(device, &ContributeConstants { resume, ..ContributeConstants::of(&constants) });
        let bound = |resume| Stage::new(device, &BoundConstants { resume, ..BoundConstants::of(&constants) });
        let words = scene.len().div_ceil(CULL_CHUNK as usize) * (CULL_CHUNK / u32::BITS) as usize;
        let pruner = Self {
            device: device.clone(),
            pipeline: PortablePipeline::new(device, options, scene.layout())?,
            // It grows to what the views need.
            work: PortableWorkspace::new(device, Capacity::default())?,
            image: Image::new(device, "image", 1, 1)?,
            found: Image::new(device, "found", 1, 1)?,
            passes: 1,
            kept: Buffer::new(device, "kept", words)?,
            contributions: Buffer::new(device, "contributions", scene.len())?,
            counts: Buffer::new(device, "counts", 1)?,
            keep: Stage::new(device, &())?,
            contribute: [contribute(false)?, contribute(true)?],
            bound: [bound(false)?, bound(true)?],
            scene: scene.clone(),
        };
        let mut cmd = Commands::new(device)?;
        cmd.fill(&pruner.kept, u32::MAX);
        cmd.fill(&pruner.contributions, 0);
        cmd.submit()?.wait()?;
        Ok(pruner)
    }

    /// Keeps all Gaussians except the ones with these indices.
    ///
    /// # Errors
    /// If memory runs out or the device is lost.
    pub fn set_dropped(&mut self, dropped: &[u32]) -> Result<()> {
        let mut cmd = Commands::new(&self.device)?;
        cmd.upload(&self.kept, 0, self.kept.len(), |words| {
            words.fill(u32::MAX);
            dropped.iter().for_each(|index| words[(index / u32::BITS) as usize] &= !(1 << (index % u32::BITS)));
        })?;
        cmd.submit()?.wait()?;
        Ok(())
    }

    /// The picture of the whole scene. The lists of its frame stay until the next picture.
    ///
    /// # Errors
    /// If memory runs out or the device is lost.
    pub fn whole(&mut self, camera: &Camera) -> Result<Pixels> {
        self.draw(camera, Shown::All)?;
        read_pixels(&self.device, &self.image)
    }

    /// The picture of the kept Gaussians.
    ///
    /// # Errors
    /// As [`whole`](Self::whole).
    pub fn pruned(&mut self, camera: &Camera) -> Result<Pixels> {
        self.draw(camera, Shown::Kept)?;
        read_pixels(&self.device, &self.image)
    }

    /// Draws a view of the whole scene, and adds the contribution of each Gaussian.
    ///
    /// # Errors
    /// As [`whole`](Self::whole).
    pub fn note(&mut self, camera: &Camera) -> Result<()> {
        self.draw(camera, Shown::All)?;
        let mut cmd = Commands::new(&self.device)?;
        cmd.scope("contribute", |cmd| self.contribute(cmd, camera));
        cmd.submit()?.wait()?;
        Ok(())
    }

    /// The contribution of each Gaussian to all noted views.
    ///
    /// # Errors
    /// As [`whole`](Self::whole).
    pub fn shares(&self) -> Result<Vec<Share>> {
        let mut cmd = Commands::new(&self.device)?;
        let contributions = cmd.read(&self.contributions)?;
        let results = cmd.submit()?.wait()?;
        let share = |contribution: &Contribution| {
            let units = u64::from(contribution.sum_high) << 32 | u64::from(contribution.sum_low);
            Share { largest: f32::from_bits(contribution.largest), sum: units as f64 / f64::from(SHARE_UNIT) }
        };
        Ok(results.view(&contributions).iter().map(share).collect())
    }

    /// Draws a view of the whole scene, and bounds the change of each pixel if only the kept Gaussians are drawn.
    ///
    /// # Errors
    /// As [`whole`](Self::whole).
    pub fn bounds(&mut self, camera: &Camera) -> Result<Bounds> {
        self.draw(camera, Shown::All)?;
        let pixels = camera.size_px.iter().map(|side| *side as usize).product();
        if self.counts.len() < pixels {
            self.counts = Buffer::new(&self.device, "counts", pixels)?;
        }
        let mut cmd = Commands::new(&self.device)?;
        cmd.scope("bound", |cmd| self.bound(cmd, camera));
        cmd.submit()?.wait()?;
        Ok(Bounds { pixels: read_pixels(&self.device, &self.found)? })
    }

    /// Draws a frame. Buffers that are too small for it grow, and it is drawn again.
    fn draw(&mut self, camera: &Camera, shown: Shown) -> Result<()> {
        let size = camera.size_px;
        self.image.fit(&self.device, "image", size)?;
        self.found.fit(&self.device, "found", size)?;
        let cells = tiles(size).iter().product::<u32>() as usize;
        let gaussians = self.scene.len();
        self.work.grow(&self.device, Capacity { gaussians, cells, ..Capacity::default() })?;
        for _ in 0..MAX_ATTEMPTS {
            let (capacity, longest_list) = (self.work.capacity, self.pipeline.longest_list(self.passes));
            let mut cmd = Commands::new(&self.device)?;
            self.record(&mut cmd, camera, shown);
            cmd.barrier(Access::SHADER_WRITE, Access::COPY_READ);
            let totals = cmd.read(&self.work.totals)?;
            let results = cmd.submit()?.wait()?;
            let totals = results.view(&totals)[0];
            let demand = Capacity::of(&totals, capacity.gaussians, capacity.cells);
            let is_whole = demand.fits(capacity) && totals.longest_list <= longest_list;
            self.passes = self.passes.max(self.pipeline.passes(totals.longest_list));
            if is_whole {
                return Ok(());
            }
            self.work.grow(&self.device, demand)?;
        }
        bail!("the frame did not fit its buffers in {MAX_ATTEMPTS} attempts, although they grew to what it counted")
    }

    fn record(&self, cmd: &mut Commands, camera: &Camera, shown: Shown) {
        let (pipeline, work) = (&self.pipeline, &self.work);
        let shot = Shot::new(&self.scene, camera);
        let view = pipeline.view(camera);
        pipeline.clear(cmd, work);
        cmd.scope("cull", |cmd| {
            pipeline.cull(cmd, &self.scene, view, work);
            cmd.barrier(Access::SHADER_WRITE, Access::SHADER);
            if shown == Shown::Kept {
                self.keep(cmd);
            }
            pipeline.compact(cmd, &self.scene, work);
        });
        pipeline.project_visible(cmd, shot, view, work);
        let splat_ids = pipeline.bin(cmd, shot, work);
        let target = Target { image: &self.image, certificate: None, background: BACKGROUND };
        cmd.scope("blend", |cmd| pipeline.blend(cmd, shot, work, splat_ids, target, self.passes));
    }

    /// Leaves only kept Gaussians in the visible set. Begins after a barrier and ends with one.
    fn keep(&self, cmd: &mut Commands) {
        let Self { work, kept, .. } = self;
        let (visible_masks, chunk_counts) = (&work.visible_masks, &work.chunk_counts);
        let bindings = KeepBindings { kept, visible_masks, chunk_counts };
        let words = DispatchSize::Invocations(work.visible_masks.len() as u64);
        cmd.dispatch(&self.keep, bindings, KeepPush { chunks: chunks(&self.scene) }, words);
        cmd.barrier(Access::SHADER_WRITE, Access::SHADER);
    }

    /// Adds the shares of the splats of every tile's list.
    fn contribute(&self, cmd: &mut Commands, camera: &Camera) {
        let Self { work, found: image, contributions, .. } = self;
        let (ranges, splats, gaussian_from_splat) = (&work.ranges, &work.splats, &work.gaussian_from_splat);
        let splat_ids = self.pipeline.splat_ids(work, tiles(camera.size_px).iter().product());
        self.walk(cmd, camera, |cmd, size_px, tiles, pass| {
            let Pass { stage, begin: pass_begin, limit: pass_limit, last: last_pass } = pass;
            let bindings = ContributeBindings { ranges, splat_ids, splats, gaussian_from_splat, contributions, image };
            let background = BACKGROUND.colour();
            let push = ContributePush { size_px, tiles, background, pass_begin, pass_limit, last_pass };
            cmd.dispatch(&self.contribute[stage], bindings, push, DispatchSize::Groups(tiles.into()));
        });
    }

    /// Bounds the change of every pixel.
    fn bound(&self, cmd: &mut Commands, camera: &Camera) {
        let Self { work, found: image, kept, counts, .. } = self;
        let (ranges, splats, gaussian_from_splat) = (&work.ranges, &work.splats, &work.gaussian_from_splat);
        let splat_ids = self.pipeline.splat_ids(work, tiles(camera.size_px).iter().product());
        let background = BACKGROUND.colour().into_iter().fold(0.0, f32::max);
        self.walk(cmd, camera, |cmd, size_px, tiles, pass| {
            let Pass { stage, begin: pass_begin, limit: pass_limit, last: last_pass } = pass;
            let bindings = BoundBindings { ranges, splat_ids, splats, gaussian_from_splat, kept, counts, image };
            let push = BoundPush { size_px, tiles, background, pass_begin, pass_limit, last_pass };
            cmd.dispatch(&self.bound[stage], bindings, push, DispatchSize::Groups(tiles.into()));
        });
    }

    /// Records a walk along all lists. It takes no more loop iterations per instance than a blend, so it takes as many
    /// passes.
    fn walk(&self, cmd: &mut Commands, camera: &Camera, dispatch: impl Fn(&mut Commands, [u32; 2], u32, Pass)) {
        let tiles = tiles(camera.size_px).iter().product();
        let walk = Walk::whole(self.passes);
        walk.record(cmd, self.pipeline.blending.entries_per_pass, |cmd, pass| {
            dispatch(cmd, camera.size_px, tiles, pass);
        });
    }
}
