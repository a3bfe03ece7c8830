//! One picture at a time, without a window: renders, waits, and repeats what did not fit.

use anyhow::{Context, Result, anyhow, ensure};

use crate::render::portable::blend::{Target, Variation};
use crate::render::inspect::pick::{Explainer, Explanation};
use crate::render::gpu_scene::GpuScene;
use crate::render::inspect::inspector::{Inspection, Inspector, Look, Work};
use crate::render::choice::{Limits, PathChoice};
use crate::render::shaders::{Upscale, UpscaleBindings, UpscalePush, Room, Totals};
use crate::render::portable::workspace::Capacity;
use crate::camera::Camera;
use crate::gpu::{
    Access, Buffer, Commands, Device, DispatchSize, Image, InFlight, Readback, Results, Stage, Timestamps, Timing,
};
use crate::host_memory::host_vec;
use crate::options::Options;
use crate::rules::Background;
use crate::pixels::Pixels;

/// Renders pictures of one scene, keeping its buffers from one to the next.
pub struct Renderer {
    device: Device,
    options: Options,
    scene: GpuScene,
    paths: PathChoice,
    image: Image,
    /// What is drawn smaller than the picture.
    enlarged: Option<Enlarged>,
    certificate: Option<Image>,
    /// Of the frame recorded last.
    drawn: Limits,
    timestamps: Timestamps,
    inspector: Option<Inspector>,
    explainer: Option<Explainer>,
    /// The lists of the frame are read, those of the portable path.
    needs_lists: bool,
    /// The frame recorded last.
    last: Option<Last>,
}

/// A frame, as it would be recorded again.
#[derive(Clone)]
struct Last {
    number: u64,
    camera: Camera,
    background: Background,
    /// It is done, and the lists of the portable path hold all of it.
    is_whole: bool,
}

/// A picture that is drawn smaller, and enlarged.
struct Enlarged {
    drawn: Image,
    stage: Stage<Upscale>,
}

/// What a frame reported of itself.
#[derive(Clone, Debug)]
pub struct Frame {
    pub totals: Totals,
    pub timings: Vec<Timing>,
    /// Times the frame was begun: more than one if something did not fit at first.
    pub attempts: u32,
}

/// A frame on the GPU.
pub struct Started {
    commands: InFlight,
    recorded: Recorded,
}

/// A frame among commands that are recorded: whether it is complete is known when they are done.
pub struct Recorded {
    number: u64,
    totals: Readback<Totals>,
    limits: Limits,
}

/// More attempts than any frame needs: each grows to the demand of the one before, and demands hide behind one another
/// (visible, spans and instances, list length), on either path.
pub(super) const MAX_ATTEMPTS: u32 = 10;

impl Renderer {
    pub fn new(device: &Device, options: &Options, scene: &GpuScene) -> Result<Self> {
        Self::varied(device, options, scene, Variation::default())
    }

    /// Also makes a certificate of every picture: `scene` is [`GpuScene::certifiable`].
    pub fn certified(device: &Device, options: &Options, scene: &GpuScene) -> Result<Self> {
        options.uncertifiable().map_or(Ok(()), |why| Err(anyhow!(why)))?;
        let variation = Variation { certifies: true, ..Variation::default() };
        let certificate = Some(Image::new(device, "certificate", 1, 1)?);
        Ok(Self { certificate, ..Self::varied(device, options, scene, variation)? })
    }

    fn varied(device: &Device, options: &Options, scene: &GpuScene, variation: Variation) -> Result<Self> {
        Ok(Self {
            device: device.clone(),
            options: *options,
            scene: scene.clone(),
            paths: PathChoice::new(device, options, scene, variation)?,
            image: Image::new(device, "image", 1, 1)?,
            enlarged: match options.scale {
                1.0 => None,
                _ => {
                    Some(Enlarged { drawn: Image::new(device, "drawn image", 1, 1)?, stage: Stage::new(device, &())? })
                }
            },
            certificate: None,
            drawn: Limits { is_fast: false, room: Capacity::default(), longest_list: 0 },
            timestamps: Timestamps::All,
            inspector: None,
            explainer: None,
            needs_lists: false,
            last: None,
        })
    }

    /// Why the device's fast path is not taken, if it should have been.
    pub fn notice(&self) -> Option<&str> {
        self.paths.notice.as_deref()
    }

    /// Whether stages are timed, or only the whole frame.
    pub fn set_timestamps(&mut self, timestamps: Timestamps) {
        self.timestamps = timestamps;
    }

    /// Starts from this much room, to see it grow.
    pub fn with_room(mut self, room: Capacity) -> Result<Self> {
        self.paths.set_room(&self.device, room)?;
        self.last = None;
        Ok(self)
    }

