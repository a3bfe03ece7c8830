//! What one device does in a run: it takes views, keeps some of them in flight, and hands their pixels on.

use std::collections::VecDeque;
use std::sync::OnceLock;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::{Duration, Instant};

use anyhow::{Result, ensure};
use crossbeam_channel::{Receiver, Sender, unbounded};

use super::Args;
use super::bands::Bands;
use super::buffer_pool::PooledFrame;
use super::encode::{Job, Source, Task};
use super::queue::Queue;
use crate::cli::environment::Environment;
use crate::cli::{Usage, dump, remark};
use crate::gpu::{Commands, Device, DeviceKind, DeviceLost};
use crate::options::Options;
use crate::pixels::Integers;
use crate::render::{
    Finished, Form, FrameOutputs, FrameQueue, HostFrame, Inspection, QueuedFrame, RayCertifier, Renderer, SceneSource,
    Upload,
};

/// Views that are submitted to a device and not waited for: one is drawn while the pixels of the one before are copied.
const IN_FLIGHT: usize = 3;

/// Host memory for the pixels of views on the way to their files, of all devices together. Each device has memory for
/// two views even if that is more.
const HOST_BYTES: u64 = 1 << 30;

/// A view with more bytes of pixels, or more than a buffer of the device holds, is read in parts after a wait, and not
/// kept in flight.
const LARGEST_STREAMED: u64 = 1 << 30;

/// The longest wait for host memory before the state of the run is looked at again.
const PATIENCE: Duration = Duration::from_secs(2);

/// The part of a run that all devices share.
pub(super) struct Run<'p> {
    pub args: &'p Args,
    pub options: Options,
    pub queue: Queue<Task<'p>>,
    /// What is drawn of views that are drawn band by band.
    pub bands: Bands,
    /// The number of devices that begin; the others draw what these cannot finish.
    pub drawers: usize,
    is_of_video: bool,
    /// When the first view was submitted.
    pub started: OnceLock<Instant>,
    /// Most views of one device between its memory and their files.
    host_frames: usize,
    /// Bytes of the pixels of the largest view on their way to files, and of its image.
    host_bytes: u64,
    image_bytes: u64,
    /// Views of all devices until one of these is lost, for tests.
    fault: Option<AtomicUsize>,
}

/// One device at work.
struct Worker<'r, 'p> {
    run: &'r Run<'p>,
    stream: FrameQueue,
    /// Makes the certificates against the response along rays.
    certifier: Option<RayCertifier>,
    in_flight: VecDeque<(Task<'p>, QueuedFrame)>,
    host: HostFrames,
    jobs: Sender<Job<'p>>,
    /// The most bytes of a view that is kept in flight.
    largest: u64,
}

/// Host memory for views, which comes back when their files are written.
struct HostFrames {
    made: usize,
    most: usize,
    idle: Vec<HostFrame>,
    is_of_video: bool,
    back: Receiver<HostFrame>,
    return_to: Sender<HostFrame>,
}

impl<'p> Run<'p> {
    /// `encoders` is the number of threads that encode, of all `devices` together.
    pub fn new(
        args: &'p Args,
        options: Options,
        tasks: Vec<Task<'p>>,
        (devices, drawers): (&[Device], usize),
        encoders: usize,
    ) -> Self {
        let largest = devices.iter().map(largest_streamed).min().unwrap_or(0);
        let bytes = tasks.iter().map(|task| task.host_bytes(args, largest)).max().unwrap_or(0);
        let pixels = |task: &Task| task.drawn_size().iter().map(|side| u64::from(*side)).product::<u64>();
        let image_bytes = 16 * tasks.iter().map(pixels).max().unwrap_or(0);
        let of_picture = |task: &Task| task.wanted(args).bytes(task.shot.camera.size_px);
        let picture_bytes = tasks.iter().map(of_picture).max().unwrap_or(0);
        let (devices, is_of_video) = (devices.len(), tasks.iter().any(|task| task.is_of_video));
        let fit = (HOST_BYTES / devices as u64 / bytes.max(1)) as usize;
        // The pixels of bands are copied to pictures at once. More memory would take longer to make than it saves.
        let are_bands = tasks.iter().all(|task| task.band.is_some());
        let on_their_way = if are_bands { IN_FLIGHT } else { encoders.div_ceil(devices) };
        let host_frames = fit.clamp(2, IN_FLIGHT + on_their_way);
        let fault = Environment::read().ok().and_then(|environment| environment.fault);
        let fault = fault.and_then(|fault| fault.strip_prefix("device@")?.parse().ok()).map(AtomicUsize::new);
        Self {
            args,
            options,
            queue: Queue::new(tasks),
            bands: Bands::new((HOST_BYTES / picture_bytes.max(1)).max(2) as usize),
            drawers,
            is_of_video,
            started: OnceLock::new(),
            host_frames,
            host_bytes: bytes,
            image_bytes,
            fault,
        }
    }

