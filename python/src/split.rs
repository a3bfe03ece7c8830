//! Renderers of one picture on several devices.

use std::ffi::CString;
use std::sync::{Arc, Mutex};

use anyhow::Result;
use pyo3::exceptions::{PyTypeError, PyUserWarning, PyValueError};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyString};
use smalto::cli::open_devices;
use smalto::gpu::Device;
use smalto::options::Options;
use smalto::pixels::{Integers, Pixels};
use smalto::render::{DrawnBand, FrameOutputs, GpuScene, LostDevice, Renderer, SceneSource, Upload, depths};
use smalto::rules::Background;

use crate::asked::{Asked, wanted};
use crate::camera::Camera;
use crate::errors::exception;
use crate::given::{Ground, given, optional};
use crate::picture::{Content, Picture};
use crate::process::{check_process, interruptible, lock};
use crate::renderer::timings;
use crate::scene::Scene;

/// Draws each picture of one scene on several devices: each draws a band of rows, and the borders follow the times.
///
/// Pictures have the bytes of `Renderer` on a device of the same kind. That pays for scenes that take one device
/// several milliseconds; small pictures are drawn faster by one, and sets of pictures by one `Renderer` for each
/// device. `devices` is "all", or a list of numbers and parts of names, like [0, 1]. `memory` is the most memory to
/// take on each device, in bytes. Other arguments are those of `Renderer`. A device that is lost is left out with a
/// warning, and the others draw. Pictures below the scale 1, and those along rays of more than 29 megapixels, are drawn
/// by the first device. Errors: ValueError, DeviceError, MemoryError.
#[pyclass(module = "smalto", frozen)]
pub struct SplitRenderer(Arc<Mutex<Inner>>);

struct Inner {
    asked: Asked,
    is_antialiased: bool,
    parts: Vec<(Device, GpuScene)>,
    /// What draws with this near plane. It is made again for another one, or after an error.
    drawing: Option<(f32, smalto::render::SplitRenderer)>,
    bands: Vec<Drawn>,
}

/// What a device did for the last picture.
#[derive(Clone)]
struct Drawn {
    device: String,
    rows: [u32; 2],
    gpu_ms: f64,
    ms: f64,
}

#[pymethods]
impl SplitRenderer {
    #[new]
    #[pyo3(
        signature = (scene, devices = None, *, preset = None, memory = None, **knobs),
        text_signature = "(scene, devices='all', *, preset='balanced', memory=None, **knobs)"
    )]
    fn new(
        py: Python,
        scene: &Bound<PyAny>,
        devices: Option<&Bound<PyAny>>,
        preset: Option<&Bound<PyAny>>,
        memory: Option<&Bound<PyAny>>,
        knobs: Option<&Bound<PyDict>>,
    ) -> PyResult<Self> {
        check_process()?;
        let scene: PyRef<Scene> = given(scene, "scene", "a Scene")?;
        if scene.rows.is_some() {
            return Err(PyValueError::new_err("scene: features are drawn by one device"));
        }
        let (names, memory) = (names(devices)?, optional::<u64>(memory, "memory", "a number of bytes, or None")?);
        let asked = Asked::of(preset, knobs)?;
        let is_antialiased = scene.source.is_antialiased;
        let options = asked.options(is_antialiased);
        if let Some(why) = options.undrawable() {
            return Err(PyValueError::new_err(why));
        }
        let source = scene.source.clone();
        let made = interruptible(py, move |_| {
            let parts = parts(&open_devices(&names, memory)?, &source, &options)?;
            let mut inner = Inner { asked, is_antialiased, parts, drawing: None, bands: Vec::new() };
            inner.drawing(options.rules.near)?;
            anyhow::Ok(inner)
        })?;
        Ok(Self(Arc::new(Mutex::new(made.map_err(exception)?))))
    }

    /// Draws a picture. Arguments and errors are those of `Renderer.render`. The `timings` of the picture are sums over
    /// all bands.
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
        let inner = self.0.clone();
        let drawn = interruptible(py, move |_| lock(&inner).draw(&camera, background, &wanted))?;
        let (picture, lost) = drawn.map_err(exception)?;
        for LostDevice { name, error, .. } in lost {
            let message = CString::new(format!("{name} does not draw any more: {error:#}"))?;
            PyErr::warn(py, &py.get_type::<PyUserWarning>(), &message, 1)?;
        }
        Ok(picture)
    }

    /// What each device did for the last picture, from top to bottom: dictionaries of `device`, `top` (the first row),
    /// `rows`, `gpu_ms`, and `ms` until the pixels of the band were in host memory.
    #[getter]
    fn bands<'py>(&self, py: Python<'py>) -> PyResult<Vec<Bound<'py, PyDict>>> {
        let bands = py.detach(|| lock(&self.0).bands.clone());
        let reports = bands.into_iter().map(|Drawn { device, rows: [top, rows], gpu_ms, ms }| {
            let report = PyDict::new(py);
            report.set_item("device", device)?;
            report.set_item("top", top)?;
            report.set_item("rows", rows)?;
            report.set_item("gpu_ms", gpu_ms)?;
            report.set_item("ms", ms)?;
            Ok(report)
        });
        reports.collect()
    }

    /// The names of the devices that draw.
    #[getter]
    fn devices(&self, py: Python) -> Vec<String> {
        let name = |(device, _): &(Device, GpuScene)| device.capabilities().name.clone();
        py.detach(|| lock(&self.0).parts.iter().map(name).collect())
    }

    /// What the validation layer said, if SMALTO_VALIDATION=1 turned it on.
    #[getter]
    fn validation_messages(&self, py: Python) -> Vec<String> {
        py.detach(|| lock(&self.0).parts.iter().flat_map(|(device, _)| device.validation_messages()).collect())
    }
}

