//! Cameras.

use std::path::PathBuf;

use glam::{DMat3, DVec2, DVec3};
use numpy::{PyArray2, PyArrayMethods};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use smalto::camera::{self, NamedCamera};

use crate::arrays::numbers;
use crate::errors::exception;

/// A pinhole camera: where it is, where it looks, and the pixels of its picture. Axes are those of OpenCV and COLMAP:
/// x right, y down, z forward. The pixel in column i and row j is sampled at (i + 0.5, j + 0.5).
///
/// K is the matrix [[fx, 0, cx], [0, fy, cy], [0, 0, 1]] in pixels, `size` is (width, height). The pose is either
/// `viewmat`, a 4x4 matrix from world to view, or `c2w`, its inverse. Errors: ValueError where a matrix has another
/// shape or no picture can be drawn.
#[pyclass(module = "smalto", frozen, from_py_object)]
#[derive(Clone)]
pub struct Camera {
    pub camera: camera::Camera,
    /// The largest near plane, in world units, that shows what it looks at; None for cameras of files.
    #[pyo3(get)]
    pub near: Option<f32>,
    /// The name of its photograph, if it has one.
    #[pyo3(get)]
    pub name: Option<String>,
}

#[pymethods]
impl Camera {
    #[new]
    #[pyo3(signature = (*, K, size, viewmat = None, c2w = None, near = None, name = None))]
    #[allow(non_snake_case)]
    fn new(
        K: &Bound<PyAny>,
        size: [u32; 2],
        viewmat: Option<&Bound<PyAny>>,
        c2w: Option<&Bound<PyAny>>,
        near: Option<f32>,
        name: Option<String>,
    ) -> PyResult<Self> {
        let k = numbers::<f64>(K, "K", "float64", &[Some(3), Some(3)])?;
        let k = k.values();
        let matrix = |value, name| numbers::<f64>(value, name, "float64", &[Some(4), Some(4)]);
        let rows =
            |m: &[f64]| DMat3::from_cols_array(&[m[0], m[1], m[2], m[4], m[5], m[6], m[8], m[9], m[10]]).transpose();
        let last = |m: &[f64]| DVec3::new(m[3], m[7], m[11]);
        let (rotation, position) = match (viewmat, c2w) {
            (Some(viewmat), None) => {
                let m = matrix(viewmat, "viewmat")?;
                let m = m.values();
                let rotation = rows(m);
                (rotation, -(rotation.transpose() * last(m)))
            }
            (None, Some(c2w)) => {
                let m = matrix(c2w, "c2w")?;
                let m = m.values();
                (rows(m).transpose(), last(m))
            }
            _ => return Err(PyValueError::new_err("a camera has one pose: give either viewmat or c2w")),
        };
        let (focal_px, centre_px) = (DVec2::new(k[0], k[4]), DVec2::new(k[2], k[5]));
        let camera = camera::Camera { position, rotation, focal_px, centre_px, size_px: size };
        Ok(Self { camera: usable(camera)?, near, name })
    }

    /// All cameras of a file or folder: cameras.json, transforms.json, the folder of a COLMAP model.
    #[staticmethod]
    fn read(py: Python, path: PathBuf) -> PyResult<Vec<Self>> {
        let file = py.detach(|| camera::read(&path)).map_err(exception)?;
        let named = |NamedCamera { name, camera }| Self { camera, near: None, name: Some(name) };
        Ok(file.cameras.into_iter().map(named).collect())
    }

    /// The same view in a picture of another size (width, height).
    fn resized(&self, size: [u32; 2]) -> PyResult<Self> {
        Ok(Self { camera: usable(self.camera.resized(size))?, ..self.clone() })
    }

    /// Width and height in pixels.
    #[getter]
    fn size(&self) -> (u32, u32) {
        self.camera.size_px.into()
    }

    /// The 3x3 matrix of the intrinsics, in pixels.
    #[getter]
    #[allow(non_snake_case)]
    fn K<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let (f, c) = (self.camera.focal_px, self.camera.centre_px);
        square(py, &[f.x, 0.0, c.x, 0.0, f.y, c.y, 0.0, 0.0, 1.0], 3)
    }

    /// The 4x4 matrix from world to view.
    #[getter]
    fn viewmat<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let rotation = self.camera.rotation;
        square(py, &pose(rotation, -(rotation * self.camera.position)), 4)
    }

    /// The 4x4 matrix from view to world.
    #[getter]
    fn c2w<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        square(py, &pose(self.camera.rotation.transpose(), self.camera.position), 4)
    }

    fn __repr__(&self) -> String {
        let ([width, height], p) = (self.camera.size_px, self.camera.position);
        format!("Camera({width}x{height} at {:.3}, {:.3}, {:.3})", p.x, p.y, p.z)
    }
}

/// The camera, if a picture can be drawn with it.
pub fn usable(camera: camera::Camera) -> PyResult<camera::Camera> {
    camera.checked().map_err(|why| PyValueError::new_err(format!("the camera cannot be used: {why:#}")))
}

fn pose(rotation: DMat3, last: DVec3) -> [f64; 16] {
    let [r, d, f] = [rotation.row(0), rotation.row(1), rotation.row(2)];
    [r.x, r.y, r.z, last.x, d.x, d.y, d.z, last.y, f.x, f.y, f.z, last.z, 0.0, 0.0, 0.0, 1.0]
}

fn square<'py>(py: Python<'py>, values: &[f64], side: usize) -> PyResult<Bound<'py, PyArray2<f64>>> {
    numpy::PyArray1::from_slice(py, values).reshape([side, side])
}
