//! Pictures on the device of a renderer, with bands from other devices.

use std::time::Instant;

use anyhow::{Context, Result};

use super::balance::Balance;
use super::worker::{DrawnBand, LostDevice, Order, Worker, all_drawn, band_rows, cost_ms, draw_together};
use crate::camera::Camera;
use crate::gpu::{Access, Commands, Device, Image, Staging, Timing};
use crate::host_memory::OutOfMemory;
use crate::options::Options;
use crate::pixels::Integers;
use crate::render::band::Band;
use crate::render::frame_queue::{Form, FrameOutputs};
use crate::render::pack::{PackedBand, Unpacker};
use crate::render::recorded::{Frame, Recorded};
use crate::render::renderer::Renderer;
use crate::render::slabs::SlabbedFrame;
use crate::rules::Background;

/// The GPU time of a picture from which bands are tried, in milliseconds: the pixels of bands are copied twice, and the
/// frames of the first device no longer overlap.
pub const PAYS_FROM_MS: f64 = 5.0;

/// Frames in bands until one is drawn by the first device alone, to see which is faster; and frames that are drawn so
/// if bands are not.
const TRIED: u32 = 100;

/// The part of the time of a frame that bands must save at least.
const GAIN: f64 = 0.03;

/// The form in which bands come to the first device: the fewest bytes that a screen needs.
const COLOURS: Integers = Integers::Rgb8;

/// The name of the time in which the first device waits for the bands of the others.
const OTHERS: &str = "other devices";

/// The devices beside that of a renderer, which draw bands of its pictures.
pub struct OtherDevices {
    workers: Vec<Worker>,
    options: Options,
    balance: Balance,
    device: Device,
    unpacker: Unpacker,
    /// Memory for the pixels of bands, from which the first device copies.
    packed: Vec<Staging<u32>>,
    /// The image of the renderer's own band, while the renderer holds the whole picture.
    band_image: Image,
    /// Devices that were lost since the last call of [`OtherDevices::take_lost`].
    lost: Vec<LostDevice>,
    last_bands: Vec<DeviceBand>,
    /// The GPU time of the last picture that the first device drew alone, in milliseconds.
    alone_ms: f64,
    /// The time of the last picture in bands, from its begin until all bands were there, in milliseconds.
    shared_ms: f64,
    /// Pictures in bands since the last one that the first device drew alone.
    tried: u32,
    /// Pictures that the first device draws alone before the next one in bands.
    left_alone: u32,
    pays_from_ms: f64,
}

/// The band of a device in the last picture.
#[derive(Clone, Debug, PartialEq)]
pub struct DeviceBand {
    pub device: String,
    pub band: Band,
    /// The time of the band on the GPU, in milliseconds.
    pub ms: f64,
}

impl OtherDevices {
    /// A renderer of each other device, with the scene and the options of that on `device`.
    ///
    /// # Errors
    /// If the system refuses a thread, or memory runs out.
    pub fn new(device: &Device, options: &Options, renderers: Vec<(&Device, Renderer)>) -> Result<Self> {
        let workers: Vec<_> = renderers.into_iter().map(Worker::new).collect::<Result<_>>()?;
        Ok(Self {
            balance: Balance::new(workers.len() + 1),
            workers,
            options: *options,
            device: device.clone(),
            unpacker: Unpacker::new(device)?,
            packed: Vec::new(),
            band_image: Image::new(device, "band", 1, 1)?,
            lost: Vec::new(),
            last_bands: Vec::new(),
            alone_ms: 0.0,
            shared_ms: 0.0,
            tried: 0,
            left_alone: 0,
            pays_from_ms: PAYS_FROM_MS,
        })
    }

    /// True if the next picture of a camera is drawn in bands: it can be, and it pays by the times of the last ones.
    /// Pictures along rays would need other tables whenever a border moves; pictures that the first device alone draws
    /// on the portable path would change by rounding.
    pub fn are_used(&self, camera: &Camera) -> bool {
        !self.workers.is_empty()
            && self.left_alone == 0
            && self.alone_ms >= self.pays_from_ms
            && !Renderer::is_along_rays(&self.options, camera)
            && !Band::is_needed(camera.size_px)
            && Renderer::whole_because(&self.options, camera).is_none()
    }

