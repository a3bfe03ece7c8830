//! Draws the bands of a frame on several devices at the same time.

use std::sync::{Arc, Mutex, MutexGuard};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use anyhow::{Result, anyhow, ensure};
use crossbeam_channel::{Receiver, Sender, bounded};

use super::balance::Balance;
use crate::camera::Camera;
use crate::gpu::{Device, DeviceLost};
use crate::options::Options;
use crate::render::band::Band;
use crate::render::frame_queue::{Finished, FrameOutputs, FrameQueue, HostFrame};
use crate::render::recorded::Frame;
use crate::render::renderer::Renderer;
use crate::rules::Background;
use crate::threads;

/// Draws pictures of one scene on several devices, a band on each.
pub struct SplitRenderer {
    workers: Vec<Worker>,
    options: Options,
    balance: Balance,
    /// Devices that were lost since the last call of [`SplitRenderer::take_lost`].
    lost: Vec<LostDevice>,
}

/// A device that does not draw any more.
pub struct LostDevice {
    /// Its place among the devices that drew until then, from 0 on.
    pub place: usize,
    pub name: String,
    /// The reason.
    pub error: anyhow::Error,
}

/// A device and its thread, which waits for bands to draw. A new thread for each frame would take a tenth of a
/// millisecond.
struct Worker {
    device: String,
    part: Arc<Mutex<Part>>,
    orders: Option<Sender<Order>>,
    drawn: Receiver<Result<DrawnBand>>,
    thread: Option<JoinHandle<()>>,
}

/// A device, and the memory for its bands.
struct Part {
    device: String,
    queue: FrameQueue,
    host: HostFrame,
    /// It is lost in the next frame, for tests.
    is_to_be_lost: bool,
}

/// A band that a device draws.
#[derive(Clone)]
struct Order {
    camera: Camera,
    /// None for the whole picture.
    band: Option<Band>,
    background: Background,
    outputs: FrameOutputs,
    started: Instant,
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
            let mut drawn = self.draw(&order, &bands);
            let Some(lost) = drawn.iter().position(Result::is_err) else {
                let bands = Vec::from_iter(drawn.into_iter().map_while(Result::ok));
                self.balance.learn(&Vec::from_iter(bands.iter().map(DrawnBand::cost_ms)));
                return Ok(SplitFrame { bands, latency: started.elapsed() });
            };
            let Err(error) = drawn.swap_remove(lost) else { unreachable!("the place of an error") };
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
        let units = self.workers.iter().map(|worker| worker.part().queue.renderer().band_rows(camera));
        self.balance.bands(camera.size_px[1], units.max().unwrap_or(1))
    }

    /// Draws all bands at the same time: the first on this thread.
    fn draw(&self, order: &Order, bands: &[Band]) -> Vec<Result<DrawnBand>> {
        let order = |band| Order { band: (bands.len() > 1).then_some(band), ..order.clone() };
        let at_work = Vec::from_iter(self.workers.iter().zip(bands));
        for (worker, band) in &at_work[1..] {
            if let Some(orders) = &worker.orders {
                // A thread that has ended is noticed below.
                _ = orders.send(order(**band));
            }
        }
        let first = at_work[0].0.part().draw(&order(bands[0]));
        let others = at_work[1..].iter().map(|(worker, _)| match worker.drawn.recv() {
            Ok(drawn) => drawn,
            Err(_) => Err(anyhow!("the thread of {} has ended", worker.device)),
        });
        std::iter::once(first).chain(others).collect()
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

impl Worker {
    fn new((device, renderer): (&Device, Renderer)) -> Result<Self> {
        let device_name = device.capabilities().name.clone();
        let part = Part {
            device: device_name.clone(),
            queue: FrameQueue::new(device, renderer),
            host: HostFrame::default(),
            is_to_be_lost: false,
        };
        let part = Arc::new(Mutex::new(part));
        let (orders, to_draw) = bounded::<Order>(1);
        let (done, drawn) = bounded(1);
        let own = part.clone();
        let work = move || {
            for order in to_draw {
                // Nobody takes the band if the renderer was dropped.
                _ = done.send(locked(&own).draw(&order));
            }
        };
        let thread = Some(threads::spawn(work)?);
        Ok(Self { device: device_name, part, orders: Some(orders), drawn, thread })
    }

    fn part(&self) -> MutexGuard<'_, Part> {
        locked(&self.part)
    }
}

impl Drop for Worker {
    fn drop(&mut self) {
        // The thread ends without orders. Its device must not be in use when that is dropped.
        self.orders = None;
        _ = self.thread.take().map(JoinHandle::join);
    }
}

fn locked(part: &Mutex<Part>) -> MutexGuard<'_, Part> {
    part.lock().expect("no thread that draws a band panics")
}

impl Part {
    fn draw(&mut self, Order { camera, band, background, outputs, started }: &Order) -> Result<DrawnBand> {
        let host = std::mem::take(&mut self.host);
        let queued = self.queue.start_band((camera, *band), *background, outputs, host)?;
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