    /// From here on pictures show what is looked at.
    pub fn set_inspection(&mut self, inspection: Inspection) -> Result<()> {
        let is_ordinary = inspection == Inspection::default();
        ensure!(is_ordinary || self.certificate.is_none(), "a picture that is inspected has no certificate");
        let has_depths = inspection.look == Look::Work(Work::Depths);
        ensure!(!has_depths || self.enlarged.is_none(), "depths of a picture that is drawn smaller cannot be enlarged");
        match &mut self.inspector {
            inspector if is_ordinary => *inspector = None,
            Some(inspector) if inspector.inspection.look == inspection.look => inspector.inspection = inspection,
            inspector => {
                *inspector = Some(Inspector::new(&self.device, &self.options, self.scene.layout(), inspection)?);
            }
        }
        Ok(())
    }

    /// From here on frames count their work, which takes longer, or do not.
    pub fn count_work(&mut self, counts_work: bool) -> Result<()> {
        let variation = Variation { counts_work, certifies: self.certificate.is_some() };
        self.paths = PathChoice::new(&self.device, &self.options, &self.scene, variation)?;
        self.last = None;
        Ok(())
    }

    /// Device memory for everything but the scene: every buffer's name and bytes.
    pub fn buffers(&self) -> Vec<(&str, u64)> {
        let mut buffers = self.paths.buffers();
        buffers.push(("image", self.image.bytes()));
        buffers.extend(self.certificate.iter().map(|certificate| ("certificate", certificate.bytes())));
        buffers.extend(self.enlarged.iter().map(|enlarged| ("drawn image", enlarged.drawn.bytes())));
        buffers
    }

    /// Passes over its keys that a frame's sort by depth takes, and its sort by tile.
    pub fn sort_passes(&self, camera: &Camera) -> [u32; 2] {
        self.paths.renderer.sort_passes(&self.scene, camera)
    }

    /// Renders a complete frame; [`Renderer::pixels`] reads it.
    pub fn render(&mut self, camera: &Camera, background: Background) -> Result<Frame> {
        self.render_with(camera, background, |_| {}).map(|(frame, _)| frame)
    }

    /// As [`Renderer::render`], with commands prepared by `prepare`; also returns what the last attempt brought back.
    pub fn render_with(
        &mut self,
        camera: &Camera,
        background: Background,
        prepare: impl Fn(&mut Commands),
    ) -> Result<(Frame, Results)> {
        for attempts in 1..=MAX_ATTEMPTS {
            let started = self.start_with(camera, background, &prepare)?;
            if let Some((totals, results)) = self.finish_with(started)? {
                return Ok((Frame { totals, timings: results.timings().to_vec(), attempts }, results));
            }
        }
        unreachable!("a frame fits after it has grown to its own demand");
    }

    /// Hands a frame to the GPU without waiting for it. Frames run one after the other, into the same picture.
    pub fn start(&mut self, camera: &Camera, background: Background) -> Result<Started> {
        self.start_with(camera, background, |_| {})
    }

