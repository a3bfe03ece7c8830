//! The exceptions of the module, and which error becomes which.

use pyo3::create_exception;
use pyo3::exceptions::{PyKeyboardInterrupt, PyMemoryError, PyRuntimeError, PyValueError};
use pyo3::prelude::*;
use smalto::gpu::{TooLarge, Unavailable};
use smalto::host_memory::OutOfMemory;
use smalto::render::{NoLevels, UndrawableLens};
use smalto::scene::{Cancelled, NoLevel, Unreadable};

create_exception!(smalto, Error, PyRuntimeError, "An error of smalto.");
create_exception!(smalto, DeviceError, Error, "No Vulkan device can be used; the message says what is missing.");
create_exception!(smalto, UnreadableError, PyValueError, "A file is not a scene or a camera file that can be drawn.");
create_exception!(smalto, OutOfMemoryError, PyMemoryError, "Memory of the host or of the device runs out.");

/// The exception for an error of the library.
pub fn exception(error: anyhow::Error) -> PyErr {
    if let Some(refused) = error.downcast_ref::<UndrawableLens>() {
        let remedies = ["camera.undistorted() is its pinhole", "response=\"screen\" draws projections"];
        return PyValueError::new_err(refused.sentence(remedies));
    }
    let text = format!("{error:#}");
    if error.is::<Unavailable>() {
        DeviceError::new_err(text)
    } else if error.is::<Unreadable>() {
        UnreadableError::new_err(text)
    } else if error.is::<OutOfMemory>() {
        OutOfMemoryError::new_err(text)
    } else if error.is::<Cancelled>() {
        PyKeyboardInterrupt::new_err(())
    } else if error.is::<NoLevel>() || error.is::<NoLevels>() || error.is::<TooLarge>() {
        PyValueError::new_err(text)
    } else {
        Error::new_err(text)
    }
}

pub fn add_to(module: &Bound<PyModule>) -> PyResult<()> {
    let py = module.py();
    module.add("Error", py.get_type::<Error>())?;
    module.add("DeviceError", py.get_type::<DeviceError>())?;
    module.add("UnreadableError", py.get_type::<UnreadableError>())?;
    module.add("OutOfMemoryError", py.get_type::<OutOfMemoryError>())
}
