//! Draws the patches of a sample with all Gaussians and by levels of detail.

use anyhow::{Result, ensure};

use super::PATCHES;
use super::estimate::Sample;
use super::limit_search::{FIRST_LIMIT, LimitSearch, Step};
use super::touched::touched_patches;
use crate::camera::Camera;
use crate::gpu::{Access, Commands, Device, Image};
use crate::options::Options;
use crate::render::band::{BAND_ROWS, Band};
use crate::render::frame::{Shot, Target, Variation, drawn_camera};
use crate::render::lod::{Occlusion, SampledPsnr};
use crate::render::patches::Patches;
use crate::render::path::Path;
use crate::render::path_choice::PathChoice;
use crate::render::scene::GpuScene;
use crate::render::self_test::choose;
use crate::rules::Background;

/// Measures the PSNR of pictures by levels of detail, on patches. Its lists and its image are its own, so it may run
/// between the frames of a renderer of the same scene.
pub struct LevelSampler {
    device: Device,
    /// The options of the pictures.
    options: Options,
    scene: GpuScene,
    choice: PathChoice,
    image: Image,
    /// The exact patches of the last search in which nothing is hidden: a search with hidden groups follows.
    exact: Option<ExactPatches>,
}

/// The result of a search.
#[derive(Clone, Copy, Debug)]
pub struct FoundLimit {
    /// That of [`Options::lod_error`].
    pub limit: f32,
    pub psnr: SampledPsnr,
    /// The number of patches that was asked for last.
    pub patches: u32,
}

/// A sample of a view, and the pixels of its patches, drawn with all Gaussians.
struct ExactPatches {
    camera: Camera,
    background: Background,
    /// The number of patches that was asked for.
    asked: u32,
    sample: Sample,
    pixels: Vec<[f32; 4]>,
}

/// A measurement of the PSNR of a picture that may be interrupted between its strata.
pub struct PsnrMeasurement {
    /// The options of the picture.
    pub levels: Options,
    pub camera: Camera,
    pub background: Background,
    sample: Sample,
    /// The squared errors of the patches of the strata that were drawn.
    errors: Vec<Vec<f64>>,
}

impl PsnrMeasurement {
    /// A measurement of a picture by these options on about this number of patches.
    pub fn new(scene: &GpuScene, levels: &Options, (camera, background): (&Camera, Background), patches: u32) -> Self {
        let drawn = drawn_camera(levels, camera);
        let sample = Sample::of(&drawn, &touched_patches(scene, &drawn, levels), patches);
        Self { levels: *levels, camera: camera.clone(), background, sample, errors: Vec::new() }
    }
}

/// The largest standard error of a PSNR that a search accepts if more patches can be drawn, dB.
const MOST_ERROR_DB: f64 = 1.0;

/// Pixels of the image into which patches are drawn at a time. Larger pictures are drawn in bands.
const MOST_PIXELS: u32 = 4 << 20;

impl LevelSampler {
    /// # Errors
    /// If a pipeline cannot be made, or memory runs out.
    pub fn new(device: &Device, options: &Options, scene: &GpuScene) -> Result<Self> {
        Ok(Self {
            device: device.clone(),
            options: *options,
            scene: scene.clone(),
            choice: choose(device, options, scene, Variation::Plain)?,
            image: Image::new(device, "patches", 1, 1)?,
            exact: None,
        })
    }

    /// Takes the stop depths of the pictures that are measured; with `None`, nothing is hidden.
    pub fn share_occlusion(&mut self, of_pictures: Option<&Occlusion>) {
        self.choice.occlusion().into_iter().for_each(|occlusion| occlusion.share(of_pictures));
    }

    /// Draws the next strata of a sample with all Gaussians and by the levels of its options, which differ from those
    /// of the sampler in nothing else. Returns the estimate after the last one.
    ///
    /// # Errors
    /// If memory runs out, or a page cannot be read.
    pub fn go_on(&mut self, measurement: &mut PsnrMeasurement, strata: usize) -> Result<Option<SampledPsnr>> {
        let PsnrMeasurement { levels, camera, background, sample, errors } = measurement;
        let camera = drawn_camera(&self.options, camera);
        let (view, all) = ((&camera, *background), sample.strata());
        assert!(errors.len() < all || all == 0, "a measurement ends with its last stratum");
        let next = errors.len()..errors.len().saturating_add(strata).min(all);
        let patches = sample.patches(next.clone());
        let exact = self.pixels(view, &patches, self.options.finest())?;
        let shown = self.pixels(view, &patches, *levels)?;
        errors.extend(sample.errors(next, &shown, &exact));
        Ok((errors.len() == all).then(|| sample.estimate(errors)))
    }

