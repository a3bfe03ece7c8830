//! Pictures: their arrays, files and differences.

use std::path::PathBuf;
use std::sync::{Arc, Mutex};

use numpy::{PyArray1, PyArrayMethods};
use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyDict, PyTuple};
use smalto::camera;
use smalto::measure::metrics::Scored;
use smalto::pixels::{Alpha, Depths, Integers, Pixels};
use smalto::render::{HostFrame, depths};

use crate::arrays::numbers;
use crate::camera::Camera;
use crate::errors::exception;
use crate::process::{check_process, lock};

/// A picture: `color`, `alpha`, and what else was asked for. The arrays show its memory without a copy, so they cannot
/// be written to; `numpy.copy` makes one that can.
#[pyclass(module = "smalto", frozen)]
pub struct Picture {
    pub content: Content,
    pub is_transparent: bool,
    pub certificate: Option<Pixels>,
    /// GPU time of each stage.
    pub timings: Vec<(&'static str, f64)>,
    /// The number of Gaussians in view, if the GPU counted them.
    pub visible: Option<u32>,
}

/// The pixels of a picture.
pub enum Content {
    /// Floats in memory of their own, and the depths if the picture has them: a reference, or a picture of bands.
    Computed(Pixels, Option<Depths>),
    /// Integers of 8 bits in memory of their own: a picture of bands.
    Integers {
        size: [u32; 2],
        rgb: Vec<u8>,
        grey: Vec<u8>,
        depths: Option<Depths>,
    },
    Drawn(Drawn),
}

/// Pixels in the memory that the GPU brought them to. When they are gone, later pictures use it again.
pub struct Drawn {
    host: Mutex<HostFrame>,
    spare: Arc<Spare>,
}

/// Host memory that no picture uses.
#[derive(Default)]
pub struct Spare(Mutex<Vec<HostFrame>>);

impl Spare {
    /// The most frames that are kept: those of one picture in use and the next ones.
    const MOST: usize = 4;

    pub fn take(&self) -> HostFrame {
        lock(&self.0).pop().unwrap_or_default()
    }
}

impl Drawn {
    pub fn new(host: HostFrame, spare: Arc<Spare>) -> Self {
        Self { host: Mutex::new(host), spare }
    }

    fn with<T>(&self, read: impl FnOnce(&mut HostFrame) -> T) -> T {
        read(&mut lock(&self.host))
    }
}

impl Drop for Drawn {
    fn drop(&mut self) {
        let mut spare = lock(&self.spare.0);
        if spare.len() < Spare::MOST {
            spare.push(std::mem::take(&mut *lock(&self.host)));
        }
    }
}

impl Content {
    fn size(&self) -> [u32; 2] {
        match self {
            Self::Computed(pixels, _) => pixels.size,
            Self::Integers { size, .. } => *size,
            Self::Drawn(drawn) => drawn.with(|host| host.size()),
        }
    }

    /// Where the floats of the pixels are, four a pixel; `None` if they are integers.
    fn floats(&self) -> Option<usize> {
        match self {
            Self::Computed(pixels, _) => Some(pixels.rgba.as_ptr() as usize),
            Self::Integers { .. } => None,
            Self::Drawn(drawn) => drawn.with(|host| host.floats().map(|floats| floats.as_ptr() as usize)),
        }
    }

    /// Where the integers of the pixels are; `None` if they are floats.
    fn integers(&self, integers: Integers) -> Option<usize> {
        match self {
            Self::Computed(..) => None,
            Self::Integers { rgb, grey, .. } => match integers {
                Integers::Rgb8 => Some(rgb.as_ptr() as usize),
                Integers::Grey8 => Some(grey.as_ptr() as usize),
                Integers::Rgb16 | Integers::Grey16 => None,
            },
            Self::Drawn(drawn) => drawn.with(|host| host.integers(integers).map(|bytes| bytes.as_ptr() as usize)),
        }
    }

    /// Red, green and blue in 8 bits.
    fn bytes(&self) -> Vec<u8> {
        match self {
            Self::Computed(pixels, _) => pixels.to_rgb8(),
            Self::Integers { rgb, .. } => rgb.clone(),
            Self::Drawn(drawn) => drawn.with(|host| match host.integers(Integers::Rgb8) {
                Some(bytes) => bytes.to_vec(),
                None => host.picture().expect("a picture is of floats or integers").to_rgb8(),
            }),
        }
    }