    /// Waits for a frame: whether it is complete. If it did not fit, the next one has more room.
    pub fn finish(&mut self, started: Started) -> Result<bool> {
        self.finish_with(started).map(|done| done.is_some())
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

    fn finish_with(&mut self, started: Started) -> Result<Option<(Totals, Results)>> {
        let results = started.commands.wait()?;
        let totals = self.judge(&results, &started.recorded)?;
        Ok(totals.map(|totals| (totals, results)))
    }

    /// Records a frame among other commands; [`Renderer::judge`] says whether it came out whole.
    pub fn record(&mut self, cmd: &mut Commands, camera: &Camera, background: Background) -> Result<Recorded> {
        fit(&self.device, &mut self.image, "image", camera.size_px)?;
        let number = self.last.as_ref().map_or(0, |last| last.number + 1);
        self.last = Some(Last { number, camera: camera.clone(), background, is_whole: false });
        let camera = &camera.sampled(self.options.drawn_size(camera.size_px));
        if let Some(certificate) = &mut self.certificate {
            fit(&self.device, certificate, "certificate", camera.size_px)?;
        }
        if let Some(enlarged) = &mut self.enlarged {
            fit(&self.device, &mut enlarged.drawn, "drawn image", camera.size_px)?;
        }
        let inspector = self.inspector.as_ref();
        let needs_lists = self.needs_lists || inspector.is_some();
        self.drawn = self.paths.prepare(&self.device, self.scene.len(), camera.size_px, needs_lists)?;
        cmd.scope("frame", |cmd| {
            let image = self.enlarged.as_ref().map_or(&self.image, |enlarged| &enlarged.drawn);
            let target = Target { image, certificate: self.certificate.as_ref(), background };
            self.paths.record(cmd, (&self.scene, camera), target, self.drawn, inspector);
            if let Some(enlarged) = &self.enlarged {
                cmd.barrier(Access::SHADER_WRITE, Access::SHADER);
                cmd.scope("enlarge", |cmd| enlarged.record(cmd, &self.image));
            }
        });
        cmd.barrier(Access::SHADER_WRITE, Access::COPY_READ);
        Ok(Recorded { number, totals: cmd.read(self.totals())?, limits: self.drawn })
    }

    /// What a frame counted, if it is complete. If it did not fit, the next one has more room.
    pub fn judge(&mut self, results: &Results, recorded: &Recorded) -> Result<Option<Totals>> {
        let totals = results.view(&recorded.totals)[0];
        let limits = recorded.limits;
        let is_whole = self.paths.judge(&self.device, &totals, limits)?;
        if let Some(last) = &mut self.last {
            last.is_whole = is_whole && last.number == recorded.number && self.paths.holds(limits);
        }
        Ok(is_whole.then_some(totals))
    }

    /// What a pixel of the frame recorded last is made of, in 32-bit floats; where pictures are drawn smaller, what the
    /// nearest drawn pixel is. Waits, and renders the frame again if it is not known to be complete.
    pub fn explain(&mut self, pixel: [u32; 2]) -> Result<Explanation> {
        let Last { camera, background, is_whole, .. } = self.last.clone().context("nothing is rendered yet")?;
        let size = camera.size_px;
        ensure!(pixel[0] < size[0] && pixel[1] < size[1], "pixel {pixel:?} lies outside of a picture of {size:?}");
        if !is_whole {
            self.needs_lists = true;
            let rendered = self.render(&camera, background);
            self.needs_lists = false;
            rendered?;
        }
        let explainer = match &mut self.explainer {
            Some(explainer) => explainer,
            none => none.insert(Explainer::new(&self.device, &self.options)?),
        };
        let drawn = self.options.drawn_size(size);
        let pixel = std::array::from_fn(|i| {
            let place = (f64::from(pixel[i]) + 0.5) / f64::from(size[i]) * f64::from(drawn[i]);
            (place as u32).min(drawn[i] - 1)
        });
        let view = (&self.scene, &camera.sampled(drawn));
        let explained = explainer.explain(&self.device, &self.paths.renderer, view, &self.paths.work, pixel)?;
        if !is_whole {
            // The picture stays what it was, to the last bit.
            self.render(&camera, background)?;
        }
        Ok(explained)
    }

    /// Width and height of the picture drawn last.
    pub fn size(&self) -> [u32; 2] {
        self.image.size()
    }

    /// The image of the picture drawn last.
    pub(super) fn image(&self) -> &Image {
        &self.image
    }

    /// What the frame drawn last counted.
    pub(super) fn totals(&self) -> &Buffer<Totals> {
        self.paths.totals(self.drawn)
    }

    /// What the frame drawn last had room for, as the shader that shows it takes it.
    pub(super) fn drawn_room(&self) -> Room {
        let Limits { room, longest_list, .. } = self.drawn;
        let word = |count: u64| u32::try_from(count).unwrap_or(u32::MAX);
        Room { visible: word(room.visible), spans: word(room.spans), instances: word(room.instances), longest_list }
    }

    /// The picture rendered last.
    pub fn pixels(&self) -> Result<Pixels> {
        read_pixels(&self.device, &self.image)
    }

    /// In every channel of every pixel, how far the picture rendered last is at most from what
    /// [`Rules::complete`](crate::rules::Rules::complete) shows in the same order: proven for what was left out, with an
    /// allowance for rounding. `None` without [`Renderer::certified`].
    pub fn certificate(&self) -> Result<Option<Pixels>> {
        self.certificate.as_ref().map(|certificate| read_pixels(&self.device, certificate)).transpose()
    }
}

impl Enlarged {
    fn record(&self, cmd: &mut Commands, image: &Image) {
        let push = UpscalePush { drawn_size_px: self.drawn.size(), size_px: image.size() };
        let pixels = image.size().iter().map(|side| u64::from(*side)).product();
        cmd.dispatch(&self.stage, UpscaleBindings { drawn: &self.drawn, image }, push, DispatchSize::Invocations(pixels));
    }
}

/// Makes the image anew if it has not this size.
fn fit(device: &Device, image: &mut Image, name: &str, size: [u32; 2]) -> Result<()> {
    if image.size() != size {
        *image = Image::new(device, name, size[0], size[1])?;
    }
    Ok(())
}

/// An image as it is after all that was submitted.
pub(crate) fn read_pixels(device: &Device, image: &Image) -> Result<Pixels> {
    const BAND_BYTES: u32 = 256 << 20; // of staging memory at a time
    let [width, height] = image.size();
    let band = (BAND_BYTES / 16 / width).max(1);
    let mut rgba = host_vec(width as usize * height as usize, "picture")?;
    for top in (0..height).step_by(band as usize) {
        let mut cmd = Commands::new(device)?;
        let rows = cmd.read_rows(image, top..height.min(top + band))?;
        let results = cmd.submit()?.wait()?;
        rgba.extend_from_slice(results.view(&rows));
    }
    Ok(Pixels { size: [width, height], rgba })
}
