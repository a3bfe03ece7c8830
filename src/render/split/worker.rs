//! The thread of a device that draws bands, and the bands that it has drawn.

use std::sync::{Arc, Mutex, MutexGuard};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use anyhow::{Result, anyhow, ensure};
use crossbeam_channel::{Receiver, Sender, bounded};

use crate::camera::Camera;
use crate::gpu::{Device, DeviceLost};
use crate::render::band::Band;
use crate::render::frame_queue::{Finished, FrameOutputs, FrameQueue, HostFrame};
use crate::render::recorded::Frame;
use crate::render::renderer::Renderer;
use crate::rules::Background;
use crate::threads;

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
pub struct Worker {
    pub device: String,
    part: Arc<Mutex<Part>>,
    orders: Option<Sender<Order>>,
    drawn: Receiver<Result<DrawnBand>>,
    thread: Option<JoinHandle<()>>,
}

/// A device, and the memory for its bands.
pub struct Part {
    device: String,
    pub queue: FrameQueue,
    pub host: HostFrame,
    /// It is lost in the next frame, for tests.
    pub is_to_be_lost: bool,
}

/// A band that a device draws.
#[derive(Clone)]
pub struct Order {
    pub camera: Camera,
    /// None for the whole picture.
    pub band: Option<Band>,
    pub background: Background,
    pub outputs: FrameOutputs,
    pub started: Instant,
}

/// A band of a picture, and the work of its device.
pub struct DrawnBand {
    pub device: String,
    pub band: Band,
    /// The counts and the times of the frame of the band.
    pub frame: Frame,
    /// From the begin of the frame until the pixels of the band were in host memory.
    pub latency: Duration,
    /// The pixels of the band. A renderer uses their memory again if it is given back.
    pub host: HostFrame,
}

impl DrawnBand {
    /// Milliseconds by which the work is balanced: those of the GPU, or of a frame in slabs with the waits for its
    /// pages.
    pub fn cost_ms(&self) -> f64 {
        cost_ms(&self.frame)
    }
}

/// As [`DrawnBand::cost_ms`].
pub fn cost_ms(frame: &Frame) -> f64 {
    frame.parts.map_or_else(|| frame.gpu_ms(), |parts| parts.wall_ms)
}

/// Draws bands at the same time: the first one by `first` on this thread, and one by each worker.
pub fn draw_together<T>(
    workers: &[Worker],
    order: &Order,
    bands: &[Band],
    first: impl FnOnce() -> T,
) -> (T, Vec<Result<DrawnBand>>) {
    let at_work = || workers.iter().zip(bands);
    for (worker, band) in at_work() {
        if let Some(orders) = &worker.orders {
            // A thread that has ended is noticed below.
            _ = orders.send(order.of(*band));
        }
    }
    let first = first();
    let others = at_work().map(|(worker, _)| match worker.drawn.recv() {
        Ok(drawn) => drawn,
        Err(_) => Err(anyhow!("the thread of {} has ended", worker.device)),
    });
    (first, others.collect())
}

/// All bands; or the place of the first device that failed, and the reason.
pub fn all_drawn(drawn: Vec<Result<DrawnBand>>) -> Result<Vec<DrawnBand>, (usize, anyhow::Error)> {
    drawn.into_iter().enumerate().map(|(place, band)| band.map_err(|error| (place, error))).collect()
}

/// The bands of all workers may begin at multiples of this many rows.
pub fn band_rows(workers: &[Worker], camera: &Camera) -> u32 {
    workers.iter().map(|worker| worker.part().queue.renderer().band_rows(camera)).max().unwrap_or(1)
}

impl Order {
    /// The same picture, of which a band is drawn.
    pub fn of(&self, band: Band) -> Self {
        Self { band: Some(band), ..self.clone() }
    }
}

impl Worker {
    pub fn new((device, renderer): (&Device, Renderer)) -> Result<Self> {
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

    pub fn part(&self) -> MutexGuard<'_, Part> {
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
    pub fn draw(&mut self, Order { camera, band, background, outputs, started }: &Order) -> Result<DrawnBand> {
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
