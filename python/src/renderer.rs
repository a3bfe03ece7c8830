//! Renderers: a scene on a device, drawn from cameras.

use std::collections::{HashMap, VecDeque};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, LazyLock, Mutex};

use anyhow::{Context, Result, bail, ensure};
use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use rayon::prelude::*;
use smalto::cli::open_device;
use smalto::gpu::{Device, Feature};
use smalto::options::{Options, Storage};
use smalto::render;
use smalto::render::{
    Features, Finished, Frame, FrameOutputs, FrameQueue, GpuScene, HostFrame, QueuedFrame, SceneSource, Upload,
};
use smalto::rules::Background;

use crate::arrays::numbers;
use crate::asked::{Asked, exported, wanted};
use crate::camera::Camera;
use crate::device_memory::{Channels, DeviceArrays, Exported};
use crate::errors::{Error, exception};
use crate::given::{Ground, given, optional};
use crate::picture::{Content, Drawn, Picture, Spare, stage_times};
use crate::process::{check_process, interruptible, lock};
use crate::scene::Scene;

/// Views on the GPU at a time: one is drawn while another is brought to the host.
const IN_FLIGHT: usize = 3;

/// A device by its name, and a limit of its memory.
type Choice = (Option<String>, Option<u64>);

/// The devices that are open, by what they were asked for with. They stay open: opening one takes long.
static DEVICES: LazyLock<Mutex<HashMap<Choice, Device>>> = LazyLock::new(Mutex::default);

fn open(choice: Choice) -> Result<Device> {
    let mut devices = lock(&DEVICES);
    if let Some(device) = devices.get(&choice) {
        return Ok(device.clone());
    }
    let device = open_device(choice.0.clone(), choice.1)?;
    devices.insert(choice, device.clone());
    Ok(device)
}

/// The number of a device or a part of its name.
fn named_device(device: Option<&Bound<PyAny>>) -> PyResult<Option<String>> {
    match device.map(|device| device.extract::<u32>()) {
        Some(Ok(number)) => Ok(Some(number.to_string())),
        _ => optional(device, "device", "the number of a device, a part of its name, or None"),
    }
}

/// The UUID of a device, by which CUDA knows it, and whether pictures can stay there for CUDA.
#[pyfunction]
pub fn device_for_cuda(py: Python, device: Option<&Bound<PyAny>>) -> PyResult<(String, bool)> {
    check_process()?;
    let name = named_device(device)?;
    let device = py.detach(|| open((name, None))).map_err(exception)?;
    Ok(for_cuda(&device))
}

fn for_cuda(device: &Device) -> (String, bool) {
    let capabilities = device.capabilities();
    (capabilities.uuid.clone(), capabilities.has(Feature::ExportedMemory))
}

/// Draws pictures of one scene on one device, and keeps what it needs for the next one.
///
/// `preset` and any knob of `smalto render --help` set accuracy and speed, with _ in the place of -, like
/// Renderer(scene, preset="fast", sh_degree=1). `device` is the number of a Vulkan device in the list of `smalto
/// doctor` or a part of its name; by default SMALTO_DEVICE, or the fastest kind. `memory` is the most device memory to
/// take, in bytes: a scene that does not fit is drawn in parts, and the picture is the same. With `certified`, every
/// picture has a certificate. Methods may be called from several threads; they draw one after another. Errors:
/// ValueError for an unknown preset or knob, DeviceError, MemoryError.
#[pyclass(module = "smalto", frozen)]
pub struct Renderer {
    inner: Arc<Mutex<Inner>>,
    /// What is asked for while work holds the lock.
    device: Device,
    is_certified: bool,
    /// What `smalto._cuda` keeps for the next update.
    arrays: Mutex<Option<Py<PyAny>>>,
}

pub struct Inner {
    device: Device,
    asked: Asked,
    pub is_certified: bool,
    /// `None` if the Gaussians are on the device alone.
    pub source: Option<SceneSource>,
    pub is_antialiased: bool,
    /// Of a scene of features, the rows of its arrays that are Gaussians.
    pub rows: Option<Rows>,
    /// Made when they are needed and not there, as after an update that failed.
    pub scene: Option<GpuScene>,
    pub drawing: Option<Arc<Mutex<Drawing>>>,
    spare: Arc<Spare>,
}

