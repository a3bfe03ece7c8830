//! Pictures on the device of a renderer, with bands from other devices.

use std::time::Instant;

use anyhow::{Context, Result};
use rayon::prelude::*;

use super::balance::Balance;
use super::worker::{DrawnBand, LostDevice, Order, Worker, cost_ms, draw_together};
use crate::camera::Camera;
use crate::gpu::{Access, Commands, Device, Image, Staging, Timing};
use crate::options::Options;
use crate::pixels::Integers;
use crate::render::band::Band;
use crate::render::frame_queue::{Form, FrameOutputs};
use crate::render::pack::Unpacker;
use crate::render::recorded::{Frame, Recorded};
use crate::render::renderer::Renderer;
use crate::render::slabs::SlabbedFrame;
use crate::rules::Background;

/// The GPU time of a picture from which bands pay, in milliseconds: the pixels of bands are copied twice, and the
/// frames of the first device no longer overlap (docs/films.md).
pub const PAYS_FROM_MS: f64 = 5.0;

/// The form in which bands come to the first device: the fewest bytes that a screen needs.
const COLOURS: Integers = Integers::Rgb8;

/// The bytes that a thread copies at once.
const COPIED: usize = 1 << 20;

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
    /// The GPU time of the last picture on all devices together, in milliseconds.
    cost_ms: f64,
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
            cost_ms: 0.0,
            pays_from_ms: PAYS_FROM_MS,
        })
    }

    /// True if pictures of a camera are drawn in bands: they can be, and it pays by the time of the last picture.
    pub fn are_used(&self, camera: &Camera) -> bool {
        !self.workers.is_empty()
            && self.cost_ms >= self.pays_from_ms
            && Renderer::whole_because(&self.options, camera).is_none()
    }

    /// Takes over the GPU time of a picture that the renderer drew alone, in milliseconds.
    pub fn learn_whole(&mut self, ms: f64) {
        self.cost_ms = ms;
        self.last_bands.clear();
    }

    /// Draws a picture of `renderer` in bands, and records the copies that join them. The picture is complete when the
    /// copies have run. Its colours are rounded to 8 bits below the first band, as on a screen; so rounded, all are
    /// those of a picture that `renderer` draws alone, if the devices are of one kind. If another device fails, those
    /// that are left draw the picture again.
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
            let ((own, own_end), mut others) = draw_together(&self.workers, &order, &bands[1..], draw_own);
            let (own, wait) = (own?, own_end.elapsed());
            let Some(place) = others.iter().position(Result::is_err) else {
                break (own, Vec::from_iter(others.into_iter().map_while(Result::ok)), wait);
            };
            let Err(error) = others.swap_remove(place) else { unreachable!("the place of an error") };
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
        recorded
    }

    /// The pixels of the bands in memory that the first device reads, and the first word of each band.
    fn packed(&mut self, bands: &mut [DrawnBand]) -> Result<(Staging<u32>, Vec<(Band, usize)>)> {
        let mut words = 0;
        let mut place = |band: &DrawnBand| {
            let first = words;
            words += COLOURS.words(band.host.size());
            (band.band, first)
        };
        let places = Vec::from_iter(bands.iter().map(&mut place));
        // Memory of a size that is no longer needed is freed.
        self.packed.retain(|packed| packed.len() == words || !packed.is_idle());
        let mut packed = match self.packed.iter().position(Staging::is_idle) {
            Some(idle) => self.packed.swap_remove(idle),
            None => Staging::new(&self.device, "bands", words)?,
        };
        let memory = packed.map();
        for (band, (_, first)) in bands.iter_mut().zip(&places) {
            let bytes = band.host.integers(COLOURS).context("bands have colours")?;
            let memory = bytemuck::cast_slice_mut::<u32, u8>(&mut memory[*first..]);
            let parts = memory[..bytes.len()].par_chunks_mut(COPIED).zip(bytes.par_chunks(COPIED));
            parts.for_each(|(to, from)| to.copy_from_slice(from));
        }
        Ok((packed, places))
    }

    fn bands(&mut self, renderer: &Renderer, camera: &Camera) -> Vec<Band> {
        let units = self.workers.iter().map(|worker| worker.part().queue.renderer().band_rows(camera));
        let unit = units.chain([renderer.band_rows(camera)]).max().unwrap_or(1);
        self.balance.bands(camera.size_px[1], unit)
    }

    fn learn(&mut self, renderer: &Renderer, own: &Frame, others: &[DrawnBand]) {
        let own_rows = others[0].band.top;
        let own = (renderer.device_name().to_owned(), Band { top: 0, rows: own_rows }, cost_ms(own));
        let others = others.iter().map(|band| (band.device.clone(), band.band, band.cost_ms()));
        let last_bands = std::iter::once(own).chain(others);
        self.last_bands = last_bands.map(|(device, band, ms)| DeviceBand { device, band, ms }).collect();
        let times = Vec::from_iter(self.last_bands.iter().map(|band| band.ms));
        self.cost_ms = times.iter().sum();
        self.balance.learn(&times);
    }

    /// The bands of the last picture, from top to bottom; empty if the renderer drew it alone.
    pub fn last_bands(&self) -> &[DeviceBand] {
        &self.last_bands
    }

    /// The devices that failed since the last call, in this order.
    pub fn take_lost(&mut self) -> Vec<LostDevice> {
        std::mem::take(&mut self.lost)
    }

    /// Draws pictures in bands from another GPU time on, for tests.
    #[doc(hidden)]
    pub fn pay_from(&mut self, ms: f64) {
        self.pays_from_ms = ms;
    }

    /// Loses a device in the next frame, for tests.
    #[doc(hidden)]
    pub fn lose(&mut self, device: usize) {
        self.workers[device].part().is_to_be_lost = true;
    }
}