    /// Takes over the GPU time of a picture that the renderer drew alone, in milliseconds.
    pub fn learn_alone(&mut self, ms: f64) {
        let is_tried = self.tried > 0;
        (self.alone_ms, self.tried) = (ms, 0);
        self.last_bands.clear();
        self.left_alone = self.left_alone.saturating_sub(1);
        if is_tried && self.pays_from_ms > 0.0 && self.shared_ms > (1.0 - GAIN) * ms {
            self.left_alone = TRIED;
        }
    }

    /// Draws a picture of `renderer` in bands, as `record_bands` does. If the first device has too little memory for
    /// that, the renderer draws this picture and all later ones alone.
    ///
    /// # Errors
    /// If the renderer's own device is lost, or its memory runs out.
    pub fn record(
        &mut self,
        renderer: &mut Renderer,
        cmd: &mut Commands,
        camera: &Camera,
        background: Background,
    ) -> Result<Recorded> {
        let recorded = self.record_bands(renderer, cmd, camera, background);
        let Err(problem) = recorded else { return recorded };
        if !problem.is::<OutOfMemory>() {
            return Err(problem);
        }
        let name = Vec::from_iter(self.workers.iter().map(|worker| worker.device.as_str())).join(", ");
        self.lost.push(LostDevice { place: 0, name, error: problem });
        self.workers.clear();
        self.packed.clear();
        self.last_bands.clear();
        self.band_image = Image::new(&self.device, "band", 1, 1)?;
        renderer.record(cmd, camera, background)
    }

    /// Draws a picture of `renderer` in bands, and records the copies that join them. The picture is complete when the
    /// copies have run. Its colours are rounded to 8 bits below the first band, as on a screen; so rounded, all are
    /// those of a picture that `renderer` draws alone, if the devices are of one kind. If another device fails, those
    /// that are left draw the picture again.
    ///
    /// # Errors
    /// If the renderer's own device is lost, or its memory runs out.
    fn record_bands(
        &mut self,
        renderer: &mut Renderer,
        cmd: &mut Commands,
        camera: &Camera,
        background: Background,
    ) -> Result<Recorded> {
        let outputs = FrameOutputs { picture: vec![Form::Integers(COLOURS)], ..FrameOutputs::default() };
        let order = Order { camera: camera.clone(), band: None, background, outputs, started: Instant::now() };
        let (own, mut others, wait) = loop {
            let bands = self.bands(renderer, camera);
            if bands.len() == 1 {
                self.last_bands.clear();
                return renderer.record(cmd, camera, background);
            }
            let draw_own = || {
                let drawn = renderer.render_band(&mut self.band_image, bands[0], camera, background);
                (drawn, Instant::now())
            };
            let ((own, own_end), others) = draw_together(&self.workers, &order, &bands[1..], draw_own);
            let (own, wait) = (own?, own_end.elapsed());
            let (place, error) = match all_drawn(others) {
                Ok(others) => break (own, others, wait),
                Err(failed) => failed,
            };
            let name = self.workers.remove(place).device.clone();
            self.lost.push(LostDevice { place, name, error });
            self.balance = Balance::new(self.workers.len() + 1);
        };
        self.learn(renderer, &own, &others);
        let wait = Timing { name: OTHERS, depth: 1, start_ms: 0.0, duration_ms: 1e3 * wait.as_secs_f64() };
        let stages = own.timings.into_iter().filter(|timing| timing.depth == 1);
        let joined = SlabbedFrame {
            totals: others.iter().fold(own.totals, |sum, band| sum.plus(&band.frame.totals)),
            timings: stages.chain([wait]).collect(),
            report: own.parts.unwrap_or_default(),
            detail: own.detail,
        };
        let own_rows = others[0].band.top;
        let (packed, bands) = self.packed(&mut others)?;
        self.unpacker.fit(&self.device, packed.len())?;
        let recorded = renderer.record_joined(cmd, camera, joined, |cmd, image| {
            cmd.copy_top(&self.band_image, image, own_rows);
            cmd.barrier(Access::COPY_WRITE, Access::SHADER_WRITE);
            self.unpacker.record(cmd, &packed, &bands, image);
        });
        self.packed.push(packed);
        for (worker, band) in self.workers.iter().zip(others) {
            worker.part().host = band.host;
        }
        self.shared_ms = 1e3 * order.started.elapsed().as_secs_f64();
        self.tried += 1;
        let is_to_be_compared = self.tried >= TRIED || self.shared_ms > self.alone_ms;
        self.left_alone = u32::from(self.pays_from_ms > 0.0 && is_to_be_compared);
        recorded
    }