    /// Bytes of device memory for pictures: the image, a certificate, what is enlarged, and where the host has no
    /// memory of its own, the pictures on their way to files.
    fn reserve(&self, device: &Device) -> u64 {
        let is_discrete = device.capabilities().kind == DeviceKind::Discrete;
        let on_their_way = if is_discrete { 0 } else { self.host_frames as u64 * self.host_bytes };
        4 * self.image_bytes + on_their_way
    }

    /// Draws views on device `number` until none is left. A device that stands by waits for what one that fails gives
    /// back, and the scene is not uploaded to it before. If the device fails, it gives back what it had taken.
    pub fn draw_on(&self, (number, device): (usize, &Device), scene: SceneSource, jobs: Sender<Job<'p>>) -> Result<()> {
        if number >= self.drawers && !self.queue.waits_for_loss() {
            return Ok(());
        }
        let mut worker = Worker::new(self, (number, device), scene, jobs)?;
        let drawn = worker.draw();
        while let Some((task, _)) = worker.in_flight.pop_back() {
            self.queue.give_back(task);
        }
        drawn
    }
}

impl Task<'_> {
    fn wanted(&self, args: &Args) -> FrameOutputs {
        let mut picture = Vec::from_iter(self.is_of_video.then_some(Form::Integers(Integers::Rgb8)));
        for output in &self.picture {
            let form = output.integers(args.background).map_or(Form::Floats, Form::Integers);
            if !picture.contains(&form) {
                picture.push(form);
            }
        }
        FrameOutputs { picture, depths: !self.depths.is_empty(), is_exported: false }
    }

    /// Width and height of the rows that are drawn.
    fn drawn_size(&self) -> [u32; 2] {
        let size = self.shot.camera.size_px;
        self.band.map_or(size, |band| band.size(size))
    }

    /// The reason why it is not drawn band by band; `None` if it can be.
    pub fn whole_because(&self, args: &Args, options: &Options) -> Option<&'static str> {
        let camera = &self.shot.camera;
        let whole = Renderer::whole_because(options, camera);
        if whole.is_some() {
            whole
        } else if Renderer::is_along_rays(options, camera) {
            // Each band would need tables of its own, which take the host longer than the device saves.
            Some("pictures along rays are drawn as a whole")
        } else if args.certificate.is_some() || args.dump.is_some() || args.measure_levels.is_some() {
            Some("--certificate, --dump and --measure-levels draw whole pictures")
        } else if self.is_of_video {
            Some("frames of a video are drawn as a whole")
        } else {
            None
        }
    }

    /// True if it is drawn and waited for: if it has a certificate or a dump, its levels are measured, or it has more
    /// bytes than `largest`.
    fn is_alone(&self, args: &Args, largest: u64) -> bool {
        let bytes = self.wanted(args).bytes(self.drawn_size());
        let is_large = bytes > largest && self.band.is_none();
        args.certificate.is_some() || args.dump.is_some() || args.measure_levels.is_some() || is_large
    }

    /// Bytes of its pixels on their way to the files.
    fn host_bytes(&self, args: &Args, largest: u64) -> u64 {
        let size = self.drawn_size();
        if !self.is_alone(args, largest) {
            return self.wanted(args).bytes(size);
        }
        let is_drawn =
            [!self.picture.is_empty() || self.is_of_video, !self.depths.is_empty(), args.certificate.is_some()];
        let floats = FrameOutputs { picture: vec![Form::Floats], ..FrameOutputs::default() }.bytes(size);
        is_drawn.into_iter().filter(|is_drawn| *is_drawn).count() as u64 * floats
    }
}

