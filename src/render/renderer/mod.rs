//! The facade: renders pictures of one scene on the path that suits each, and repeats a frame that did not fit.
//!
//! - `mod` - [`Renderer`]: settings, frames, pixels
//! - `levels` - the cut of levels of detail, and its error
//! - `bands` - bands of pictures, and pictures that are joined from bands
//! - `explain` - the splats and the depth of a pixel
//! - `ray_certifier` - certificates against the response along rays
//! - `reports` - residency, memory, bytes of stages

mod bands;
mod explain;
mod levels;
mod ray_certifier;
mod reports;

use levels::Searched;
pub use ray_certifier::RayCertifier;

use std::fmt;
use std::time::Duration;

use anyhow::{Result, anyhow, bail, ensure};

use crate::camera::Camera;
use crate::gpu::{Access, Commands, Device, Image, Results, Timestamps, TooLarge};
use crate::host_memory::OutOfMemory;
use crate::options::Options;
use crate::pixels::Pixels;
use crate::render::band::Band;
use crate::render::capacity::{Capacity, MAX_ATTEMPTS};
use crate::render::constants::are_drawn_alike;
use crate::render::frame::{Shot, Target, Variation, drawn_camera};
use crate::render::inspect::{Inspection, Inspector, Look, Picker, Picture, Work};
use crate::render::lod::Occlusion;
use crate::render::path::{Limits, Path};
use crate::render::path_choice::PathChoice;
use crate::render::readback::read_pixels;
use crate::render::recorded::{Counted, FRAME, Frame, Recorded, Started};
use crate::render::sample::LevelSampler;
use crate::render::scene::{Features, GpuScene};
use crate::render::self_test::{choose, test_rays};
use crate::render::shaders::{Room, Totals};
use crate::render::upscale::Upscaler;
use crate::rules::{Background, Response};

/// Renders pictures of one scene and keeps its buffers from one frame to the next.
pub struct Renderer {
    device: Device,
    options: Options,
    scene: GpuScene,
    choice: PathChoice,
    image: Image,
    /// Set if pictures are drawn smaller and then enlarged, because [`Options::scale`] is not 1.
    upscaler: Option<Upscaler>,
    certificate: Option<Image>,
    /// The limits of the frame recorded last.
    drawn: Limits,
    timestamps: Timestamps,
    inspector: Option<Inspector>,
    picker: Option<Picker>,
    /// True while frames take the portable path because a pixel is explained from their lists.
    needs_tile_lists: bool,
    /// The rows of all pictures that are drawn, if not all are.
    band: Option<Band>,
    /// True while pictures are drawn with all Gaussians.
    is_finest: bool,
    /// The levels of frames follow a predicted PSNR, since they do not wait for pages or measurements.
    follows_prediction: bool,
    /// True while a first picture is drawn, for its stop depths.
    finds_hidden: bool,
    sampler: Option<LevelSampler>,
    /// The error limits that were searched: pictures may be repeated.
    searched: Vec<Searched>,
    /// The frame recorded last.
    last: Option<Last>,
}

/// The inputs of a frame, kept to record it again.
#[derive(Clone)]
struct Last {
    number: u64,
    camera: Camera,
    background: Background,
    /// True if the frame is finished and the lists of the portable path hold all of it.
    has_tile_lists: bool,
}

/// The error where a picture through a lens has more than colours, or is of a scene that lenses do not see.
#[derive(Debug)]
pub struct UndrawableLens {
    /// The model of the lens; none for a pinhole along rays.
    pub model: Option<&'static str>,
    /// The reason: a clause without its subject, the camera.
    pub why: &'static str,
}

impl UndrawableLens {
    /// The sentence, with what the user can do about a lens, and about a pinhole along rays.
    pub fn sentence(&self, [lens, pinhole]: [&str; 2]) -> String {
        match self.model {
            Some(model) => format!("a camera with a lens ({model}) {}; {lens}", self.why),
            None => format!("a camera along rays {}; {pinhole}", self.why),
        }
    }
}

impl std::error::Error for UndrawableLens {}

impl fmt::Display for UndrawableLens {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.write_str(&self.sentence(["--undistort draws a pinhole", "--response screen draws projections"]))
    }
}

impl Renderer {
    /// Builds the pipelines for `options` and the storage of `scene`, and tests the fast path where the device has it.
    ///
    /// # Errors
    /// If only the reference draws by these options, or device memory runs out.
    pub fn new(device: &Device, options: &Options, scene: &GpuScene) -> Result<Self> {
        Self::varied(device, options, scene, Variation::Plain)
    }