    /// A copy of the pixels in floats.
    pub fn pixels(&self) -> Pixels {
        match self {
            Self::Computed(pixels, _) => pixels.clone(),
            Self::Integers { size, rgb, .. } => opaque(*size, rgb),
            Self::Drawn(drawn) => drawn.with(|host| match host.picture() {
                Some(pixels) => pixels,
                None => opaque(host.size(), host.integers(Integers::Rgb8).expect("a picture is of floats or integers")),
            }),
        }
    }
}

/// Red, green and blue in 8 bits as floats.
fn opaque(size: [u32; 2], rgb: &[u8]) -> Pixels {
    let rgba = rgb.chunks_exact(3).map(|p| [p[0], p[1], p[2], 255].map(|v| f32::from(v) / 255.0)).collect();
    Pixels { size, rgba }
}

/// Memory of a picture as NumPy reads it.
#[pyclass(frozen)]
struct Memory {
    /// It is not freed while the array is there.
    _owner: Py<Picture>,
    address: usize,
    shape: Vec<usize>,
    strides: Vec<usize>,
    kind: &'static str,
}

#[pymethods]
impl Memory {
    #[getter]
    fn __array_interface__<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let interface = PyDict::new(py);
        interface.set_item("version", 3)?;
        interface.set_item("typestr", self.kind)?;
        interface.set_item("shape", PyTuple::new(py, &self.shape)?)?;
        interface.set_item("strides", PyTuple::new(py, &self.strides)?)?;
        let is_read_only = true;
        interface.set_item("data", (self.address, is_read_only))?;
        Ok(interface)
    }
}

impl Picture {
    /// So many channels of each pixel, from `first` on of the floats, or all of these integers.
    fn channels<'py>(
        this: &Bound<'py, Self>,
        integers: Integers,
        [first, channels]: [usize; 2],
    ) -> PyResult<Bound<'py, PyAny>> {
        let content = &this.get().content;
        match (content.floats(), content.integers(integers)) {
            (Some(floats), _) => Self::plane(this, floats, FLOAT, [first, channels, 4]),
            (None, Some(bytes)) => Self::plane(this, bytes, BYTE, [0, channels, channels]),
            (None, None) => Err(PyValueError::new_err("this picture has no pixels")),
        }
    }

    /// An array of some channels of each pixel, without an axis for a single one: all from `channel` on.
    fn plane<'py>(
        this: &Bound<'py, Self>,
        address: usize,
        kind: &'static str,
        [channel, channels, of]: [usize; 3],
    ) -> PyResult<Bound<'py, PyAny>> {
        let [width, height] = this.get().content.size().map(|side| side as usize);
        let bytes = if kind == FLOAT { 4 } else { 1 };
        let (mut shape, mut strides) = (vec![height, width], vec![width * of * bytes, of * bytes]);
        if channels > 1 {
            shape.push(channels);
            strides.push(bytes);
        }
        let owner = this.clone().unbind();
        let memory = Memory { _owner: owner, address: address + channel * bytes, shape, strides, kind };
        this.py().import("numpy")?.call_method1("asarray", (memory,))
    }
}

/// Floats and bytes as NumPy names them.
const FLOAT: &str = if cfg!(target_endian = "little") { "<f4" } else { ">f4" };
const BYTE: &str = "|u1";

#[pymethods]
impl Picture {
    /// Red, green and blue as displayed, (height, width, 3) in float32, or in uint8 if it was drawn so; without a
    /// background, premultiplied by alpha.
    #[getter]
    fn color<'py>(this: &Bound<'py, Self>) -> PyResult<Bound<'py, PyAny>> {
        Self::channels(this, Integers::Rgb8, [0, 3])
    }

    /// Red, green and blue in 8 bits, (height, width, 3) in uint8, as in the PNG that `smalto render` writes: a copy.
    #[getter]
    fn color8<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let values = py.detach(|| self.content.bytes());
        image(py, values, self.content.size(), &[3])
    }

    /// The coverage of each pixel, (height, width), from 0 to 1 in float32, or to 255 in uint8 if it was drawn so.
    #[getter]
    fn alpha<'py>(this: &Bound<'py, Self>) -> PyResult<Bound<'py, PyAny>> {
        Self::channels(this, Integers::Grey8, [3, 1])
    }

    /// The mean view z of what is blended at each pixel, in world units, (height, width) in float32; NaN where there is
    /// nothing. Errors: ValueError if the picture was drawn without depth.
    #[getter]
    fn depth<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let expected = py.detach(|| match &self.content {
            Content::Computed(_, depths) | Content::Integers { depths, .. } => {
                depths.as_ref().map(|depths| depths.expected.clone())
            }
            Content::Drawn(drawn) => drawn.with(HostFrame::depths).map(|input| depths(&input).expected),
        });
        let expected = expected.ok_or_else(|| {
            PyValueError::new_err("this picture has no depth: draw it with layers=(\"color\", \"alpha\", \"depth\")")
        })?;
        image(py, expected.values, expected.size, &[])
    }

    /// For each channel of each pixel, a bound on what was left out, (height, width, 4) in float32; None if the
    /// renderer makes no certificates.
    #[getter]
    fn certificate<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyAny>>> {
        let bounds = self.certificate.as_ref();
        bounds.map(|bounds| image(py, bounds.rgba.as_flattened().to_vec(), bounds.size, &[4])).transpose()
    }

    /// GPU times in milliseconds by the name of the stage; "frame" is the whole frame. Empty for a reference.
    #[getter]
    fn timings<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        stage_times(py, &self.timings)
    }

    /// The number of Gaussians in view; None for a reference and for a picture of several bands.
    #[getter]
    fn visible(&self) -> Option<u32> {
        self.visible
    }

    /// Writes the picture as .png or .exr, as `smalto render` does. Errors: smalto.Error if it cannot be written.
    fn save(&self, py: Python, path: PathBuf) -> PyResult<()> {
        py.detach(|| self.content.pixels().write(&path, Alpha::of(self.is_transparent))).map_err(exception)
    }

    /// Width and height in pixels.
    #[getter]
    fn size(&self) -> (u32, u32) {
        self.content.size().into()
    }

    fn __repr__(&self) -> String {
        let [width, height] = self.content.size();
        format!("Picture({width}x{height})")
    }

    /// The picture as PNG, which notebooks show.
    fn _repr_png_<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyBytes>> {
        let png = py.detach(|| self.content.pixels().to_png(Alpha::of(self.is_transparent))).map_err(exception)?;
        Ok(PyBytes::new(py, &png))
    }
}

