//! Arguments from Python, checked: every error names the argument.

use std::convert::Infallible;

use pyo3::exceptions::{PyOverflowError, PyTypeError, PyValueError};
use pyo3::prelude::*;
use smalto::camera::MAX_SIDE;
use smalto::rules::Background;

use crate::arrays::numbers;

/// The value of an argument as `T`. `expected` describes it: "a number of bytes".
pub fn given<'a, 'py, T: FromPyObject<'a, 'py>>(
    value: &'a Bound<'py, PyAny>,
    name: &str,
    expected: &str,
) -> PyResult<T> {
    value.extract().map_err(|why: T::Error| {
        let why: PyErr = why.into();
        let found = value.repr().map_or_else(|_| "another object".to_owned(), |text| text.to_string());
        let found: String = found.chars().take(80).collect();
        let text = format!("{name}: expected {expected}, found {found}");
        match why.is_instance_of::<PyOverflowError>(value.py()) {
            true => PyValueError::new_err(text),
            false => PyTypeError::new_err(text),
        }
    })
}

/// As [`given`], for an argument that may be None.
pub fn optional<'a, 'py, T: FromPyObject<'a, 'py>>(
    value: Option<&'a Bound<'py, PyAny>>,
    name: &str,
    expected: &str,
) -> PyResult<Option<T>> {
    value.map(|value| given(value, name, expected)).transpose()
}

/// Width and height in pixels.
pub fn size(value: &Bound<PyAny>) -> PyResult<[u32; 2]> {
    let sides = numbers::<f64>(value, "size", "float64", &[Some(2)])?;
    if !sides.dtype.contains("int") {
        return Err(PyTypeError::new_err(format!("size: expected whole numbers, found {}", sides.dtype)));
    }
    let &[width, height] = sides.values() else { unreachable!("the shape is checked") };
    Ok([side(width as i64, "size")?, side(height as i64, "size")?])
}

/// A width or a height in pixels.
pub fn side(side: i64, name: &str) -> PyResult<u32> {
    let wrong = || PyValueError::new_err(format!("{name}: {side} is not from 1 to {MAX_SIDE} pixels"));
    u32::try_from(side).ok().filter(|side| (1..=MAX_SIDE).contains(side)).ok_or_else(wrong)
}

/// A background that may not be given: then it is black.
pub struct Ground<'py>(Option<Bound<'py, PyAny>>);

impl<'py> Ground<'py> {
    pub const BLACK: Self = Self(None);

    pub fn background(&self) -> PyResult<Background> {
        match &self.0 {
            None => Ok(Background::BLACK),
            Some(value) if value.is_none() => Ok(Background::Transparent),
            Some(value) => {
                let colour = numbers::<f32>(value, "background", "float32", &[Some(3)])?;
                let &[r, g, b] = colour.values() else { unreachable!("the shape is checked") };
                Ok(Background::Colour([r, g, b]))
            }
        }
    }
}

impl<'py> FromPyObject<'_, 'py> for Ground<'py> {
    type Error = Infallible;

    fn extract(value: Borrowed<'_, 'py, PyAny>) -> Result<Self, Infallible> {
        Ok(Self(Some(value.to_owned())))
    }
}