    /// Builds a renderer that also makes a certificate of every picture. `scene` is uploaded for
    /// certificates: [`Upload::is_certifiable`](crate::render::Upload::is_certifiable).
    ///
    /// # Errors
    /// If pictures with these options have no certificate: [`Options::uncertifiable`].
    pub fn certified(device: &Device, options: &Options, scene: &GpuScene) -> Result<Self> {
        options.uncertifiable().map_or(Ok(()), |why| Err(anyhow!(why)))?;
        let certificate = Some(Image::new(device, "certificate", 1, 1)?);
        Ok(Self { certificate, ..Self::varied(device, options, scene, Variation::Certifying)? })
    }

    fn varied(device: &Device, options: &Options, scene: &GpuScene, variation: Variation) -> Result<Self> {
        // Without this, LOD nodes would be drawn among the Gaussians that they replace.
        let is_finest = scene.has_lod() && !options.wants_levels();
        let options = if is_finest { options.finest() } else { *options };
        Ok(Self {
            device: device.clone(),
            options,
            scene: scene.clone(),
            choice: choose(device, &options, scene, variation)?,
            image: Image::new(device, "image", 1, 1)?,
            upscaler: (options.scale != 1.0).then(|| Upscaler::new(device)).transpose()?,
            certificate: None,
            drawn: Limits { path: Path::Portable, in_slabs: false, capacity: Capacity::default(), longest_list: 0 },
            timestamps: Timestamps::All,
            inspector: None,
            picker: None,
            needs_tile_lists: false,
            band: None,
            is_finest: false,
            follows_prediction: false,
            finds_hidden: false,
            sampler: None,
            searched: Vec::new(),
            last: None,
        })
    }

    pub(in crate::render) fn device_name(&self) -> &str {
        &self.device.capabilities().name
    }

    /// The path of the frame recorded last.
    pub fn path(&self) -> Path {
        self.drawn.path
    }

    /// Draws these features of the scene from now on, in the place of its colours or of other features.
    pub fn show(&mut self, features: &Features) {
        self.scene = self.scene.with_features(features);
    }

    /// Draws this scene from now on, if the pipelines suit it: the number formats are the same, and both scenes are
    /// whole. False if it needs another renderer. No frame may be on the GPU: it might be repeated.
    pub fn replace_scene(&mut self, scene: &GpuScene) -> bool {
        let is_drawn = !self.scene.is_paged()
            && !scene.is_paged()
            && are_drawn_alike(&self.options, [self.scene.layout(), scene.layout()]);
        if is_drawn {
            self.scene = scene.clone();
            self.last.iter_mut().for_each(|last| last.has_tile_lists = false);
        }
        is_drawn
    }

    /// The reason why the fast path is not taken although device and options allow it, or why the scene is stored in
    /// another form than the options request.
    pub fn notice(&self) -> Option<&str> {
        self.choice.notice.as_deref().or(self.scene.notice())
    }

    /// The duration of the self-test of the fast path; `None` if there was none.
    pub fn self_test_time(&self) -> Option<Duration> {
        self.choice.self_test_time
    }

    /// Makes the pipelines that only some frames need, so that these frames do not wait for them.
    #[doc(hidden)]
    pub fn prepare_portable(&mut self) -> Result<()> {
        self.choice.make_portable(&self.device)
    }

    /// Draws the resident levels of detail from now on, and loads pages beside the frames, which do not wait for them.
    /// [`Renderer::residency`] reports missing and loading pages. Does nothing for scenes without levels and for the
    /// portable path, whose frames wait for their pages.
    ///
    /// # Errors
    /// If the coarsest pages cannot be read.
    pub fn enable_page_streaming(&mut self) -> Result<()> {
        self.follows_prediction = true;
        self.choice.enable_page_streaming(&self.device, &self.scene)
    }

    /// Times every stage, or only the whole frame.
    #[doc(hidden)]
    pub fn set_timestamps(&mut self, timestamps: Timestamps) {
        self.timestamps = timestamps;
    }

    /// Starts from buffers of this capacity, so that tests see them grow.
    #[doc(hidden)]
    pub fn with_capacity(mut self, capacity: Capacity) -> Result<Self> {
        self.choice.set_capacity(&self.device, capacity)?;
        self.last = None;
        Ok(self)
    }

