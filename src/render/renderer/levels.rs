//! Levels of detail: the cut of the next frames, and the measurement of its error.

use anyhow::Result;

use super::Renderer;
use crate::camera::Camera;
use crate::options::Options;
use crate::render::frame::drawn_camera;
use crate::render::lod::{Occlusion, SampledPsnr};
use crate::render::sample::{FIRST_LIMIT, FoundLimit, LevelSampler, PsnrMeasurement};
use crate::rules::Background;

/// The most error limits that are kept.
const MOST_SEARCHED: usize = 1024;

/// The error limits by which pictures of a camera keep the PSNR of the options.
pub(super) struct Searched {
    camera: Camera,
    background: Background,
    /// If nothing is hidden.
    plain: FoundLimit,
    /// If hidden groups are coarser.
    with_hidden: Option<FoundLimit>,
}

impl Renderer {
    /// Draws the finest cut through the levels of detail from now on, which shows the bits of the scene, or again the
    /// cut of the options.
    #[doc(hidden)]
    pub fn set_finest(&mut self, is_finest: bool) {
        self.is_finest = is_finest;
        self.choice.options = if is_finest { self.options.finest() } else { self.options };
    }

    /// Limits the splat budget of a scene with levels of detail from now on. A lower budget of the options holds.
    #[doc(hidden)]
    pub fn limit_splats(&mut self, splats: Option<u32>) {
        let own = self.options.splats;
        self.choice.options.splats = splats.map_or(own, |most| if own > 0 { own.min(most) } else { most });
    }

    /// The PSNR that frames which follow a prediction are to keep, dB; `None` without one, or if a splat budget
    /// decides.
    #[doc(hidden)]
    pub fn wanted_psnr(&self) -> Option<f64> {
        let wanted = self.options.lod_psnr;
        (wanted > 0.0 && self.follows_prediction && self.choice.options.splats == 0).then_some(wanted.into())
    }

    /// The error limit of the last frame, as that of the options; a usual one if it is not known.
    #[doc(hidden)]
    pub fn error_limit(&self) -> f64 {
        let known = [self.choice.options.lod_error, self.choice.last_limit];
        known.into_iter().find(|limit| *limit > 0.0).map_or(FIRST_LIMIT, f64::from)
    }

    /// Keeps this error limit from now on, in place of the one that follows from the predicted PSNR.
    #[doc(hidden)]
    pub fn set_error_limit(&mut self, limit: f64) {
        self.choice.options = Options { lod_error: limit as f32, lod_psnr: 0.0, ..self.choice.options };
    }

    /// Chooses the levels of the next frame: its error limit, and what is hidden in it. Returns the estimate of its
    /// PSNR if one is asked for, and the GPU time of a first picture, ms. See [`Renderer::find_hidden`].
    pub(super) fn choose_levels(
        &mut self,
        (camera, background): (&Camera, Background),
        may_be_used: bool,
    ) -> Result<(Option<SampledPsnr>, f64)> {
        let Some(number) = self.find_limit(camera, background)? else {
            return Ok((None, self.find_hidden(camera, background, may_be_used)?));
        };
        let mut found = self.searched[number].plain;
        self.set_error_limit(found.limit.into());
        let first_picture_ms = self.find_hidden(camera, background, may_be_used)?;
        // Hidden groups are coarser then, and what reaches out of them is seen.
        if !self.finds_hidden && self.has_hidden(camera) && found.limit > self.options.finest().lod_error {
            found = match self.searched[number].with_hidden {
                Some(known) => known,
                None => self.search((camera, background), Some(found))?,
            };
            self.searched[number].with_hidden = Some(found);
            self.set_error_limit(found.limit.into());
        }
        // A splat budget may raise the limit.
        Ok((Some(found.psnr).filter(|_| self.options.splats == 0), first_picture_ms))
    }

    /// The number of the largest error limit that keeps the PSNR of the options if nothing is hidden, among those that
    /// were searched. Frames that follow a prediction have none.
    fn find_limit(&mut self, camera: &Camera, background: Background) -> Result<Option<usize>> {
        if self.options.lod_psnr == 0.0 || self.is_finest || !self.scene.has_lod() || self.follows_prediction {
            return Ok(None);
        }
        let is_known = |known: &Searched| known.camera == *camera && known.background == background;
        if let Some(number) = self.searched.iter().position(is_known) {
            return Ok(Some(number));
        }
        let plain = self.search((camera, background), None)?;
        if self.searched.len() == MOST_SEARCHED {
            self.searched.clear();
        }
        self.searched.push(Searched { camera: camera.clone(), background, plain, with_hidden: None });
        Ok(Some(self.searched.len() - 1))
    }

    /// Searches the limit; with hidden groups, from the limit without.
    fn search(&mut self, view: (&Camera, Background), from: Option<FoundLimit>) -> Result<FoundLimit> {
        let wanted = self.options.lod_psnr;
        let found = self.sampler(from.is_some())?.search(view, wanted.into(), from)?;
        self.spare_memory()?;
        Ok(found)
    }