/// The most bytes of a view that a device keeps in flight.
fn largest_streamed(device: &Device) -> u64 {
    LARGEST_STREAMED.min(device.capabilities().limits.storage_range)
}

impl<'r, 'p> Worker<'r, 'p> {
    fn new(
        run: &'r Run<'p>,
        (number, device): (usize, &Device),
        scene: SceneSource,
        jobs: Sender<Job<'p>>,
    ) -> Result<Self> {
        // The phases of the start are those of the first device.
        let start = (number == 0).then_some(&run.args.start);
        let certifies = run.args.certificate.is_some();
        let gpu_scene = scene.upload_with(
            device,
            &run.options,
            Upload { is_certifiable: certifies, reserve_bytes: run.reserve(device) },
        )?;
        if run.args.dump.is_some() && gpu_scene.is_paged() {
            let why =
                "--dump writes the buffers of a frame that is drawn at once, and this scene is drawn page by page";
            return Err(Usage(why.to_owned()).into());
        }
        // Returning the memory of a large scene takes the system long.
        rayon::spawn(move || drop(scene));
        start.inspect(|start| start.end("upload"));
        let certifies_rays = run.args.certify_rays;
        let create = if certifies && !certifies_rays { Renderer::certified } else { Renderer::new };
        let renderer = create(device, &run.options, &gpu_scene)?;
        let certifier = certifies_rays.then(|| RayCertifier::new(device, &run.options, &gpu_scene)).transpose()?;
        start.inspect(|start| start.end_with("pipelines", renderer.self_test_time().map(|time| ("trial", time))));
        if let Some(notice) = renderer.notice() {
            remark(&format!("note: {notice}"));
        }
        let (return_to, back) = unbounded();
        let host = HostFrames {
            made: 0,
            most: run.host_frames,
            idle: Vec::new(),
            is_of_video: run.is_of_video,
            back,
            return_to,
        };
        let largest = largest_streamed(device);
        let (stream, in_flight) = (FrameQueue::new(device, renderer), VecDeque::new());
        Ok(Self { run, stream, certifier, in_flight, host, jobs, largest })
    }

    fn draw(&mut self) -> Result<()> {
        while self.begin()? || self.end()? {}
        Ok(())
    }

    /// Takes a view and submits it. False if there is no room for another now, or no view is left.
    fn begin(&mut self) -> Result<bool> {
        let (queue, waits) = (&self.run.queue, self.in_flight.is_empty());
        if self.in_flight.len() == IN_FLIGHT || !self.run.bands.have_room(waits) {
            return Ok(false);
        }
        let Some(host) = self.host.take(waits, queue) else { return Ok(false) };
        let Some(task) = (if waits { queue.take() } else { queue.try_take() }) else {
            self.host.idle.push(host);
            return Ok(false);
        };
        self.run.started.get_or_init(Instant::now);
        let args = self.run.args;
        let begun = if task.is_alone(args, self.largest) {
            let unused = self.host.pooled(host);
            self.draw_alone(&task, unused).map(|job| self.hand_on(job))
        } else {
            let view = (&task.shot.camera, task.band);
            let begun = self.stream.start_band(view, args.background, &task.wanted(args), host);
            begun.map(|view| self.in_flight.push_back((task.clone(), view)))
        };
        begun.map(|()| true).inspect_err(|_| queue.give_back(task))
    }