    /// Inspects all frames from now on.
    ///
    /// # Errors
    /// If pictures have certificates, or depths are inspected in pictures that are drawn smaller.
    pub fn set_inspection(&mut self, inspection: Inspection) -> Result<()> {
        let is_ordinary = inspection == Inspection::default();
        ensure!(is_ordinary || self.certificate.is_none(), "an inspected picture has no certificate");
        let has_depths = inspection.look == Look::Work(Work::Depths);
        ensure!(!has_depths || self.upscaler.is_none(), "depths need --scale 1: they cannot be enlarged");
        match &mut self.inspector {
            inspector if is_ordinary => *inspector = None,
            Some(inspector) if inspector.inspection.look == inspection.look => inspector.inspection = inspection,
            _ => self.inspector = Some(self.inspector(inspection)?),
        }
        Ok(())
    }

    /// The pipelines of an inspection of this scene.
    pub(crate) fn inspector(&self, inspection: Inspection) -> Result<Inspector> {
        Inspector::new(&self.device, &self.options, self.scene.layout(), inspection)
    }

    /// The image that frames are drawn into.
    pub(crate) fn image(&self) -> &Image {
        &self.image
    }

    /// Turns the counting of work in all frames on or off. Counting takes longer, and the portable path.
    #[doc(hidden)]
    pub fn count_work(&mut self, counts_work: bool) -> Result<()> {
        let variation = match (counts_work, &self.certificate) {
            (true, _) => Variation::Counting,
            (false, Some(_)) => Variation::Certifying,
            (false, None) => Variation::Plain,
        };
        // The buffers of the old and the new paths together may exceed the memory.
        self.choice.release(&self.device)?;
        self.choice = choose(&self.device, &self.options, &self.scene, variation)?;
        self.last = None;
        Ok(())
    }

    /// Renders a complete frame; [`Renderer::pixels`] reads it. If a frame does not fit its buffers, it is drawn again
    /// with larger ones.
    ///
    /// # Errors
    /// If device memory runs out or the device is lost.
    pub fn render(&mut self, camera: &Camera, background: Background) -> Result<Frame> {
        self.render_with(camera, background, |_| {}).map(|(frame, _)| frame)
    }

    /// Renders a frame behind commands that `prepare` records, like [`Renderer::render`]. Also returns the results of
    /// the last attempt.
    ///
    /// # Errors
    /// As [`Renderer::render`].
    #[doc(hidden)]
    pub fn render_with(
        &mut self,
        camera: &Camera,
        background: Background,
        prepare: impl Fn(&mut Commands),
    ) -> Result<(Frame, Results)> {
        for attempts in 1..=MAX_ATTEMPTS {
            self.choice.is_repeated = attempts > 1;
            let started = self.start_with(camera, background, &prepare);
            self.choice.is_repeated = false;
            let Started { commands, recorded } = started?;
            let results = commands.wait()?;
            if let Some(totals) = self.judge(&results, &recorded)? {
                let timings = recorded.take_timings(&mut results.timings());
                let path = self.drawn.path;
                let (parts, detail) = (recorded.parts(), self.detail(&results, &recorded));
                return Ok((Frame { totals, timings, attempts, path, parts, detail }, results));
            }
        }
        bail!("the frame did not fit its buffers in {MAX_ATTEMPTS} attempts, although they grew to what it counted")
    }

    /// Submits a frame to the GPU without waiting for it. Frames run one after the other and draw into the same
    /// picture.
    ///
    /// # Errors
    /// If device memory runs out or the device is lost.
    #[doc(hidden)]
    pub fn start(&mut self, camera: &Camera, background: Background) -> Result<Started> {
        self.start_with(camera, background, |_| {})
    }

    /// Waits for a frame. True if it is complete; otherwise the next one has larger buffers.
    ///
    /// # Errors
    /// If device memory runs out or the device is lost.
    #[doc(hidden)]
    pub fn finish(&mut self, started: Started) -> Result<bool> {
        let results = started.commands.wait()?;
        self.judge(&results, &started.recorded).map(|totals| totals.is_some())
    }

    fn start_with(
        &mut self,
        camera: &Camera,
        background: Background,
        prepare: impl Fn(&mut Commands),
    ) -> Result<Started> {
        let mut cmd = Commands::new(&self.device)?;
        cmd.set_timestamps(self.timestamps);
        prepare(&mut cmd);
        let recorded = self.record(&mut cmd, camera, background)?;
        Ok(Started { commands: cmd.submit()?, recorded })
    }