/// Times by the name of the stage; stages of one name are added.
pub fn stage_times<'py>(py: Python<'py>, timings: &[(&'static str, f64)]) -> PyResult<Bound<'py, PyDict>> {
    let times = PyDict::new(py);
    for (name, ms) in timings {
        let before: f64 = times.get_item(name)?.map_or(Ok(0.0), |ms| ms.extract())?;
        times.set_item(name, before + ms)?;
    }
    Ok(times)
}

/// An array of (height, width) and further axes.
fn image<'py, T: numpy::Element>(
    py: Python<'py>,
    values: Vec<T>,
    [width, height]: [u32; 2],
    rest: &[usize],
) -> PyResult<Bound<'py, PyAny>> {
    let shape: Vec<usize> = [height as usize, width as usize].into_iter().chain(rest.iter().copied()).collect();
    Ok(PyArray1::from_vec(py, values).reshape(shape)?.into_any())
}

/// The difference of two pictures or arrays (height, width, 3), of floats where 1 is white, or of uint8: a dictionary
/// with max_error, mse, psnr_db (None if they are equal), ssim, flip and more, as `smalto compare --json` reports them.
/// With `camera`, pixels without a ray through its lens do not count. Errors: ValueError if the sizes differ.
#[pyfunction]
#[pyo3(signature = (a, b, *, camera = None))]
pub fn compare<'py>(
    py: Python<'py>,
    a: &Bound<'py, PyAny>,
    b: &Bound<'py, PyAny>,
    camera: Option<&Camera>,
) -> PyResult<Bound<'py, PyAny>> {
    check_process()?;
    let (a, b) = (pixels(a, "a")?, pixels(b, "b")?);
    if a.size != b.size {
        let [[w, h], [x, y]] = [a.size, b.size];
        return Err(PyValueError::new_err(format!("the pictures differ in size: {w}x{h} and {x}x{y}")));
    }
    let camera = camera.map(|of| of.camera.sampled(a.size));
    let difference = py.detach(|| {
        let seen = camera.as_ref().and_then(camera::Camera::seen);
        serde_json::to_string(&Scored::new(&a, &b, seen).difference())
    });
    let text = difference.map_err(|why| PyValueError::new_err(why.to_string()))?;
    py.import("json")?.call_method1("loads", (text,))
}

fn pixels(value: &Bound<PyAny>, name: &str) -> PyResult<Pixels> {
    if let Ok(picture) = value.cast::<Picture>() {
        return Ok(picture.get().content.pixels());
    }
    let values = numbers::<f32>(value, name, "float32", &[None, None, Some(3)])?;
    let white = match values.dtype.as_str() {
        "uint8" => 255.0,
        kind if kind.starts_with("float") => 1.0,
        other => return Err(PyTypeError::new_err(format!("{name}: expected floats or uint8, found {other}"))),
    };
    let rgba = values.values().chunks_exact(3).map(|p| [p[0] / white, p[1] / white, p[2] / white, 1.0]).collect();
    Ok(Pixels { size: [values.shape()[1] as u32, values.shape()[0] as u32], rgba })
}