    /// True if the next frame takes the stop depths of this view.
    fn has_hidden(&mut self, camera: &Camera) -> bool {
        let options = self.choice.options;
        let drawn = drawn_camera(&options, camera);
        self.choice.occlusion().is_some_and(|occlusion| occlusion.is_of(&drawn, &options, true))
    }

    /// Draws a first picture, whose stop depths the next one takes, if the options ask for that and frames wait for
    /// their pages. Returns its GPU time, ms. Nothing is drawn if the stop depths of this view are there, and, unless
    /// `may_be_used`, no complete picture has taken them.
    pub(super) fn find_hidden(&mut self, camera: &Camera, background: Background, may_be_used: bool) -> Result<f64> {
        let options = self.choice.options;
        if !options.simplifies_hidden() || self.choice.streamer.is_some() || self.finds_hidden {
            return Ok(0.0);
        }
        let drawn = drawn_camera(&options, camera);
        let Some(occlusion) = self.choice.occlusion() else { return Ok(0.0) };
        if occlusion.is_of(&drawn, &options, may_be_used) {
            return Ok(0.0);
        }
        occlusion.measure();
        self.finds_hidden = true;
        let is_repeated = self.choice.is_repeated;
        let first = self.render(camera, background);
        self.choice.is_repeated = is_repeated;
        self.finds_hidden = false;
        let first = first?;
        self.choice.occlusion().into_iter().for_each(Occlusion::keep);
        Ok(first.gpu_ms())
    }

    /// Estimates the PSNR of the picture of a camera against the picture of all Gaussians, from about this number of
    /// patches. The picture is that of the levels that a frame draws which waits for its pages.
    ///
    /// # Errors
    /// If memory runs out, or a page cannot be read.
    pub fn sample_psnr(&mut self, camera: &Camera, background: Background, patches: u32) -> Result<SampledPsnr> {
        let mut measurement = self.begin_measurement(camera, background, patches)?;
        let sampled = self.go_on_measuring(&mut measurement, usize::MAX)?;
        self.spare_memory()?;
        Ok(sampled.expect("all strata were drawn"))
    }

    /// True if pictures are drawn by levels of detail whose error can be measured without evicting their pages.
    #[doc(hidden)]
    pub fn measures_levels(&self) -> bool {
        let Options { lod_error, lod_psnr, splats, .. } = self.options;
        let is_simplified = lod_error > f32::MIN_POSITIVE || lod_psnr > 0.0 || splats > 0;
        is_simplified && self.scene.paged().is_some_and(|paged| paged.cache().fits_all())
    }

    /// Begins what [`Renderer::sample_psnr`] does at once.
    ///
    /// # Errors
    /// As [`Renderer::sample_psnr`].
    #[doc(hidden)]
    pub fn begin_measurement(
        &mut self,
        camera: &Camera,
        background: Background,
        patches: u32,
    ) -> Result<PsnrMeasurement> {
        self.refused(camera, None).map_or(Ok(()), Err)?;
        self.choose_levels((camera, background), true)?;
        Ok(PsnrMeasurement::new(&self.scene, &self.choice.options, (camera, background), patches))
    }

    /// True if a measurement is one of this picture, by the present levels.
    #[doc(hidden)]
    pub fn is_measured_by(&self, measurement: &PsnrMeasurement, camera: &Camera, background: Background) -> bool {
        let PsnrMeasurement { levels, camera: of, background: over, .. } = measurement;
        *levels == self.choice.options && of == camera && *over == background
    }

    /// Draws the next strata of a measurement. Returns the estimate after the last one.
    ///
    /// # Errors
    /// As [`Renderer::sample_psnr`].
    #[doc(hidden)]
    pub fn go_on_measuring(&mut self, measurement: &mut PsnrMeasurement, strata: usize) -> Result<Option<SampledPsnr>> {
        self.sampler(true)?.go_on(measurement, strata)
    }

    /// Frees the lists of patches where memory is limited: the lists of pictures take it.
    fn spare_memory(&mut self) -> Result<()> {
        match &mut self.sampler {
            Some(sampler) if self.device.memory().user_limit.is_some() => sampler.release(),
            _ => Ok(()),
        }
    }

    /// The sampler, which takes the stop depths of pictures, or none.
    fn sampler(&mut self, takes_stop_depths: bool) -> Result<&mut LevelSampler> {
        if self.sampler.is_none() {
            self.sampler = Some(LevelSampler::new(&self.device, &self.options, &self.scene)?);
        }
        let sampler = self.sampler.as_mut().expect("it was made");
        sampler.share_occlusion(self.choice.occlusion().filter(|_| takes_stop_depths).as_deref());
        Ok(sampler)
    }
}