    /// Records a frame among other commands. When they have run, [`Renderer::judge`] decides whether it is complete.
    ///
    /// # Errors
    /// If device memory runs out.
    #[doc(hidden)]
    pub fn record(&mut self, cmd: &mut Commands, camera: &Camera, background: Background) -> Result<Recorded> {
        self.record_inspected(cmd, camera, background, None)
    }

    /// Records a frame like [`Renderer::record`], with `inspector` in place of the renderer's own, if there is one.
    pub(crate) fn record_inspected(
        &mut self,
        cmd: &mut Commands,
        camera: &Camera,
        background: Background,
        inspector: Option<&Inspector>,
    ) -> Result<Recorded> {
        let along_rays = (self.options.rules.response == Response::Ray).then(|| camera.along_rays());
        let shown = inspector.or(self.inspector.as_ref());
        self.refused(camera, shown.map(|inspector| &inspector.inspection)).map_or(Ok(()), Err)?;
        let camera = along_rays.as_ref().unwrap_or(camera);
        if let Some(shown) = shown.filter(|_| camera.lens.is_some()) {
            shown.prepare_rays(&self.device, &self.options, self.scene.layout())?;
        }
        let band = self.band.unwrap_or(Band::whole(camera.size_px));
        if let Some(why) = self.band.and_then(|_| Self::whole_because(&self.options, camera)) {
            bail!("a band of a picture cannot be drawn: {why}");
        }
        let unit = if self.band.is_some() { self.band_rows(camera) } else { 1 };
        ensure!(band.is_of(camera.size_px, unit), "a picture of {:?} has no {band:?}", camera.size_px);
        let (sampled, first_picture_ms) = self.choose_levels((camera, background), false)?;
        match self.fit_images(camera.size_px, band) {
            Err(error) if error.is::<OutOfMemory>() => {
                // Images precede lists, which slabs can divide.
                self.choice.release(&self.device)?;
                self.sampler = None;
                self.fit_images(camera.size_px, band)?;
            }
            other => other?,
        }
        let number = self.last.as_ref().map_or(0, |last| last.number + 1);
        self.last = Some(Last { number, camera: camera.clone(), background, has_tile_lists: false });
        let camera = &drawn_camera(&self.options, camera);
        let band = if self.band.is_some() { band } else { Band::whole(camera.size_px) };
        let inspector = inspector.or(self.inspector.as_ref());
        let attribute = inspector.and_then(|inspector| self.shown_in_pages(&inspector.inspection));
        let needs_tile_lists = self.needs_tile_lists || inspector.is_some() && attribute.is_none();
        let shot = Shot { scene: &self.scene, camera, band, patches: None };
        test_rays(&mut self.choice, &self.device, &self.scene, camera)?;
        self.drawn = self.choice.prepare(&self.device, shot, needs_tile_lists, attribute)?;
        ensure!(
            self.drawn.path == Path::Fast || !self.scene.is_placed(),
            "only the fast path draws scenes at places, and this device or these options do not take it"
        );
        let image = self.upscaler.as_ref().map_or(&self.image, |upscaler| &upscaler.drawn);
        let background = if attribute.is_some() { Background::Transparent } else { background };
        let target = Target { image, certificate: self.certificate.as_ref(), background };
        let drawn = match self.drawn.in_slabs {
            true => Some(self.choice.draw_slabs(&self.device, self.drawn.path, shot, target, inspector)?),
            false => None,
        };
        let paged = cmd.scope(FRAME, |cmd| {
            let paged = match drawn {
                None => self.choice.record(&self.device, cmd, shot, target, self.drawn, inspector)?,
                Some(_) => None,
            };
            if let Some(upscaler) = &self.upscaler {
                cmd.barrier(Access::SHADER_WRITE, Access::SHADER);
                cmd.scope("upscale", |cmd| upscaler.record(cmd, &self.image));
            }
            anyhow::Ok(paged)
        })?;
        cmd.barrier(Access::SHADER_WRITE, Access::COPY_READ);
        let counted = match drawn {
            Some(drawn) => Counted::Slabbed(Box::new(drawn)),
            None => {
                let totals = cmd.read(self.choice.totals(self.drawn.path))?;
                match paged {
                    None => Counted::Whole(totals),
                    Some(counts) => Counted::Paged(totals, counts),
                }
            }
        };
        Ok(Recorded { number, counted, limits: self.drawn, sampled, first_picture_ms })
    }

