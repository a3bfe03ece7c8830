//! Arrays from Python, checked: NumPy arrays, tensors of PyTorch on any device, and nested lists.

use numpy::{PyArrayDyn, PyArrayMethods, PyReadonlyArrayDyn, PyUntypedArrayMethods};
use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use rayon::prelude::*;

/// Numbers from which on it pays to share them among threads.
const MANY: usize = 1 << 16;

/// An array of finite numbers, row by row.
pub struct Numbers<'py, T: numpy::Element> {
    array: PyReadonlyArrayDyn<'py, T>,
    /// Its kind before it was converted, as NumPy names it.
    pub dtype: String,
}

impl<T: numpy::Element> Numbers<'_, T> {
    pub fn shape(&self) -> &[usize] {
        self.array.shape()
    }

    pub fn values(&self) -> &[T] {
        self.array.as_slice().expect("the array is contiguous and aligned")
    }
}

/// An array whose memory NumPy can show: for a tensor of PyTorch, perhaps with gradients, one on the host. From CUDA it
/// comes through pinned memory, which PyTorch keeps for the next time. NumPy has no bfloat16, so that floats of 16 bits
/// become floats of 32.
fn on_host<'py>(value: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyAny>> {
    let py = value.py();
    if !value.hasattr("detach")? {
        return Ok(value.clone());
    }
    let mut tensor = value.call_method0("detach")?;
    if tensor.call_method0("is_floating_point")?.is_truthy()?
        && tensor.call_method0("element_size")?.extract::<u8>()? < 4
    {
        tensor = tensor.call_method0("float")?;
    }
    if !tensor.getattr("is_cuda")?.is_truthy()? {
        return tensor.call_method0("cpu");
    }
    let pinned = PyDict::new(py);
    pinned.set_item("device", "cpu")?;
    pinned.set_item("pin_memory", true)?;
    let host = py.import("torch")?.call_method("empty_like", (&tensor,), Some(&pinned))?;
    host.call_method1("copy_", (tensor,))
}

/// The values of an array in f64 or f32; they are copied only if they are others. `None` in `shape` stands for any
/// length.
pub fn numbers<'py, T: numpy::Element + Copy + Into<f64> + Sync>(
    value: &Bound<'py, PyAny>,
    name: &str,
    kind: &str,
    shape: &[Option<usize>],
) -> PyResult<Numbers<'py, T>> {
    let py = value.py();
    let numpy = py.import("numpy")?;
    let any = numpy.call_method1("asarray", (on_host(value)?,));
    let any = any.map_err(|why| PyTypeError::new_err(format!("{name}: expected numbers: {why}")))?;
    let found: String = any.getattr("dtype")?.getattr("kind")?.extract()?;
    let dtype: String = any.getattr("dtype")?.str()?.extract()?;
    if !"fiu".contains(&found) {
        return Err(PyTypeError::new_err(format!("{name}: expected numbers, found an array of {dtype}")));
    }
    // Contiguous and aligned.
    let array = numpy.call_method1("require", (&any, kind, ["C", "A"]))?;
    // A number alone has no axes, and gets one there.
    let array = array.call_method1("reshape", (any.getattr("shape")?,))?;
    let array = Numbers { array: array.cast_into::<PyArrayDyn<T>>()?.readonly(), dtype };
    let sides = array.shape();
    let fits =
        sides.len() == shape.len() && sides.iter().zip(shape).all(|(n, want)| want.is_none_or(|want| want == *n));
    if !fits {
        let wanted: Vec<String> = shape.iter().map(|n| n.map_or("N".to_owned(), |n| n.to_string())).collect();
        let sides: Vec<String> = sides.iter().map(usize::to_string).collect();
        return Err(PyValueError::new_err(format!(
            "{name}: expected the shape {}, found {}",
            axes(&wanted),
            axes(&sides)
        )));
    }
    let values = array.values();
    let is_wrong = |value: &T| !(*value).into().is_finite();
    let wrong = match values.len() {
        0..MANY => values.iter().position(is_wrong),
        _ => py.detach(|| values.par_iter().position_first(is_wrong)),
    };
    if let Some(place) = wrong {
        let row = sides.iter().skip(1).product::<usize>().max(1);
        let value: f64 = values[place].into();
        return Err(PyValueError::new_err(format!("{name}: the value {value} in row {} is not finite", place / row)));
    }
    Ok(array)
}

/// A shape as Python writes it.
fn axes(sides: &[String]) -> String {
    let comma = if sides.len() == 1 { "," } else { "" };
    format!("({}{comma})", sides.join(", "))
}