    /// Waits for the view that was submitted first, and hands it on. False if none is in flight.
    fn end(&mut self) -> Result<bool> {
        let Some((task, view)) = self.in_flight.pop_front() else { return Ok(false) };
        let finished = self.check_fault().and_then(|()| self.stream.finish(view));
        let Finished { frames, host } = match finished {
            Ok(finished) => finished,
            Err(error) => {
                self.run.queue.give_back(task);
                return Err(error);
            }
        };
        let source = Source::Host(self.host.pooled(host));
        self.hand_on(Job { task, frames, source });
        Ok(true)
    }

    /// Counts the views of all devices, so that a device is lost even if the other one draws most views. After the loss
    /// the count wraps around.
    fn check_fault(&self) -> Result<()> {
        let left = self.run.fault.as_ref().map(|views| views.fetch_sub(1, Ordering::Relaxed));
        ensure!(left != Some(0), DeviceLost("the GPU was lost: SMALTO_FAULT simulates it".to_owned()));
        Ok(())
    }

    fn hand_on(&self, job: Job<'p>) {
        // Nobody takes jobs any more if the run was stopped.
        _ = self.jobs.send(job);
        self.run.queue.finish();
    }

    /// Draws a view and waits for it.
    fn draw_alone(&mut self, task: &Task<'p>, unused: PooledFrame) -> Result<Job<'p>> {
        while self.end()? {}
        let (args, shot, renderer) = (self.run.args, task.shot, self.stream.renderer());
        renderer.set_band(None);
        let prepare = |cmd: &mut Commands| {
            if args.dump.is_some() {
                cmd.capture_scopes();
            }
        };
        let mut frames = Vec::new();
        let [mut picture, mut certificate, mut depths] = [const { None }; 3];
        if !task.picture.is_empty() || task.is_of_video {
            let (frame, results) = renderer.render_with(&shot.camera, args.background, prepare)?;
            if let Some(folder) = &args.dump {
                dump::write(folder, results.captures())?;
            }
            let (mut frame, pixels) = (frame, renderer.pixels()?);
            if let (Some(detail), Some(measurement)) = (&mut frame.detail, args.measure_levels) {
                *detail = measurement.of(renderer, (&shot.camera, args.background), &pixels, *detail)?;
            }
            frames.push(frame);
            certificate = match &mut self.certifier {
                Some(certifier) => Some(certifier.certificate(&pixels, &shot.camera, args.background)?),
                None => renderer.certificate()?,
            };
            picture = Some(pixels);
        }
        if !task.depths.is_empty() {
            renderer.set_inspection(Inspection::of_depths())?;
            frames.push(renderer.render(&shot.camera, args.background)?);
            depths = Some(renderer.pixels()?);
            renderer.set_inspection(Inspection::default())?;
        }
        Ok(Job { task: task.clone(), frames, source: Source::Read { picture, depths, certificate, unused } })
    }
}

impl HostFrames {
    /// Memory for a view, if some is idle or more may be made. Otherwise waits for some to come back, or returns
    /// `None`.
    fn take<T>(&mut self, waits: bool, queue: &Queue<T>) -> Option<HostFrame> {
        if let Some(idle) = self.idle.pop().or_else(|| self.back.try_recv().ok()) {
            return Some(idle);
        }
        if self.made >= self.most {
            if !waits {
                return None;
            }
            loop {
                match self.back.recv_timeout(PATIENCE) {
                    Ok(idle) => return Some(idle),
                    // The frames of a video may wait for one that only this device can draw now: the other is lost.
                    Err(_) if self.is_of_video && queue.has_left() => break,
                    Err(_) if !queue.is_open() => return None,
                    Err(_) => {}
                }
            }
        }
        self.made += 1;
        Some(HostFrame::default())
    }

    /// Memory on its way through a job.
    fn pooled(&self, host: HostFrame) -> PooledFrame {
        PooledFrame { host, pool: self.return_to.clone() }
    }
}
