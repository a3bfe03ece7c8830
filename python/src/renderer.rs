//! Renderers: a scene on a device, drawn from cameras.

use std::collections::{HashMap, VecDeque};
use std::sync::{LazyLock, Mutex, MutexGuard, OnceLock};

use anyhow::{Result, ensure};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use smalto::cli::environment::Environment;
use smalto::cli::with_memory;
use smalto::gpu::{Device, DeviceChoice, Validation};
use smalto::options::{KNOBS, Options};
use smalto::render::{self, Form, HostFrame, Stream, Streamed, Wanted, depths};
use smalto::rules::{Background, Order};

use crate::camera::Camera;
use crate::errors::{Error, exception};
use crate::picture::Picture;
use crate::scene::Scene;

/// Views on the GPU at a time: one is drawn while another is brought to the host.
const IN_FLIGHT: usize = 3;

/// Bytes of device memory that pages leave for pictures, as `smalto render` has it for pictures of 1080p.
const RESERVE: u64 = 256 << 20;

/// The devices that are open, by what they were asked for with. They stay open: opening one takes long.
static DEVICES: LazyLock<Mutex<HashMap<String, Device>>> = LazyLock::new(Mutex::default);

/// The process in which the first device was opened.
static PROCESS: OnceLock<u32> = OnceLock::new();

/// A process that was forked has neither the threads nor the device of its parent.
fn check_process() -> PyResult<()> {
    if *PROCESS.get_or_init(std::process::id) != std::process::id() {
        return Err(Error::new_err(
            "this process was forked from one that draws, and cannot draw: start processes with the method 'spawn' \
             (multiprocessing.set_start_method)",
        ));
    }
    Ok(())
}

fn open(name: Option<&str>) -> Result<Device> {
    let environment = Environment::read()?;
    let choice = name.map_or_else(|| environment.device.clone(), DeviceChoice::from);
    let mut devices = DEVICES.lock().expect("no holder of the devices panics");
    let key = format!("{choice:?}");
    if let Some(device) = devices.get(&key) {
        return Ok(device.clone());
    }
    let device = Device::open(&choice, environment.validation.unwrap_or(Validation::Off))?;
    let device = with_memory(device.with_shaders(environment.shaders.as_deref())?);
    devices.insert(key, device.clone());
    Ok(device)
}

/// The options of a preset with these knobs, and whether the near plane is among them.
fn options(preset: &str, knobs: Option<&Bound<PyDict>>, antialiased: bool) -> PyResult<(Options, bool)> {
    let names = || Options::PRESETS.map(|(name, _)| name).join(", ");
    let found = Options::preset(preset);
    let mut options = found.ok_or_else(|| PyValueError::new_err(format!("preset: expected {}", names())))?;
    options.rules.antialiased |= antialiased;
    let mut has_near = false;
    for (name, value) in knobs.into_iter().flat_map(|knobs| knobs.iter()) {
        let name: String = name.extract()?;
        let wanted = name.replace('_', "-");
        let knob = KNOBS.iter().find(|knob| knob.name == wanted).ok_or_else(|| {
            let all: Vec<String> = KNOBS.iter().map(|knob| knob.name.replace('-', "_")).collect();
            PyValueError::new_err(format!("there is no knob {name}; there are {}", all.join(", ")))
        })?;
        let text = value.str()?.to_string();
        let text = if text == "True" || text == "False" { text.to_lowercase() } else { text };
        let value = knob.parse(&text).map_err(|why| PyValueError::new_err(format!("{name}={text}: {why}")))?;
        options = knob.turned(&options, value);
        has_near |= wanted == "near";
    }
    Ok((options, has_near))
}

/// The background that a colour, or None for a transparent one, stands for.
fn ground(background: Option<[f32; 3]>) -> PyResult<Background> {
    match background {
        None => Ok(Background::Transparent),
        Some(colour) if colour.iter().all(|value| value.is_finite()) => Ok(Background::Colour(colour)),
        Some(_) => Err(PyValueError::new_err("background: expected three finite numbers, or None for transparent")),
    }
}

/// What is wanted of a view, from the names of its layers.
fn wanted(layers: Option<&[String]>) -> PyResult<Wanted> {
    let mut wanted = Wanted { picture: vec![Form::Floats], depths: false };
    for layer in layers.unwrap_or_default() {
        match layer.as_str() {
            "color" | "alpha" => {}
            "depth" => wanted.depths = true,
            _ => return Err(PyValueError::new_err(format!("layers: expected color, alpha or depth, found {layer}"))),
        }
    }
    Ok(wanted)
}

