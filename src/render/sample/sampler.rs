//! Draws the patches of a sample with all Gaussians and by levels of detail.

use anyhow::Result;

use super::estimate::Sample;
use super::limit_search::{LimitSearch, Step};
use crate::camera::Camera;
use crate::gpu::{Access, Commands, Device, Image};
use crate::options::Options;
use crate::render::frame::{Shot, Target, Variation};
use crate::render::lod::SampledPsnr;
use crate::render::patches::Patches;
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
    pub fn new(levels: &Options, camera: &Camera, background: Background, patches: u32) -> Self {
        let sample = Sample::of(&drawn_camera(levels, camera), patches);
        Self { levels: *levels, camera: camera.clone(), background, sample, errors: Vec::new() }
    }
}

/// The camera of a picture as it is drawn, before it is enlarged.
fn drawn_camera(options: &Options, camera: &Camera) -> Camera {
    camera.sampled(options.drawn_size(camera.size_px))
}

/// The limit with which a search begins, a picture that nearly all scenes show well.
const FIRST_LIMIT: f64 = 8.0;

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
        })
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
        let next = errors.len()..errors.len().saturating_add(strata).min(all);
        let patches = sample.patches(next.clone());
        let exact = self.pixels(view, &patches, self.options.finest())?;
        let shown = self.pixels(view, &patches, *levels)?;
        errors.extend(sample.errors(next, &shown, &exact));
        Ok((errors.len() == all).then(|| sample.estimate(errors)))
    }

    /// The largest error limit with which the estimate is at least `psnr` dB by one standard error, and that estimate.
    /// The limit is that of [`Options::lod_error`]; pictures that no limit suits are drawn with all Gaussians.
    ///
    /// # Errors
    /// As [`LevelSampler::go_on`].
    pub fn search(
        &mut self,
        camera: &Camera,
        background: Background,
        psnr: f64,
        patches: u32,
    ) -> Result<(f32, SampledPsnr)> {
        let camera = drawn_camera(&self.options, camera);
        let (view, sample) = ((&camera, background), Sample::of(&camera, patches));
        let all = 0..sample.strata();
        let patches = sample.patches(all.clone());
        let finest = self.options.finest();
        let exact = self.pixels(view, &patches, finest)?;
        let estimate = |shown: &[[f32; 4]]| sample.estimate(&sample.errors(all.clone(), shown, &exact));
        let mut search = LimitSearch::new(psnr, FIRST_LIMIT);
        loop {
            let lod_error = search.limit() as f32;
            let levels = Options { lod_error, lod_psnr: 0.0, splats: 0, ..self.options };
            match search.step(estimate(&self.pixels(view, &patches, levels)?)) {
                Step::Try(_) => {}
                Step::Found(limit, found) => return Ok((limit as f32, found)),
                Step::AllGaussians => return Ok((finest.lod_error, estimate(&exact))),
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
        image.fit(device, "patches", camera.size_px)?;
        let shot = Shot { patches: Some(patches), ..Shot::new(scene, camera) };
        let limits = choice.prepare(device, shot, false, None)?;
        choice.draw_slabs(device, limits.path, shot, Target { image, certificate: None, background }, None)?;
        let mut cmd = Commands::new(device)?;
        cmd.barrier(Access::SHADER_WRITE, Access::COPY_READ);
        let pixels = cmd.read_rectangles(image, &Vec::from_iter(patches.rectangles()))?;
        Ok(cmd.submit()?.wait()?.view(&pixels).to_vec())
    }
}