/// Rows of arrays.
#[derive(Clone)]
pub enum Rows {
    All,
    Some(Arc<Vec<u32>>),
}

/// Draws with one near plane.
pub struct Drawing {
    near: f32,
    pub stream: FrameQueue,
}

/// A view on the GPU.
struct View {
    /// It may not be that of the next view any more.
    drawing: Arc<Mutex<Drawing>>,
    background: Background,
    streamed: QueuedFrame,
}

#[pymethods]
impl Renderer {
    #[new]
    #[pyo3(
        signature = (scene, *, preset = None, device = None, memory = None, certified = false, **knobs),
        text_signature = "(scene, *, preset='balanced', device=None, memory=None, certified=False, **knobs)"
    )]
    fn new(
        py: Python,
        scene: &Bound<PyAny>,
        preset: Option<&Bound<PyAny>>,
        device: Option<&Bound<PyAny>>,
        memory: Option<&Bound<PyAny>>,
        certified: bool,
        knobs: Option<&Bound<PyDict>>,
    ) -> PyResult<Self> {
        check_process()?;
        let scene: PyRef<Scene> = given(scene, "scene", "a Scene")?;
        let choice = (named_device(device)?, optional::<u64>(memory, "memory", "a number of bytes, or None")?);
        let asked = Asked::of(preset, knobs)?;
        let options = asked.options(scene.source.is_antialiased);
        if let Some(why) = options.undrawable().or(options.uncertifiable().filter(|_| certified)) {
            return Err(PyValueError::new_err(why));
        }
        let (source, rows) = (scene.source.clone(), scene.rows.clone());
        let made = interruptible(py, move |_| {
            let mut inner = Inner {
                device: open(choice)?,
                asked,
                is_certified: certified,
                is_antialiased: source.is_antialiased,
                source: Some(source),
                rows,
                scene: None,
                drawing: None,
                spare: Arc::default(),
            };
            inner.drawing(options.rules.near)?;
            anyhow::Ok(inner)
        })?;
        let inner = made.map_err(exception)?;
        let device = inner.device.clone();
        Ok(Self { inner: Arc::new(Mutex::new(inner)), device, is_certified: certified, arrays: Mutex::default() })
    }

    /// Draws a picture. `background` is red, green, blue, by default black, or None for a transparent one. `layers`
    /// names what the picture is to have: color and alpha always, depth takes a second frame. With the `dtype` "uint8",
    /// color and alpha are rounded to 8 bits on the GPU, which is faster to bring to the host. Errors: ValueError,
    /// MemoryError, smalto.Error.
    #[pyo3(
        signature = (camera, *, background = Ground::BLACK, layers = None, dtype = None),
        text_signature = "($self, camera, *, background=(0.0, 0.0, 0.0), layers=None, dtype='float32')"
    )]
    fn render(
        &self,
        py: Python,
        camera: &Bound<PyAny>,
        background: Ground,
        layers: Option<&Bound<PyAny>>,
        dtype: Option<&Bound<PyAny>>,
    ) -> PyResult<Picture> {
        check_process()?;
        let camera: Camera = given(camera, "camera", "a Camera")?;
        let background = background.background()?;
        let wanted = wanted(layers, dtype, background)?;
        let inner = self.inner.clone();
        let drawn = interruptible(py, move |_| {
            let mut inner = lock(&inner);
            let view = inner.start(&camera, background, &wanted)?;
            inner.finish(view)
        });
        drawn?.map_err(exception)
    }

    /// An iterator over the pictures of many cameras, in their order. The GPU draws the next ones while Python works on
    /// one. Arguments and errors are those of `render`. An exception of the iterator `cameras` is raised after the
    /// pictures of the cameras before it.
    #[pyo3(
        signature = (cameras, *, background = Ground::BLACK, layers = None, dtype = None),
        text_signature = "($self, cameras, *, background=(0.0, 0.0, 0.0), layers=None, dtype='float32')"
    )]
    fn render_many(
        this: Py<Self>,
        cameras: &Bound<PyAny>,
        background: Ground,
        layers: Option<&Bound<PyAny>>,
        dtype: Option<&Bound<PyAny>>,
    ) -> PyResult<Pictures> {
        check_process()?;
        let background = background.background()?;
        let wanted = wanted(layers, dtype, background)?;
        let wrong = |_| PyTypeError::new_err("cameras: expected an iterable of cameras");
        let cameras = cameras.try_iter().map_err(wrong)?.into_any().unbind();
        Ok(Pictures {
            renderer: this.get().inner.clone(),
            is_certified: this.get().is_certified,
            cameras,
            background,
            wanted,
            queue: Arc::default(),
            failed: Mutex::default(),
            is_interrupted: AtomicBool::new(false),
        })
    }

    /// The PSNR of the picture of a camera by levels of detail (`splats=`, `lod_error=`, `lod_psnr=` of a page file of
    /// `smalto lod`) against the picture of all Gaussians, and its standard error, both in dB. It is estimated from
    /// about `patches` squares of 64x64 pixels, or measured if there are not more that show the scene. (inf, 0.0) if no
    /// pixel of these differs. Errors: ValueError if the pictures have no levels.
    #[pyo3(
        signature = (camera, *, background = Ground::BLACK, patches = 64),
        text_signature = "($self, camera, *, background=(0.0, 0.0, 0.0), patches=64)"
    )]
    fn measure_levels(
        &self,
        py: Python,
        camera: &Bound<PyAny>,
        background: Ground,
        patches: u32,
    ) -> PyResult<(f64, f64)> {
        check_process()?;
        let camera: Camera = given(camera, "camera", "a Camera")?;
        let background = background.background()?;
        if patches < 2 {
            return Err(PyValueError::new_err("patches: expected 2 or more"));
        }
        let inner = self.inner.clone();
        let measured = interruptible(py, move |_| {
            let mut inner = lock(&inner);
            let near = inner.asked.near(&camera);
            if !inner.options().wants_levels() {
                return Ok(None);
            }
            let drawing = inner.drawing(near)?.clone();
            let sampled = lock(&drawing).stream.renderer().sample_psnr(&camera.camera, background, patches)?;
            anyhow::Ok(Some((sampled.psnr(), sampled.standard_error_db())))
        });
        let no_levels = "the pictures have no levels: draw a page file of `smalto lod` with splats=, lod_error= or \
                         lod_psnr=";
        measured?.map_err(exception)?.ok_or_else(|| PyValueError::new_err(no_levels))
    }

    /// Draws another scene from now on, with the same preset and knobs: the next step of a training, say. The memory of
    /// the old one is free before the new one is brought to the device.
    fn update(&self, py: Python, scene: &Bound<PyAny>) -> PyResult<()> {
        check_process()?;
        let scene: PyRef<Scene> = given(scene, "scene", "a Scene")?;
        self.update_to(py, &scene)
    }

    /// Draws the Gaussians of these arrays from now on, as `update(Scene.from_arrays(...))` does. Tensors on the CUDA
    /// device that draws do not leave it: that takes milliseconds for a million Gaussians. Memory of the device for a
    /// copy of the arrays is kept for the next update. Errors: those of `Scene.from_arrays`.
    #[pyo3(signature = (means, quats, scales, opacities, sh, *, antialiased = false))]
    fn update_arrays<'py>(
        this: &Bound<'py, Self>,
        means: &Bound<'py, PyAny>,
        quats: &Bound<'py, PyAny>,
        scales: &Bound<'py, PyAny>,
        opacities: &Bound<'py, PyAny>,
        sh: &Bound<'py, PyAny>,
        antialiased: bool,
    ) -> PyResult<()> {
        check_process()?;
        let py = this.py();
        let arrays = [means, quats, scales, opacities, sh];
        if means.hasattr("is_cuda")? {
            let update = py.import("smalto._cuda")?.getattr("update")?;
            if !update.call1((this, arrays.to_vec(), antialiased))?.is_none() {
                return Ok(());
            }
        }
        let scene = Scene::from_arrays(py, means, quats, scales, opacities, sh, antialiased)?;
        this.get().update_to(py, &scene)
    }

    /// Memory of the device for the arrays of `count` Gaussians.
    fn _device_arrays(&self, py: Python, count: usize, coefficients: usize) -> PyResult<DeviceArrays> {
        py.detach(|| DeviceArrays::new(&self.device, count, coefficients)).map_err(exception)
    }

    /// Draws the Gaussians of arrays that CUDA has written. Returns the reason if the host is needed.
    fn _take(&self, py: Python, arrays: &DeviceArrays, features: bool, antialiased: bool) -> PyResult<Option<String>> {
        let (inner, arrays) = (self.inner.clone(), arrays.0.clone());
        let taken = interruptible(py, move |_| {
            let mut inner = lock(&inner);
            let taken = inner.take(&mut lock(&arrays), features, antialiased);
            if taken.is_err() {
                inner.release();
            }
            taken
        });
        Ok(taken?.map_err(exception)?.map(|why| why.to_string()))
    }

    /// What `smalto._cuda` keeps for the next update.
    #[getter]
    fn _arrays(&self, py: Python) -> Option<Py<PyAny>> {
        lock(&self.arrays).as_ref().map(|arrays| arrays.clone_ref(py))
    }

    fn _keep_arrays(&self, arrays: Option<Py<PyAny>>) {
        // The destructor of what was kept before must not find the lock taken.
        let before = std::mem::replace(&mut *lock(&self.arrays), arrays);
        drop(before);
    }

    /// The UUID of the device, by which CUDA knows it, and whether it has memory that CUDA opens.
    fn _for_cuda(&self) -> (String, bool) {
        for_cuda(&self.device)
    }

    /// Brings up to three channels of features to the device, (N, D) for the N rows of the arrays of the scene.
    fn _bring(&self, py: Python, features: &Bound<PyAny>) -> PyResult<Channels> {
        check_process()?;
        let features = numbers::<f32>(features, "colors", "float32", &[None, None])?;
        let (channels, values) = (features.shape()[1], features.values());
        let brought = py.detach(|| {
            let mut inner = lock(&self.inner);
            let near = inner.near();
            inner.drawing(near)?;
            let (Some(scene), Some(rows)) = (&inner.scene, &inner.rows) else { bail!("the scene has no features") };
            let of_row = |row: usize| {
                let row = &values[row * channels..][..channels];
                std::array::from_fn(|channel| row.get(channel).copied().unwrap_or(0.0))
            };
            let gathered: Vec<[f32; 3]> = match rows {
                Rows::All => (0..scene.len()).into_par_iter().map(of_row).collect(),
                Rows::Some(rows) => rows.par_iter().map(|row| of_row(*row as usize)).collect(),
            };
            scene.upload_features(&inner.device, &gathered)
        });
        Ok(Channels(brought.map_err(exception)?))
    }

    /// Memory for up to three channels of features of `count` rows, which CUDA writes; None if the host has to bring
    /// them.
    fn _channels(&self, py: Python, count: usize) -> Option<Channels> {
        py.detach(|| {
            let inner = lock(&self.inner);
            let rows = match inner.rows.as_ref()? {
                Rows::All => inner.scene.as_ref()?.len(),
                Rows::Some(rows) => rows.len(),
            };
            // Rows that are no Gaussians have no place in the memory.
            let is_whole = rows == count && inner.scene.as_ref().is_some_and(|scene| !scene.is_paged());
            Features::exportable(&self.device, count).ok().filter(|_| is_whole).map(Channels)
        })
    }

    /// Draws these features from now on.
    fn _show(&self, py: Python, channels: &Channels) {
        py.detach(|| {
            let inner = &mut *lock(&self.inner);
            inner.scene = inner.scene.take().map(|scene| scene.with_features(&channels.0));
            if let Some(drawing) = &inner.drawing {
                lock(drawing).stream.renderer().show(&channels.0);
            }
        })
    }

    /// Draws pictures into memory that CUDA opens, one into each, without a pause between them. Returns the GPU times
    /// of each.
    fn _draw_exported<'py>(
        &self,
        py: Python<'py>,
        views: Vec<(Camera, Py<Exported>)>,
        has_depth: bool,
    ) -> PyResult<Vec<Bound<'py, PyDict>>> {
        check_process()?;
        let inner = self.inner.clone();
        let views: Vec<_> = views.into_iter().map(|(camera, into)| (camera, into.get().0.clone())).collect();
        let drawn = interruptible(py, move |_| {
            let mut inner = lock(&inner);
            let wanted = exported(has_depth);
            let mut started = Vec::new();
            for (camera, into) in &views {
                let host = std::mem::take(&mut *lock(into));
                started.push(inner.start_into(camera, Background::BLACK, &wanted, host)?);
            }
            let finished = started.into_iter().zip(&views).map(|(view, (_, into))| {
                let Finished { mut frames, host } = lock(&view.drawing).stream.finish(view.streamed)?;
                *lock(into) = host;
                ensure!(!frames.is_empty(), "a frame was drawn");
                Ok(timings(&frames.swap_remove(0)))
            });
            finished.collect::<Result<Vec<_>>>()
        });
        drawn?.map_err(exception)?.iter().map(|times| stage_times(py, times)).collect()
    }

    /// The name of the Vulkan device.
    #[getter]
    fn device(&self) -> String {
        self.device.capabilities().name.clone()
    }

    /// What the validation layer said, if SMALTO_VALIDATION=1 turned it on.
    #[getter]
    fn validation_messages(&self) -> Vec<String> {
        self.device.validation_messages()
    }
}