/// The numbers and names of devices; none for all.
fn names(devices: Option<&Bound<PyAny>>) -> PyResult<Vec<String>> {
    let Some(devices) = devices else { return Ok(Vec::new()) };
    let text = |name: &Bound<PyAny>| {
        let is_name = name.is_instance_of::<PyString>() || name.extract::<u32>().is_ok();
        let wrong = "devices: expected numbers of devices or parts of their names, like [0, 1], or \"all\"";
        if is_name { Ok(name.str()?.to_string()) } else { Err(PyTypeError::new_err(wrong)) }
    };
    let list = devices.try_iter().ok().filter(|_| !devices.is_instance_of::<PyString>());
    let names = match list {
        None => vec![text(devices)?],
        Some(list) => list.map(|name| text(&name?)).collect::<PyResult<_>>()?,
    };
    if names == ["all"] {
        return Ok(Vec::new());
    }
    if names.is_empty() { Err(PyValueError::new_err("devices: the list is empty")) } else { Ok(names) }
}

/// The scene on each device. Devices are filled one after another, as each takes all threads of the host.
fn parts(devices: &[Device], source: &SceneSource, options: &Options) -> Result<Vec<(Device, GpuScene)>> {
    let uploaded = devices.iter().map(|device| {
        let scene = source.upload_with(device, options, Upload::default())?;
        Ok((device.clone(), scene))
    });
    uploaded.collect()
}

impl Inner {
    /// What draws the scene with this near plane.
    fn drawing(&mut self, near: f32) -> Result<&mut smalto::render::SplitRenderer> {
        if self.drawing.as_ref().is_none_or(|(of, _)| *of != near) {
            let mut options = self.asked.options(self.is_antialiased);
            options.rules.near = near;
            // The lists and pictures of the old one are free before the new one takes its own.
            self.drawing = None;
            let renderers = self.parts.iter().map(|(device, scene)| {
                let renderer = Renderer::new(device, &options, scene)?;
                Ok((device, renderer))
            });
            let renderers = renderers.collect::<Result<Vec<_>>>()?;
            self.drawing = Some((near, smalto::render::SplitRenderer::new(&options, renderers)?));
        }
        Ok(&mut self.drawing.as_mut().expect("it was made").1)
    }

    /// Draws a picture. Returns the devices that were lost, too.
    fn draw(
        &mut self,
        camera: &Camera,
        background: Background,
        outputs: &FrameOutputs,
    ) -> Result<(Picture, Vec<LostDevice>)> {
        let drawing = self.drawing(self.asked.near(camera))?;
        let frame = drawing.render(&camera.camera, background, outputs);
        let lost = drawing.take_lost();
        lost.iter().for_each(|lost| drop(self.parts.remove(lost.place)));
        let mut frame = frame.inspect_err(|_| self.drawing = None)?;
        let content = joined(camera.camera.size_px, &mut frame.bands);
        self.bands = frame.bands.iter().map(Drawn::of).collect();
        let picture = Picture {
            content,
            is_transparent: background == Background::Transparent,
            certificate: None,
            timings: frame.bands.iter().flat_map(|band| timings(&band.frame)).collect(),
            // Gaussians at a border are in two bands.
            visible: <&[DrawnBand; 1]>::try_from(&*frame.bands).ok().map(|[whole]| whole.frame.totals.visible),
        };
        if let Some((_, drawing)) = &mut self.drawing {
            drawing.recycle(frame);
        }
        Ok((picture, lost))
    }
}

impl Drawn {
    fn of(band: &DrawnBand) -> Self {
        Self {
            device: band.device.clone(),
            rows: [band.band.top, band.band.rows],
            gpu_ms: band.frame.gpu_ms(),
            ms: 1e3 * band.latency.as_secs_f64(),
        }
    }
}

/// The picture of these bands.
fn joined(size: [u32; 2], bands: &mut [DrawnBand]) -> Content {
    let mut input = Pixels { size, rgba: Vec::new() };
    input.rgba.extend(bands.iter_mut().filter_map(|band| band.host.depths()).flat_map(|pixels| pixels.rgba));
    let depths = (!input.rgba.is_empty()).then(|| depths(&input));
    let mut integers = |kind| {
        let parts = bands.iter_mut().filter_map(|band| band.host.integers(kind).map(<[u8]>::to_vec));
        Vec::from_iter(parts.flatten())
    };
    let (rgb, grey) = (integers(Integers::Rgb8), integers(Integers::Grey8));
    if rgb.is_empty() {
        let rgba = bands.iter_mut().filter_map(|band| band.host.picture()).flat_map(|pixels| pixels.rgba).collect();
        Content::Computed(Pixels { size, rgba }, depths)
    } else {
        Content::Integers { size, rgb, grey, depths }
    }
}
