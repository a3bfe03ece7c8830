//! The Python module of smalto: scenes, cameras and pictures as NumPy arrays.

mod arrays;
mod asked;
mod camera;
mod device_memory;
mod errors;
mod given;
mod picture;
mod process;
mod reference;
mod renderer;
mod scene;
mod split;

use std::process::ExitCode;

use pyo3::prelude::*;

/// Runs the command line program with these arguments, the name of the program first. Returns its exit code.
#[pyfunction]
fn main(py: Python, arguments: Vec<String>) -> u8 {
    let code = py.detach(|| smalto::cli::run_as_program(arguments));
    // An exit code does not tell its number.
    (0..=u8::MAX).find(|number| ExitCode::from(*number) == code).unwrap_or(1)
}

#[pymodule]
fn _smalto(module: &Bound<PyModule>) -> PyResult<()> {
    module.add("__version__", env!("CARGO_PKG_VERSION"))?;
    module.add("MAX_SH_DEGREE", smalto::scene::MAX_SH_DEGREE)?;
    module.add_class::<scene::Scene>()?;
    module.add_class::<camera::Camera>()?;
    module.add_class::<picture::Picture>()?;
    module.add_class::<renderer::Renderer>()?;
    module.add_class::<split::SplitRenderer>()?;
    module.add_class::<device_memory::Exported>()?;
    module.add_class::<device_memory::Channels>()?;
    module.add_class::<device_memory::DeviceArrays>()?;
    module.add_function(wrap_pyfunction!(picture::compare, module)?)?;
    module.add_function(wrap_pyfunction!(reference::reference, module)?)?;
    module.add_function(wrap_pyfunction!(renderer::device_for_cuda, module)?)?;
    module.add_function(wrap_pyfunction!(main, module)?)?;
    errors::add_to(module)
}