impl Renderer {
    /// Draws this scene from now on.
    fn update_to(&self, py: Python, scene: &Scene) -> PyResult<()> {
        let (inner, source, rows) = (self.inner.clone(), scene.source.clone(), scene.rows.clone());
        let updated = interruptible(py, move |_| {
            let mut inner = lock(&inner);
            let near = inner.release();
            let is_antialiased = source.is_antialiased;
            let before = (
                inner.source.replace(source),
                std::mem::replace(&mut inner.is_antialiased, is_antialiased),
                std::mem::replace(&mut inner.rows, rows),
            );
            let made = inner.drawing(near).map(|_| ());
            if made.is_err() {
                (inner.source, inner.is_antialiased, inner.rows) = before;
                inner.release();
            }
            made
        });
        updated?.map_err(exception)
    }
}

impl Inner {
    /// Frees the scene on the device. Returns the near plane of the last view.
    fn release(&mut self) -> f32 {
        let near = self.near();
        (self.scene, self.drawing) = (None, None);
        near
    }

    /// The near plane of the last view.
    pub fn near(&self) -> f32 {
        let last = self.drawing.as_ref().map(|drawing| lock(drawing).near);
        last.unwrap_or_else(|| self.options().rules.near)
    }

    pub fn options(&self) -> Options {
        self.options_of(self.is_antialiased, self.rows.is_some())
    }