    /// The largest error limit with which the estimate is at least `psnr` dB by one standard error. Pictures that no
    /// limit suits are drawn with all Gaussians. The estimate is from about [`PATCHES`] patches, and from more where
    /// its standard error is large. A search with hidden groups goes on from the result of one without: it tries no
    /// larger limit, and begins with as many patches.
    ///
    /// # Errors
    /// As [`LevelSampler::go_on`].
    pub fn search(
        &mut self,
        (camera, background): (&Camera, Background),
        psnr: f64,
        from: Option<FoundLimit>,
    ) -> Result<FoundLimit> {
        let camera = drawn_camera(&self.options, camera);
        let most = from.map_or(f64::INFINITY, |found| found.limit.into());
        let (mut first, mut patches) = from.map_or((FIRST_LIMIT, PATCHES), |found| (most, found.patches));
        loop {
            let exact = self.exact_patches((&camera, background), patches)?;
            let (limit, found) = self.search_on(&exact, LimitSearch::new(psnr, first).up_to(most))?;
            let [drawn, all] = found.patches;
            // A few patches then hold most of the error, and others like them may have been missed.
            if drawn == all || found.standard_error_db() <= MOST_ERROR_DB {
                self.exact = Some(exact).filter(|_| from.is_none() && self.options.simplifies_hidden());
                return Ok(FoundLimit { limit: limit as f32, psnr: found, patches });
            }
            (first, patches) = (limit, patches.saturating_mul(4));
        }
    }

    /// About `asked` patches of a view: those of the last search if they are the same, or drawn now.
    fn exact_patches(&mut self, (camera, background): (&Camera, Background), asked: u32) -> Result<ExactPatches> {
        let is_of =
            |known: &ExactPatches| known.camera == *camera && known.background == background && known.asked == asked;
        if let Some(known) = self.exact.take().filter(is_of) {
            return Ok(known);
        }
        let sample = Sample::of(camera, &touched_patches(&self.scene, camera, &self.options), asked);
        let patches = sample.patches(0..sample.strata());
        let pixels = self.pixels((camera, background), &patches, self.options.finest())?;
        Ok(ExactPatches { camera: camera.clone(), background, asked, sample, pixels })
    }

    /// The result of a search on one sample.
    fn search_on(&mut self, exact: &ExactPatches, mut search: LimitSearch) -> Result<(f64, SampledPsnr)> {
        let ExactPatches { camera, background, sample, pixels, .. } = exact;
        let all = 0..sample.strata();
        let patches = sample.patches(all.clone());
        let estimate = |shown: &[[f32; 4]]| sample.estimate(&sample.errors(all.clone(), shown, pixels));
        loop {
            let lod_error = search.limit() as f32;
            let levels = Options { lod_error, lod_psnr: 0.0, splats: 0, ..self.options };
            match search.step(estimate(&self.pixels((camera, *background), &patches, levels)?)) {
                Step::Try(_) => {}
                Step::Found(limit, found) => return Ok((limit, found)),
                Step::AllGaussians => return Ok((self.options.finest().lod_error.into(), estimate(pixels))),
            }
        }
    }

    /// The pixels of the patches, one patch after the other, by the levels of these options.
    fn pixels(
        &mut self,
        (camera, background): (&Camera, Background),
        patches: &Patches,
        levels: Options,
    ) -> Result<Vec<[f32; 4]>> {
        let Self { device, scene, choice, image, .. } = self;
        choice.options = levels;
        let [width, height] = camera.size_px;
        let rows = (MOST_PIXELS / width / BAND_ROWS).max(1) * BAND_ROWS;
        let mut all = Vec::new();
        for band in Band::between(&Vec::from_iter((rows..height).step_by(rows as usize)), height) {
            let patches = patches.within(band);
            if patches.numbers().next().is_none() {
                continue;
            }
            image.fit(device, "patches", band.size(camera.size_px))?;
            let shot = Shot { band, patches: Some(&patches), ..Shot::new(scene, camera) };
            let limits = choice.prepare(device, shot, false, None)?;
            ensure!(
                limits.path == Path::Fast || !scene.is_placed(),
                "only the fast path draws scenes at places, and this device or these options do not take it"
            );
            choice.draw_slabs(device, limits.path, shot, Target { image, certificate: None, background }, None)?;
            let mut cmd = Commands::new(device)?;
            cmd.barrier(Access::SHADER_WRITE, Access::COPY_READ);
            let in_band = patches.rectangles().map(|[left, top, width, height]| [left, top - band.top, width, height]);
            let pixels = cmd.read_rectangles(image, &Vec::from_iter(in_band))?;
            all.extend_from_slice(cmd.submit()?.wait()?.view(&pixels));
        }
        Ok(all)
    }

    /// Frees the buffers of the lists.
    ///
    /// # Errors
    /// If the device is lost.
    pub fn release(&mut self) -> Result<()> {
        self.choice.release(&self.device)
    }

    /// Every buffer's name and bytes.
    pub fn buffers(&self) -> Vec<(&str, u64)> {
        self.choice.buffers().into_iter().chain([("patches", self.image.bytes())]).collect()
    }
}