    /// The pixels of the bands in memory that the first device reads, and their places there.
    fn packed(&mut self, bands: &mut [DrawnBand]) -> Result<(Staging<u32>, Vec<PackedBand>)> {
        let mut words = 0;
        let mut place = |band: &DrawnBand| {
            let first_word = words;
            words += COLOURS.words(band.host.size());
            PackedBand { band: band.band, first_word }
        };
        let places = Vec::from_iter(bands.iter().map(&mut place));
        // Memory of a size that is no longer needed is freed.
        self.packed.retain(|packed| packed.len() == words || !packed.is_idle());
        let mut packed = match self.packed.iter().position(Staging::is_idle) {
            Some(idle) => self.packed.swap_remove(idle),
            None => Staging::new(&self.device, "bands", words)?,
        };
        let memory = packed.map();
        for (band, place) in bands.iter_mut().zip(&places) {
            let bytes = band.host.integers(COLOURS).context("bands have colours")?;
            // Not by the pool that shares work: a long job there would keep the window waiting.
            bytemuck::cast_slice_mut::<u32, u8>(&mut memory[place.first_word..])[..bytes.len()].copy_from_slice(bytes);
        }
        Ok((packed, places))
    }

    fn bands(&mut self, renderer: &Renderer, camera: &Camera) -> Vec<Band> {
        let unit = renderer.band_rows(camera).max(band_rows(&self.workers, camera));
        self.balance.bands(camera.size_px[1], unit)
    }

    fn learn(&mut self, renderer: &Renderer, own: &Frame, others: &[DrawnBand]) {
        let own_rows = others[0].band.top;
        let own = (renderer.device_name().to_owned(), Band { top: 0, rows: own_rows }, cost_ms(own));
        let others = others.iter().map(|band| (band.device.clone(), band.band, band.cost_ms()));
        let last_bands = std::iter::once(own).chain(others);
        self.last_bands = last_bands.map(|(device, band, ms)| DeviceBand { device, band, ms }).collect();
        let times = Vec::from_iter(self.last_bands.iter().map(|band| band.ms));
        self.balance.learn(&times);
    }

    /// The bands of the last picture, from top to bottom; empty if the renderer drew it alone.
    pub fn last_bands(&self) -> &[DeviceBand] {
        &self.last_bands
    }

    /// The name and the bytes of every buffer on the first device.
    pub fn buffers(&self) -> [(&str, u64); 1] {
        [("band", self.band_image.bytes())]
    }

    /// The devices that failed since the last call, in this order.
    pub fn take_lost(&mut self) -> Vec<LostDevice> {
        std::mem::take(&mut self.lost)
    }

    /// Draws pictures in bands from another GPU time on, and from 0 on whether they are faster or not, for tests.
    #[doc(hidden)]
    pub fn pay_from(&mut self, ms: f64) {
        (self.pays_from_ms, self.left_alone) = (ms, 0);
    }

    /// Loses a device in the next frame, for tests.
    #[doc(hidden)]
    pub fn lose(&mut self, device: usize) {
        self.workers[device].part().is_to_be_lost = true;
    }
}
