//! Draws the bands of a frame on several devices at the same time.

use std::time::{Duration, Instant};

use anyhow::{Result, ensure};

use super::balance::Balance;
use crate::camera::Camera;
use crate::gpu::{Device, DeviceLost};
use crate::render::band::Band;
use crate::render::frame_queue::{Finished, FrameOutputs, FrameQueue, HostFrame};
use crate::render::recorded::Frame;
use crate::render::renderer::Renderer;
use crate::rules::Background;
use crate::threads::{self, joined};

/// Draws pictures of one scene on several devices, a band on each.
pub struct SplitRenderer {
    parts: Vec<Part>,
    balance: Balance,
    /// Devices that were lost since the last call of [`SplitRenderer::take_lost`], with the reasons.
    lost: Vec<(String, anyhow::Error)>,
}

/// A device, and the memory for its bands.
struct Part {
    device: String,
    queue: FrameQueue,
    host: HostFrame,
    /// It is lost in the next frame, for tests.
    is_to_be_lost: bool,
}

/// A picture in bands.
pub struct SplitFrame {
    /// The bands, from top to bottom.
    pub bands: Vec<DrawnBand>,
    /// From the call to the last pixel in host memory.
    pub latency: Duration,
}

/// A band of a picture, and the work of its device.
pub struct DrawnBand {
    pub device: String,
    pub band: Band,
    /// The counts and the times of the frame of the band.
    pub frame: Frame,
    /// From the begin of the frame until the pixels of the band were in host memory.
    pub latency: Duration,
    /// The pixels of the band. The renderer keeps them if they are given back: [`SplitRenderer::recycle`].
    pub host: HostFrame,
}

impl DrawnBand {
    /// The time by which the work is balanced: that of the GPU, or of a frame in slabs with the waits for its pages.
    fn cost_ms(&self) -> f64 {
        self.frame.parts.map_or_else(|| self.frame.gpu_ms(), |parts| parts.wall_ms)
    }
}

impl SplitRenderer {
    /// A renderer of each device, all of the same scene and options.
    pub fn new(renderers: Vec<(&Device, Renderer)>) -> Self {
        let part = |(device, renderer): (&Device, Renderer)| Part {
            device: device.capabilities().name.clone(),
            queue: FrameQueue::new(device, renderer),
            host: HostFrame::default(),
            is_to_be_lost: false,
        };
        let parts: Vec<_> = renderers.into_iter().map(part).collect();
        Self { balance: Balance::new(parts.len()), parts, lost: Vec::new() }
    }

    /// The reason why the first device draws pictures of a camera as a whole; `None` if all devices draw bands.
    pub fn undividable(&mut self, camera: &Camera) -> Option<&'static str> {
        self.parts.first_mut().and_then(|part| part.queue.renderer().undividable(camera))
    }

    /// Draws a picture. Its pixels go to host memory in the forms of `outputs`. If a device is lost, the others draw
    /// the picture again.
    ///
    /// # Errors
    /// If memory runs out, or no device is left.
    pub fn render(&mut self, camera: &Camera, background: Background, outputs: &FrameOutputs) -> Result<SplitFrame> {
        let started = Instant::now();
        loop {
            ensure!(!self.parts.is_empty(), "a picture in bands needs a device");
            let unit = self.parts.iter_mut().map(|part| part.queue.renderer().band_rows(camera)).max().unwrap_or(1);
            let bands = match self.undividable(camera) {
                None => self.balance.bands(camera.size_px[1], unit),
                Some(_) => vec![Band::whole(camera.size_px)],
            };
            let mut drawn = draw(&mut self.parts, &bands, |part, band| {
                let whole = (bands.len() > 1).then_some(band);
                part.draw((camera, whole), background, outputs, started)
            })?;
            let Some(lost) = drawn.iter().position(Result::is_err) else {
                let bands = Vec::from_iter(drawn.into_iter().map_while(Result::ok));
                self.balance.learn(&Vec::from_iter(bands.iter().map(DrawnBand::cost_ms)));
                return Ok(SplitFrame { bands, latency: started.elapsed() });
            };
            // The error is given out if it is another one, or no other device is left.
            let Err(error) = drawn.swap_remove(lost) else { unreachable!("the place of an error") };
            if !error.is::<DeviceLost>() || self.parts.len() == 1 {
                return Err(error);
            }
            self.lost.push((self.parts.remove(lost).device, error));
            self.balance = Balance::new(self.parts.len());
        }
    }

    /// Gives back the host memory of a frame for the next one.
    pub fn recycle(&mut self, frame: SplitFrame) {
        for (part, band) in self.parts.iter_mut().zip(frame.bands) {
            part.host = band.host;
        }
    }

    /// The devices that were lost since the last call, each with the reason.
    pub fn take_lost(&mut self) -> Vec<(String, anyhow::Error)> {
        std::mem::take(&mut self.lost)
    }

    /// The number of devices that draw.
    pub fn devices(&self) -> usize {
        self.parts.len()
    }

    /// Loses a device in the next frame, for tests.
    #[doc(hidden)]
    pub fn lose(&mut self, device: usize) {
        self.parts[device].is_to_be_lost = true;
    }
}

impl Part {
    fn draw(
        &mut self,
        (camera, band): (&Camera, Option<Band>),
        background: Background,
        outputs: &FrameOutputs,
        started: Instant,
    ) -> Result<DrawnBand> {
        let host = std::mem::take(&mut self.host);
        let queued = self.queue.start_band((camera, band), background, outputs, host)?;
        if self.is_to_be_lost {
            return Err(DeviceLost("the GPU was lost: a test simulates it".to_owned()).into());
        }
        let Finished { mut frames, host } = self.queue.finish(queued)?;
        ensure!(!frames.is_empty(), "a frame without outputs has no band");
        let band = band.unwrap_or(Band::whole(camera.size_px));
        let (device, latency) = (self.device.clone(), started.elapsed());
        Ok(DrawnBand { device, band, frame: frames.swap_remove(0), latency, host })
    }
}

/// Draws all bands at the same time: the first on this thread.
fn draw(
    parts: &mut [Part],
    bands: &[Band],
    draw: impl Fn(&mut Part, Band) -> Result<DrawnBand> + Sync,
) -> Result<Vec<Result<DrawnBand>>> {
    let draw = &draw;
    let mut pairs = parts.iter_mut().zip(bands);
    let Some((first, band)) = pairs.next() else { return Ok(Vec::new()) };
    threads::scope(|threads| {
        let others: Vec<_> =
            pairs.map(|(part, band)| threads.spawn(move || draw(part, *band))).collect::<Result<_, _>>()?;
        let first = draw(first, *band);
        Ok(std::iter::once(first).chain(others.into_iter().map(joined)).collect())
    })
}
