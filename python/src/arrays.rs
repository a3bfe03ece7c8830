//! Arrays from Python, checked: NumPy arrays, tensors of PyTorch on any device, and nested lists.

use numpy::{PyArrayDyn, PyArrayMethods, PyReadonlyArrayDyn, PyUntypedArrayMethods};
use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use rayon::prelude::*;

/// An array of finite numbers, row by row.
pub struct Numbers<'py, T: numpy::Element>(PyReadonlyArrayDyn<'py, T>);

impl<T: numpy::Element> Numbers<'_, T> {
    pub fn shape(&self) -> &[usize] {
        self.0.shape()
    }

    pub fn values(&self) -> &[T] {
        self.0.as_slice().expect("the array is contiguous")
    }
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
    // A tensor of PyTorch, perhaps with gradients, perhaps on a GPU.
    let on_host = match value.hasattr("detach")? {
        true => value.call_method0("detach")?.call_method0("cpu")?,
        false => value.clone(),
    };
    let any = numpy.call_method1("asarray", (on_host,))?;
    let found: String = any.getattr("dtype")?.getattr("kind")?.extract()?;
    if !"fiu".contains(&found) {
        let dtype = any.getattr("dtype")?;
        return Err(PyTypeError::new_err(format!("{name}: expected numbers, found an array of {dtype}")));
    }
    let options = PyDict::new(py);
    options.set_item("dtype", kind)?;
    let array = numpy.call_method("ascontiguousarray", (&any,), Some(&options))?;
    // A number alone has no axes, and gets one there.
    let array = array.call_method1("reshape", (any.getattr("shape")?,))?;
    let array = Numbers(array.cast_into::<PyArrayDyn<T>>()?.readonly());
    let sides = array.shape();
    let fits =
        sides.len() == shape.len() && sides.iter().zip(shape).all(|(n, want)| want.is_none_or(|want| want == *n));
    if !fits {
        let wanted: Vec<String> = shape.iter().map(|n| n.map_or("N".to_owned(), |n| n.to_string())).collect();
        let wanted = wanted.join(", ");
        return Err(PyValueError::new_err(format!("{name}: expected the shape ({wanted}), found {sides:?}")));
    }
    let values = array.values();
    let wrong = py.detach(|| values.par_iter().position_first(|value| !(*value).into().is_finite()));
    if let Some(place) = wrong {
        let row = sides.iter().skip(1).product::<usize>().max(1);
        let value: f64 = values[place].into();
        return Err(PyValueError::new_err(format!("{name}: the value {value} in row {} is not finite", place / row)));
    }
    Ok(array)
}