/// Draws pictures of one scene on one device, and keeps what it needs for the next one.
///
/// `preset` and any knob of `smalto render --help` set accuracy and speed, with _ in the place of -, like
/// Renderer(scene, preset="fast", sh_degree=1). `device` is the number of a Vulkan device in the list of `smalto doctor`
/// or a part of its name; by default SMALTO_DEVICE, or the fastest kind. With `certified`, every picture has a
/// certificate. Methods may be called from several threads; they draw one after another.
/// Errors: ValueError for an unknown preset or knob, DeviceError, MemoryError.
#[pyclass(module = "smalto", frozen)]
pub struct Renderer(Mutex<Inner>);

struct Inner {
    device: Device,
    stream: Stream,
    source: render::SceneSource,
    options: Options,
    has_near: bool,
    is_certified: bool,
    spare: Vec<HostFrame>,
}

#[pymethods]
impl Renderer {
    #[new]
    #[pyo3(signature = (scene, *, preset = "balanced", device = None, certified = false, **knobs))]
    fn new(
        py: Python,
        scene: &Scene,
        preset: &str,
        device: Option<String>,
        certified: bool,
        knobs: Option<&Bound<PyDict>>,
    ) -> PyResult<Self> {
        check_process()?;
        let (options, has_near) = options(preset, knobs, scene.is_antialiased)?;
        if let Some(why) = options.undrawable() {
            return Err(PyValueError::new_err(why));
        }
        let source = scene.source.clone();
        let made = py.detach(|| {
            let device = open(device.as_deref())?;
            let stream = stream(&device, &source, &options, certified)?;
            Ok(Inner { device, stream, source, options, has_near, is_certified: certified, spare: Vec::new() })
        });
        Ok(Self(Mutex::new(made.map_err(exception)?)))
    }

    /// Draws a picture. `background` is red, green, blue, or None for a transparent one. `layers` names what the picture
    /// is to have: color and alpha always, depth takes a second frame. Errors: ValueError, MemoryError, smalto.Error.
    #[pyo3(signature = (camera, *, background = Some([0.0; 3]), layers = None))]
    fn render(
        &self,
        py: Python,
        camera: &Camera,
        background: Option<[f32; 3]>,
        layers: Option<Vec<String>>,
    ) -> PyResult<Picture> {
        check_process()?;
        let (background, wanted) = (ground(background)?, wanted(layers.as_deref())?);
        let drawn = py.detach(|| {
            let mut inner = self.lock();
            let view = inner.start(camera, background, &wanted)?;
            inner.finish(view, background)
        });
        drawn.map_err(exception)
    }

    /// An iterator over the pictures of many cameras, in their order. The GPU draws the next ones while Python works on
    /// one. Arguments and errors are those of `render`.
    #[pyo3(signature = (cameras, *, background = Some([0.0; 3]), layers = None))]
    fn render_many(
        this: Py<Self>,
        cameras: &Bound<PyAny>,
        background: Option<[f32; 3]>,
        layers: Option<Vec<String>>,
    ) -> PyResult<Pictures> {
        check_process()?;
        let cameras = cameras.try_iter()?.into_any().unbind();
        let queue = Mutex::new(VecDeque::new());
        Ok(Pictures {
            renderer: this,
            cameras,
            background: ground(background)?,
            wanted: wanted(layers.as_deref())?,
            queue,
        })
    }

    /// Draws another scene from now on, with the same options: the next step of a training, say.
    fn update(&self, py: Python, scene: &Scene) -> PyResult<()> {
        check_process()?;
        let source = scene.source.clone();
        let updated = py.detach(|| {
            let mut inner = self.lock();
            inner.stream = stream(&inner.device, &source, &inner.options, inner.is_certified)?;
            inner.source = source;
            Ok(())
        });
        updated.map_err(exception)
    }

    /// The name of the Vulkan device.
    #[getter]
    fn device(&self) -> String {
        self.lock().device.capabilities().name.clone()
    }

    /// What the validation layer said, if SMALTO_VALIDATION=1 turned it on.
    #[getter]
    fn validation_messages(&self) -> Vec<String> {
        self.lock().device.validation_messages()
    }
}

impl Renderer {
    fn lock(&self) -> MutexGuard<'_, Inner> {
        // A panic leaves nothing half done that the next frame would use.
        self.0.lock().unwrap_or_else(std::sync::PoisonError::into_inner)
    }
}

