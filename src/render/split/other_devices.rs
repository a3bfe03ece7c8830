//! Pictures on the device of a renderer, with bands from other devices.

use std::time::Instant;

use anyhow::Result;

use super::balance::Balance;
use super::band_memory::{BandMemories, COLOURS};
use super::trial::Trial;
use super::worker::{DrawnBand, LostDevice, Order, Worker, all_drawn, band_rows, cost_ms, draw_together};
use crate::camera::Camera;
use crate::gpu::{Access, Commands, Device, Image, Timing};
use crate::host_memory::OutOfMemory;
use crate::options::Options;
use crate::render::band::Band;
use crate::render::frame_queue::{Form, FrameOutputs};
use crate::render::pack::Unpacker;
use crate::render::recorded::{Frame, Recorded};
use crate::render::renderer::Renderer;
use crate::render::slabs::SlabbedFrame;
use crate::rules::Background;

/// The name of the time in which the first device waits for the bands of the others.
const OTHERS: &str = "other devices";

/// The devices beside that of a renderer, which draw bands of its pictures.
pub struct OtherDevices {
    workers: Vec<Worker>,
    options: Options,
    balance: Balance,
    device: Device,
    unpacker: Unpacker,
    /// Memory for the bands of each worker.
    memories: Vec<BandMemories>,
    /// The image of the renderer's own band, while the renderer holds the whole picture.
    band_image: Image,
    /// Devices that were lost since the last call of [`OtherDevices::take_lost`].
    lost: Vec<LostDevice>,
    last_bands: Vec<DeviceBand>,
    trial: Trial,
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
        let memory = |(other, _): &(&Device, Renderer)| BandMemories::new(other, device);
        let memories = renderers.iter().map(memory).collect();
        let workers: Vec<_> = renderers.into_iter().map(Worker::new).collect::<Result<_>>()?;
        Ok(Self {
            balance: Balance::new(workers.len() + 1),
            workers,
            options: *options,
            device: device.clone(),
            unpacker: Unpacker::new(device)?,
            memories,
            band_image: Image::new(device, "band", 1, 1)?,
            lost: Vec::new(),
            last_bands: Vec::new(),
            trial: Trial::default(),
        })
    }

    /// True if the next picture of a camera is drawn in bands: it can be, and it pays by the times of the last ones.
    /// Pictures along rays would need other tables whenever a border moves; pictures that the first device alone draws
    /// on the portable path would change by rounding.
    pub fn are_used(&self, camera: &Camera) -> bool {
        !self.workers.is_empty()
            && self.trial.is_on(camera.size_px)
            && !Renderer::is_along_rays(&self.options, camera)
            && !Band::is_needed(camera.size_px)
            && Renderer::whole_because(&self.options, camera).is_none()
    }

    /// Takes over the GPU time of a picture that the renderer drew alone, in milliseconds.
    pub fn learn_alone(&mut self, ms: f64) {
        self.trial.learn_alone(ms);
    }

    /// The next picture is drawn by the renderer alone.
    pub fn forget_bands(&mut self) {
        self.last_bands.clear();
    }

    /// Takes over the GPU time in which the bands of a picture were joined, in milliseconds.
    pub fn learn_join(&mut self, ms: f64) {
        self.trial.learn_join(ms);
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
        self.memories.clear();
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
        let (own, mut others, mut receivers, wait) = loop {
            let bands = self.bands(renderer, camera);
            if bands.len() == 1 {
                self.last_bands.clear();
                return renderer.record(cmd, camera, background);
            }
            let mut receivers = Vec::new();
            for (worker, memories) in self.workers.iter().zip(&mut self.memories) {
                let (host, receiver) = memories.take(camera.size_px)?;
                worker.part().host = host;
                receivers.push(receiver);
            }
            let draw_own = || {
                let drawn = renderer.render_band(&mut self.band_image, bands[0], camera, background);
                (drawn, Instant::now())
            };
            let ((own, own_end), others) = draw_together(&self.workers, &order, &bands[1..], draw_own);
            let (own, wait) = (own?, own_end.elapsed());
            let (place, error) = match all_drawn(others) {
                Ok(others) => break (own, others, receivers, wait),
                Err(failed) => failed,
            };
            let name = self.workers.remove(place).device.clone();
            self.memories.remove(place);
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
        for (other, receiver) in others.iter_mut().zip(&mut receivers) {
            receiver.receive(&mut other.host)?;
        }
        let bands = Vec::from_iter(others.iter().zip(&receivers).map(|(other, own)| (other.band, &own.pixels)));
        self.unpacker.fit(&self.device, camera.size_px, &bands)?;
        self.trial.learn_bands(1e3 * order.started.elapsed().as_secs_f64());
        let recorded = renderer.record_joined(cmd, camera, joined, |cmd, image| {
            cmd.copy_top(&self.band_image, image, own_rows);
            cmd.barrier(Access::COPY_WRITE, Access::SHADER_WRITE);
            self.unpacker.record(cmd, &bands, image);
        });
        for (memories, (other, receiver)) in self.memories.iter_mut().zip(others.into_iter().zip(receivers)) {
            memories.give_back(other.host, receiver);
        }
        recorded
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

    /// Copies bands by the host, also where devices share its memory, for tests.
    #[doc(hidden)]
    pub fn copy_bands(&mut self) {
        self.memories.iter_mut().for_each(BandMemories::copy);
    }

    /// Draws all pictures in bands that can be, whether bands are faster or not, for tests.
    #[doc(hidden)]
    pub fn always_draw_bands(&mut self) {
        self.trial.is_forced = true;
    }

    /// Loses a device in the next frame, for tests.
    #[doc(hidden)]
    pub fn lose(&mut self, device: usize) {
        self.workers[device].part().is_to_be_lost = true;
    }
}
