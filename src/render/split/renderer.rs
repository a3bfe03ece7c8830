//! Draws the bands of a frame on several devices at the same time.

use std::time::{Duration, Instant};

use anyhow::{Result, ensure};

use super::balance::Balance;
use super::worker::{DrawnBand, LostDevice, Order, Worker, all_drawn, band_rows, draw_together};
use crate::camera::Camera;
use crate::gpu::{Device, DeviceLost};
use crate::options::Options;
use crate::render::band::Band;
use crate::render::frame_queue::FrameOutputs;
use crate::render::renderer::Renderer;
use crate::rules::Background;

/// Draws pictures of one scene on several devices, a band on each.
pub struct SplitRenderer {
    workers: Vec<Worker>,
    options: Options,
    balance: Balance,
    /// Devices that were lost since the last call of [`SplitRenderer::take_lost`].
    lost: Vec<LostDevice>,
}

/// A picture in bands.
pub struct SplitFrame {
    /// The bands, from top to bottom.
    pub bands: Vec<DrawnBand>,
    /// From the call to the last pixel in host memory.
    pub latency: Duration,
}

impl SplitRenderer {
    /// A renderer of each device, all of the same scene and of these options.
    ///
    /// # Errors
    /// If the system refuses a thread.
    pub fn new(options: &Options, renderers: Vec<(&Device, Renderer)>) -> Result<Self> {
        let workers: Vec<_> = renderers.into_iter().map(Worker::new).collect::<Result<_>>()?;
        Ok(Self { options: *options, balance: Balance::new(workers.len()), workers, lost: Vec::new() })
    }

    /// Draws a picture. Its pixels go to host memory in the forms of `outputs`. The first device draws pictures that
    /// have no bands ([`Renderer::whole_because`]). If a device is lost, the others draw the picture again.
    ///
    /// # Errors
    /// If memory runs out, or no device is left.
    pub fn render(&mut self, camera: &Camera, background: Background, outputs: &FrameOutputs) -> Result<SplitFrame> {
        let started = Instant::now();
        let (camera, outputs) = (camera.clone(), outputs.clone());
        let order = Order { camera, band: None, background, outputs, started };
        loop {
            ensure!(!self.workers.is_empty(), "no device is left to draw");
            let bands = self.bands(&order.camera);
            let (lost, error) = match all_drawn(self.draw(&order, &bands)) {
                Ok(bands) => {
                    self.balance.learn(&Vec::from_iter(bands.iter().map(DrawnBand::cost_ms)));
                    return Ok(SplitFrame { bands, latency: started.elapsed() });
                }
                Err(failed) => failed,
            };
            // Any other error would come again, and is given out; so is the loss of the last device.
            if !error.is::<DeviceLost>() || self.workers.len() == 1 {
                return Err(error);
            }
            let name = self.workers.remove(lost).device.clone();
            self.lost.push(LostDevice { place: lost, name, error });
            self.balance = Balance::new(self.workers.len());
        }
    }

    fn bands(&mut self, camera: &Camera) -> Vec<Band> {
        if Renderer::whole_because(&self.options, camera).is_some() {
            return vec![Band::whole(camera.size_px)];
        }
        self.balance.bands(camera.size_px[1], band_rows(&self.workers, camera))
    }

    fn draw(&self, order: &Order, bands: &[Band]) -> Vec<Result<DrawnBand>> {
        let (first, others) = (&self.workers[0], &self.workers[1..]);
        if let [_] = bands {
            return vec![first.part().draw(order)];
        }
        let (drawn, others) = draw_together(others, order, &bands[1..], || first.part().draw(&order.of(bands[0])));
        std::iter::once(drawn).chain(others).collect()
    }

    /// Gives back the host memory of a frame for the next one.
    pub fn recycle(&mut self, frame: SplitFrame) {
        for (worker, band) in self.workers.iter().zip(frame.bands) {
            worker.part().host = band.host;
        }
    }

    /// The devices that were lost since the last call, in the order of their losses.
    pub fn take_lost(&mut self) -> Vec<LostDevice> {
        std::mem::take(&mut self.lost)
    }

    /// The number of devices that draw.
    pub fn devices(&self) -> usize {
        self.workers.len()
    }

    /// Loses a device in the next frame, for tests.
    #[doc(hidden)]
    pub fn lose(&mut self, device: usize) {
        self.workers[device].part().is_to_be_lost = true;
    }
}
