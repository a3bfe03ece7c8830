//! Pictures: their arrays, files and differences.

use std::path::PathBuf;

use numpy::{PyArray1, PyArrayMethods};
use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use smalto::measure::metrics::Difference;
use smalto::pixels::{Depths, Pixels};

use crate::arrays::numbers;
use crate::errors::exception;

/// A picture: `color`, `alpha`, and what else was asked for.
#[pyclass(module = "smalto", frozen)]
pub struct Picture {
    pub pixels: Pixels,
    pub is_transparent: bool,
    pub depths: Option<Depths>,
    pub certificate: Option<Pixels>,
    /// GPU time of each stage.
    pub timings: Vec<(&'static str, f64)>,
    /// The number of Gaussians in view, if the GPU counted them.
    pub visible: Option<u32>,
}

#[pymethods]
impl Picture {
    /// Red, green and blue as displayed, (height, width, 3) in float32; without a background, premultiplied by alpha.
    #[getter]
    fn color<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let values = py.detach(|| self.pixels.rgba.iter().flat_map(|p| [p[0], p[1], p[2]]).collect::<Vec<f32>>());
        image(py, values, self.pixels.size, &[3])
    }

    /// Red, green and blue in 8 bits, (height, width, 3) in uint8, as in the PNG that `smalto render` writes.
    #[getter]
    fn color8<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let values = py.detach(|| self.pixels.to_rgb8());
        image(py, values, self.pixels.size, &[3])
    }

    /// The coverage of each pixel from 0 to 1, (height, width) in float32.
    #[getter]
    fn alpha<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        image(py, self.pixels.alpha().values, self.pixels.size, &[])
    }

    /// The mean view z of what is blended at each pixel, in world units, (height, width) in float32; NaN where there is
    /// nothing. Errors: ValueError if the picture was drawn without depth.
    #[getter]
    fn depth<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let depths = self.depths.as_ref().ok_or_else(|| {
            PyValueError::new_err("this picture has no depth: draw it with layers=(\"color\", \"alpha\", \"depth\")")
        })?;
        image(py, depths.expected.values.clone(), depths.expected.size, &[])
    }

    /// For each channel of each pixel, a bound on what was left out, (height, width, 4) in float32; None if the renderer
    /// makes no certificates.
    #[getter]
    fn certificate<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyAny>>> {
        let bounds = self.certificate.as_ref();
        bounds.map(|bounds| image(py, bounds.rgba.as_flattened().to_vec(), bounds.size, &[4])).transpose()
    }

    /// GPU times in milliseconds by the name of the stage; "frame" is the whole frame. Empty for a reference.
    #[getter]
    fn timings<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let times = PyDict::new(py);
        for (name, ms) in &self.timings {
            let before: f64 = times.get_item(name)?.map_or(Ok(0.0), |ms| ms.extract())?;
            times.set_item(name, before + ms)?;
        }
        Ok(times)
    }

    /// The number of Gaussians in view; None for a reference.
    #[getter]
    fn visible(&self) -> Option<u32> {
        self.visible
    }

    /// Writes the picture as .png or .exr, as `smalto render` does. Errors: smalto.Error if it cannot be written.
    fn save(&self, py: Python, path: PathBuf) -> PyResult<()> {
        py.detach(|| self.pixels.write(&path, self.is_transparent)).map_err(exception)
    }

    /// Width and height in pixels.
    #[getter]
    fn size(&self) -> (u32, u32) {
        self.pixels.size.into()
    }

    fn __repr__(&self) -> String {
        let [width, height] = self.pixels.size;
        format!("Picture({width}x{height})")
    }
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
/// Errors: ValueError if the sizes differ.
#[pyfunction]
pub fn compare<'py>(py: Python<'py>, a: &Bound<'py, PyAny>, b: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyAny>> {
    let (a, b) = (pixels(a, "a")?, pixels(b, "b")?);
    if a.size != b.size {
        let [[w, h], [x, y]] = [a.size, b.size];
        return Err(PyValueError::new_err(format!("the pictures differ in size: {w}x{h} and {x}x{y}")));
    }
    let difference = py.detach(|| serde_json::to_string(&Difference::between(&a, &b)));
    let text = difference.map_err(|why| PyValueError::new_err(why.to_string()))?;
    py.import("json")?.call_method1("loads", (text,))
}

fn pixels(value: &Bound<PyAny>, name: &str) -> PyResult<Pixels> {
    if let Ok(picture) = value.cast::<Picture>() {
        return Ok(picture.get().pixels.clone());
    }
    let (values, shape) = numbers::<f32>(value, name, "float32", &[None, None, Some(3)])?;
    let kind: String =
        value.py().import("numpy")?.call_method1("asarray", (value,))?.getattr("dtype")?.str()?.extract()?;
    let white = match kind.as_str() {
        "uint8" => 255.0,
        _ if kind.starts_with("float") => 1.0,
        _ => return Err(PyTypeError::new_err(format!("{name}: expected floats or uint8, found {kind}"))),
    };
    let rgba = values.chunks_exact(3).map(|p| [p[0] / white, p[1] / white, p[2] / white, 1.0]).collect();
    Ok(Pixels { size: [shape[1] as u32, shape[0] as u32], rgba })
}