    /// The options for a scene that was trained so, or of features.
    pub fn options_of(&self, is_antialiased: bool, has_features: bool) -> Options {
        let mut options = self.asked.options(is_antialiased);
        if has_features {
            options.rules.features = true;
            options.sh_storage = Storage::F32;
        }
        options
    }

    /// What draws the scene with this near plane.
    pub fn drawing(&mut self, near: f32) -> Result<&Arc<Mutex<Drawing>>> {
        if self.drawing.as_ref().is_none_or(|drawing| lock(drawing).near != near) {
            let mut options = self.options();
            options.rules.near = near;
            if self.scene.is_none() {
                let source = self.source.as_ref().context("an update failed, and the Gaussians before it are gone")?;
                self.scene = Some(source.upload_with(
                    &self.device,
                    &options,
                    Upload { is_certifiable: self.is_certified, ..Upload::default() },
                )?);
            }
            let scene = self.scene.as_ref().expect("it was brought");
            let make = if self.is_certified { render::Renderer::certified } else { render::Renderer::new };
            // The lists and pictures of the old one are free before the new one takes its own.
            self.drawing = None;
            let stream = FrameQueue::new(&self.device, make(&self.device, &options, scene)?);
            self.drawing = Some(Arc::new(Mutex::new(Drawing { near, stream })));
        }
        Ok(self.drawing.as_ref().expect("it was made"))
    }