    /// The reason why pictures of a camera cannot show the scene, or an inspection of it; `None` if they can.
    pub fn refused(&self, camera: &Camera, inspection: Option<&Inspection>) -> Option<UndrawableLens> {
        let model = camera.lens.as_ref().map(|lens| lens.model());
        if model.is_none() && self.options.rules.response == Response::Screen {
            return None;
        }
        let why = if self.scene.is_placed() {
            "sees no scenes at places"
        } else if self.scene.is_paged() {
            "sees only scenes that are in GPU memory as a whole, without levels of detail"
        } else if !inspection.is_none_or(Inspection::suits_rays) {
            "has pictures without centres, outlines, isolated Gaussians and a culling camera"
        } else {
            return None;
        };
        Some(UndrawableLens { model, why })
    }

    /// Makes the images of a band of a picture of this size.
    fn fit_images(&mut self, size_px: [u32; 2], band: Band) -> Result<()> {
        let size = band.size(size_px);
        // A user knows of the picture only.
        let of_picture = |error: anyhow::Error| match error.downcast::<TooLarge>() {
            Ok(problem) => TooLarge { size: size_px, ..problem }.into(),
            Err(other) => other,
        };
        self.image.fit(&self.device, "image", size).map_err(of_picture)?;
        let drawn = self.options.drawn_size(size);
        if let Some(certificate) = &mut self.certificate {
            certificate.fit(&self.device, "certificate", drawn)?;
        }
        if let Some(upscaler) = &mut self.upscaler {
            upscaler.drawn.fit(&self.device, "drawn image", drawn)?;
        }
        Ok(())
    }

    /// The counts of a frame if it is complete. If it did not fit, the next one has larger buffers.
    ///
    /// # Errors
    /// If memory runs out or a page cannot be read.
    #[doc(hidden)]
    pub fn judge(&mut self, results: &Results, recorded: &Recorded) -> Result<Option<Totals>> {
        let (totals, paged) = match &recorded.counted {
            Counted::Slabbed(drawn) => {
                self.choice.occlusion().into_iter().for_each(Occlusion::set_used);
                return Ok(Some(drawn.totals));
            }
            Counted::Whole(totals) => (results.view(totals)[0], None),
            Counted::Paged(totals, counts) => (results.view(totals)[0], Some(counts)),
        };
        let limits = recorded.limits;
        let mut is_whole = self.choice.judge(&self.device, &totals, limits)?;
        if let Some(counts) = paged {
            is_whole = self.choice.judge_pages(&self.device, &self.scene, results, counts)? && is_whole;
            self.choice.occlusion().into_iter().filter(|_| is_whole).for_each(Occlusion::set_used);
        }
        if let Some(last) = &mut self.last {
            last.has_tile_lists = is_whole && last.number == recorded.number && self.choice.holds(limits);
        }
        Ok(is_whole.then_some(totals))
    }

    /// Width and height of the picture drawn last.
    pub fn size(&self) -> [u32; 2] {
        self.image.size()
    }

    /// The picture drawn last, to show on a screen.
    #[doc(hidden)]
    pub fn picture(&self) -> Picture<'_> {
        let Limits { path, in_slabs, capacity, longest_list } = self.drawn;
        // A frame in slabs is complete.
        let all = u64::MAX;
        let capacity = if in_slabs { Capacity { visible: all, spans: all, listed: all, ..capacity } } else { capacity };
        let longest_list = if in_slabs { u32::MAX } else { longest_list };
        let word = |count: u64| u32::try_from(count).unwrap_or(u32::MAX);
        let Capacity { visible, spans, listed, .. } = capacity;
        let room = Room { visible: word(visible), spans: word(spans), listed: word(listed), longest_list };
        Picture::of_frame(&self.image, self.choice.totals(path), room)
    }

    /// The pixels of the picture rendered last. Waits for the device.
    ///
    /// # Errors
    /// If memory runs out or the device is lost.
    pub fn pixels(&self) -> Result<Pixels> {
        read_pixels(&self.device, &self.image)
    }

    /// For every channel of every pixel, a bound on the distance of the picture rendered last from the one that
    /// [`Rules::complete`](crate::rules::Rules::complete) draws in the same order. It is proven for all omitted
    /// Gaussians, and has an allowance for rounding. `None` without [`Renderer::certified`].
    ///
    /// # Errors
    /// If memory runs out or the device is lost.
    pub fn certificate(&self) -> Result<Option<Pixels>> {
        self.certificate.as_ref().map(|certificate| read_pixels(&self.device, certificate)).transpose()
    }
}