fn stream(device: &Device, source: &render::SceneSource, options: &Options, is_certified: bool) -> Result<Stream> {
    let scene = source.bring(device, options, is_certified, RESERVE)?;
    let make = if is_certified { render::Renderer::certified } else { render::Renderer::new };
    Ok(Stream::new(device, make(device, options, &scene)?))
}

impl Inner {
    fn start(&mut self, camera: &Camera, background: Background, wanted: &Wanted) -> Result<Streamed> {
        let near = camera.near.filter(|near| !self.has_near && *near < self.options.rules.near);
        if let Some(near) = near {
            // What a small scene shows must not lie before the near plane.
            self.options.rules.near = near;
            self.stream = stream(&self.device, &self.source, &self.options, self.is_certified)?;
        }
        let host = self.spare.pop().unwrap_or_default();
        self.stream.start(&camera.camera, background, wanted, host)
    }

    fn finish(&mut self, view: Streamed, background: Background) -> Result<Picture> {
        let render::Finished { frames, mut host } = self.stream.finish(view)?;
        ensure!(!frames.is_empty(), "a frame was drawn");
        let certificate = self.stream.renderer().certificate()?;
        let pixels = host.picture().expect("floats are always wanted");
        let picture = Picture {
            pixels,
            is_transparent: background == Background::Transparent,
            depths: host.depths().map(|input| depths(&input)),
            certificate,
            timings: frames[0].timings.iter().map(|stage| (stage.name, stage.duration_ms)).collect(),
            visible: Some(frames[0].totals.visible),
        };
        self.spare.push(host);
        Ok(picture)
    }
}

/// The pictures of many cameras.
#[pyclass(module = "smalto", frozen)]
pub struct Pictures {
    renderer: Py<Renderer>,
    cameras: Py<PyAny>,
    background: Background,
    wanted: Wanted,
    queue: Mutex<VecDeque<Streamed>>,
}

#[pymethods]
impl Pictures {
    fn __iter__(this: Py<Self>) -> Py<Self> {
        this
    }

    fn __next__(&self, py: Python) -> PyResult<Option<Picture>> {
        check_process()?;
        let is_certified = self.renderer.get().lock().is_certified;
        // The certificate is that of the frame drawn last.
        let most = if is_certified { 1 } else { IN_FLIGHT };
        let mut next = Vec::new();
        let waiting = self.queue.lock().expect("no holder of the queue panics").len();
        while waiting + next.len() < most {
            match self.cameras.bind(py).clone().try_iter()?.next() {
                Some(camera) => next.push(camera?.extract::<Camera>()?),
                None => break,
            }
        }
        let drawn = py.detach(|| {
            let mut inner = self.renderer.get().lock();
            let mut queue = self.queue.lock().expect("no holder of the queue panics");
            for camera in &next {
                queue.push_back(inner.start(camera, self.background, &self.wanted)?);
            }
            queue.pop_front().map(|view| inner.finish(view, self.background)).transpose()
        });
        drawn.map_err(exception)
    }
}

/// The picture of the f64 reference on the CPU, by the rules of the preset and the knobs, exact. Takes seconds to
/// minutes. Arguments are those of `Renderer` and `render`. Errors: ValueError, also for scenes in page files.
#[pyfunction]
#[pyo3(signature = (scene, camera, *, preset = "balanced", background = Some([0.0; 3]), **knobs))]
pub fn reference(
    py: Python,
    scene: &Scene,
    camera: &Camera,
    preset: &str,
    background: Option<[f32; 3]>,
    knobs: Option<&Bound<PyDict>>,
) -> PyResult<Picture> {
    check_process()?;
    let (options, has_near) = options(preset, knobs, scene.is_antialiased)?;
    let (background, gaussians) = (ground(background)?, scene.gaussians("reference")?);
    let mut rules = options.untraded().rules;
    if let Some(near) = camera.near.filter(|_| !has_near) {
        rules.near = rules.near.min(near);
    }
    Ok(py.detach(|| {
        let rendering = smalto::reference::render(gaussians, &camera.camera, &rules, background);
        Picture {
            pixels: rendering.to_pixels(),
            is_transparent: background == Background::Transparent,
            depths: (rules.order != Order::PerPixel).then(|| rendering.depths()),
            certificate: None,
            timings: Vec::new(),
            visible: None,
        }
    }))
}