    fn start(&mut self, camera: &Camera, background: Background, wanted: &FrameOutputs) -> Result<View> {
        let host = self.spare.take();
        self.start_into(camera, background, wanted, host)
    }

    fn start_into(
        &mut self,
        camera: &Camera,
        background: Background,
        wanted: &FrameOutputs,
        host: HostFrame,
    ) -> Result<View> {
        let near = self.asked.near(camera);
        let drawing = self.drawing(near)?.clone();
        let streamed = lock(&drawing).stream.start(&camera.camera, background, wanted, host)?;
        Ok(View { drawing, background, streamed })
    }

    fn finish(&self, view: View) -> Result<Picture> {
        let View { drawing, background, streamed } = view;
        let mut drawing = lock(&drawing);
        let Finished { frames, host } = drawing.stream.finish(streamed)?;
        ensure!(!frames.is_empty(), "a frame was drawn");
        Ok(Picture {
            content: Content::Drawn(Drawn::new(host, self.spare.clone())),
            is_transparent: background == Background::Transparent,
            certificate: drawing.stream.renderer().certificate()?,
            timings: timings(&frames[0]),
            visible: Some(frames[0].totals.visible),
        })
    }
}

/// The GPU time of each stage.
pub fn timings(frame: &Frame) -> Vec<(&'static str, f64)> {
    frame.timings.iter().map(|stage| (stage.name, stage.duration_ms)).collect()
}

/// The pictures of many cameras.
#[pyclass(module = "smalto", frozen)]
pub struct Pictures {
    renderer: Arc<Mutex<Inner>>,
    is_certified: bool,
    cameras: Py<PyAny>,
    background: Background,
    wanted: FrameOutputs,
    queue: Arc<Mutex<VecDeque<View>>>,
    /// The exception of the iterator of cameras, until the pictures before it are taken.
    failed: Mutex<Option<PyErr>>,
    /// Set by an interrupt, which loses a picture: the next one would be taken for it.
    is_interrupted: AtomicBool,
}

#[pymethods]
impl Pictures {
    fn __iter__(this: Py<Self>) -> Py<Self> {
        this
    }

    fn __next__(&self, py: Python) -> PyResult<Option<Picture>> {
        check_process()?;
        if self.is_interrupted.load(Ordering::Relaxed) {
            return Err(Error::new_err("the pictures were interrupted: draw the rest with another render_many"));
        }
        // The certificate is that of the frame drawn last.
        let most = if self.is_certified { 1 } else { IN_FLIGHT };
        let mut next = Vec::new();
        let waiting = lock(&self.queue).len();
        while waiting + next.len() < most && lock(&self.failed).is_none() {
            match self.next_camera(py) {
                Ok(Some(camera)) => next.push(camera),
                Ok(None) => break,
                Err(why) => *lock(&self.failed) = Some(why),
            }
        }
        let (renderer, queue) = (self.renderer.clone(), self.queue.clone());
        let (background, wanted) = (self.background, self.wanted.clone());
        let drawn = interruptible(py, move |_| {
            let mut inner = lock(&renderer);
            let mut queue = lock(&queue);
            for camera in &next {
                queue.push_back(inner.start(camera, background, &wanted)?);
            }
            queue.pop_front().map(|view| inner.finish(view)).transpose()
        });
        let drawn = drawn.inspect_err(|_| self.is_interrupted.store(true, Ordering::Relaxed));
        match drawn?.map_err(exception)? {
            None => lock(&self.failed).take().map_or(Ok(None), Err),
            picture => Ok(picture),
        }
    }
}

impl Pictures {
    fn next_camera(&self, py: Python) -> PyResult<Option<Camera>> {
        let next = self.cameras.bind(py).clone().try_iter()?.next().transpose()?;
        next.map(|camera| given(&camera, "cameras", "cameras")).transpose()
    }
}
