//! Cameras.

use std::hash::{DefaultHasher, Hash, Hasher};
use std::path::PathBuf;
use std::sync::Arc;

use glam::{DMat3, DVec2, DVec3};
use numpy::{PyArray1, PyArray2, PyArray3, PyArrayMethods};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyTuple};
use rayon::prelude::*;
use smalto::camera::{self, FTheta, InPixels, Lens, NamedCamera};

use crate::arrays::numbers;
use crate::errors::exception;
use crate::given::{self, given, optional};

type TwoArrays<'py, A, B> = (Bound<'py, A>, Bound<'py, B>);

/// A camera: where it is, where it looks, its lens, and the pixels of its picture. Axes are those of OpenCV and COLMAP:
/// x right, y down, z forward. The pixel in column i and row j is sampled at (i + 0.5, j + 0.5).
///
/// K is the matrix [[fx, 0, cx], [0, fy, cy], [0, 0, 1]] in pixels, `size` is (width, height). The pose is either
/// `viewmat`, a 4x4 matrix from world to view, or `c2w`, its inverse. Its rotation R may be off by rounding: where an
/// entry of R R^T - I is over 1e-6, it becomes the nearest rotation, and over 0.005 it is refused. `near` is the largest
/// near plane, in world units, that shows what the camera looks at.
///
/// `lens` is the name of a model of `smalto render --lens` and its parameters, like ("OPENCV_FISHEYE", [k1, k2, k3,
/// k4]); the name alone is enough for a model without parameters, and by default the camera is a pinhole. The focal
/// lengths of EQUIRECTANGULAR are in pixels per radian, those of ORTHOGRAPHIC in pixels per world unit.
///
/// Cameras can be compared, pickled, and be keys of dictionaries. Errors: ValueError where a matrix has another shape or
/// form, the lens is none, or no picture can be drawn.
#[pyclass(module = "smalto", frozen, eq, from_py_object)]
#[derive(Clone, PartialEq)]
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
    #[pyo3(signature = (*, K, size, viewmat = None, c2w = None, near = None, name = None, lens = None))]
    #[allow(non_snake_case)]
    fn new(
        K: &Bound<PyAny>,
        size: &Bound<PyAny>,
        viewmat: Option<&Bound<PyAny>>,
        c2w: Option<&Bound<PyAny>>,
        near: Option<&Bound<PyAny>>,
        name: Option<&Bound<PyAny>>,
        lens: Option<&Bound<PyAny>>,
    ) -> PyResult<Self> {
        let (focal_px, centre_px) = intrinsics(K)?;
        let (rotation, position) = match (viewmat, c2w) {
            (Some(viewmat), None) => {
                let (rotation, last) = rows(viewmat, "viewmat")?;
                (rotation, -(rotation.transpose() * last))
            }
            (None, Some(c2w)) => {
                let (rotation, position) = rows(c2w, "c2w")?;
                (rotation.transpose(), position)
            }
            _ => return Err(PyValueError::new_err("viewmat, c2w: a camera has one pose, so give either of them")),
        };
        let (size_px, lens) = (given::size(size)?, lens.map(named_lens).transpose()?.flatten());
        let camera = camera::Camera { position, rotation, focal_px, centre_px, size_px, lens };
        let near = optional::<f64>(near, "near", "a number, or None")?;
        if let Some(wrong) = near.filter(|near| !near.is_finite() || *near as f32 <= 0.0) {
            return Err(PyValueError::new_err(format!("near: expected a distance over 0, found {wrong}")));
        }
        let name = optional(name, "name", "a text, or None")?;
        Ok(Self { camera: usable(camera)?, near: near.map(|near| near as f32), name })
    }

    /// A camera of `rasterization`: its view is the product with all entries of `viewmat`, also where the upper left
    /// 3x3 is a rotation up to some thousandths only.
    #[staticmethod]
    #[pyo3(signature = (K, size, viewmat, lens = None))]
    #[allow(non_snake_case)]
    fn _as_given(
        K: &Bound<PyAny>,
        size: &Bound<PyAny>,
        viewmat: &Bound<PyAny>,
        lens: Option<&Bound<PyAny>>,
    ) -> PyResult<Self> {
        // gsplat reads neither the skew of K, nor its last row, nor that of a pose.
        let k = numbers::<f64>(K, "Ks", "float64", &[Some(3), Some(3)])?;
        let m = numbers::<f64>(viewmat, "viewmats", "float64", &[Some(4), Some(4)])?;
        let (k, m) = (k.values(), m.values());
        let (rotation, last) = split(m);
        let camera = camera::Camera {
            position: -(rotation.inverse() * last),
            rotation,
            focal_px: DVec2::new(k[0], k[4]),
            centre_px: DVec2::new(k[2], k[5]),
            size_px: given::size(size)?,
            lens: lens.map(named_lens).transpose()?.flatten(),
        };
        let camera = camera.checked_as_given();
        let unusable = |why| PyValueError::new_err(format!("viewmats, Ks: a camera cannot be used: {why:#}"));
        Ok(Self { camera: camera.map_err(unusable)?, near: None, name: None })
    }

    /// The focal length in pixels and the lens of gsplat's `ftheta_coeffs`.
    #[staticmethod]
    fn _f_theta(
        angle_to_px: [f64; 6],
        px_to_angle: [f64; 6],
        is_px_to_angle: bool,
        max_angle: f64,
        linear: [f64; 3],
    ) -> PyResult<(f64, (&'static str, Vec<f64>))> {
        let found = Lens::f_theta(&FTheta { angle_to_px, px_to_angle, is_px_to_angle, max_angle, linear });
        let InPixels { focal_px, lens, .. } =
            found.map_err(|why| PyValueError::new_err(format!("ftheta_coeffs: the lens cannot be used: {why:#}")))?;
        Ok((focal_px, (lens.model(), lens.parameters().to_vec())))
    }

    /// All cameras of a file or folder, with their lenses: cameras.json, transforms.json, the folder of a COLMAP model.
    #[staticmethod]
    fn read(py: Python, path: &Bound<PyAny>) -> PyResult<Vec<Self>> {
        let path: PathBuf = given(path, "path", "a path")?;
        let file = py.detach(|| camera::read(&path)).map_err(exception)?;
        let named = |NamedCamera { name, camera, .. }| Self { camera, near: None, name: Some(name) };
        Ok(file.cameras.into_iter().map(named).collect())
    }

    /// The same view in a picture of another size (width, height).
    fn resized(&self, size: &Bound<PyAny>) -> PyResult<Self> {
        Ok(Self { camera: usable(self.camera.resized(given::size(size)?))?, ..self.clone() })
    }

    /// The pinhole of the same pose and intrinsics. Errors: ValueError for EQUIRECTANGULAR and ORTHOGRAPHIC, which see
    /// what no pinhole does.
    fn undistorted(&self) -> PyResult<Self> {
        let camera = self.camera.undistorted().map_err(|why| PyValueError::new_err(format!("the camera: {why:#}")))?;
        Ok(Self { camera, ..self.clone() })
    }

    /// Where points of the world (N, 3) are seen: pixels (N, 2), x before y, and a mask (N,), in float64. The mask is
    /// False, and the pixels are NaN, where a point is behind a pinhole or outside the domain of the lens. Pixels may lie
    /// outside the picture. The centre of the pixel in column i and row j is (i + 0.5, j + 0.5).
    ///
    /// Errors: TypeError and ValueError where `points` are not finite numbers of this shape.
    fn project<'py>(
        &self,
        py: Python<'py>,
        points: &Bound<'py, PyAny>,
    ) -> PyResult<TwoArrays<'py, PyArray2<f64>, PyArray1<bool>>> {
        let points = numbers::<f64>(points, "points", "float64", &[None, Some(3)])?;
        let (points, camera) = (points.values(), &self.camera);
        let places: Vec<[f64; 2]> = py.detach(|| {
            let place =
                |point: &[f64]| camera.projected(DVec3::from_slice(point)).map_or(DVec2::NAN, |(place, _)| place);
            points.par_chunks_exact(3).map(|point| place(point).to_array()).collect()
        });
        let is_seen: Vec<bool> = places.iter().map(|[x, _]| !x.is_nan()).collect();
        let pixels = PyArray1::from_slice(py, places.as_flattened()).reshape([places.len(), 2])?;
        Ok((pixels, PyArray1::from_vec(py, is_seen)))
    }

    /// The rays of the centres of all pixels: origins and directions in world axes, each (height, width, 3) in float64.
    /// Directions have the length 1, and are NaN where the lens sees nothing. The origin is the position of the camera;
    /// of ORTHOGRAPHIC it is the point of the ray in the plane through the position.
    fn rays<'py>(&self, py: Python<'py>) -> PyResult<TwoArrays<'py, PyArray3<f64>, PyArray3<f64>>> {
        let (width, height) = self.size();
        let numpy = py.import("numpy")?;
        // NumPy raises a MemoryError where there is not enough.
        let empty = || PyResult::Ok(numpy.call_method1("empty", ((height, width, 3),))?.cast_into::<PyArray3<f64>>()?);
        let (all_origins, all_directions) = (empty()?, empty()?);
        {
            let (mut origins, mut directions) = (all_origins.readwrite(), all_directions.readwrite());
            let [origins, directions] = [&mut origins, &mut directions]
                .map(|array| array.as_slice_mut().expect("an array that NumPy has just made is contiguous"));
            let camera = &self.camera;
            py.detach(|| {
                let row = 3 * width as usize;
                let rows = origins.par_chunks_exact_mut(row).zip(directions.par_chunks_exact_mut(row)).enumerate();
                rows.for_each(|(y, (origins, directions))| {
                    for (x, (origin, direction)) in
                        origins.chunks_exact_mut(3).zip(directions.chunks_exact_mut(3)).enumerate()
                    {
                        let ray = world_ray(camera, DVec2::new(x as f64 + 0.5, y as f64 + 0.5));
                        origin.copy_from_slice(&ray[0].to_array());
                        direction.copy_from_slice(&ray[1].to_array());
                    }
                });
            });
        }
        Ok((all_origins, all_directions))
    }

    /// The arguments that make this camera again, to the last bit.
    fn __getnewargs_ex__<'py>(&self, py: Python<'py>) -> PyResult<(Bound<'py, PyTuple>, Bound<'py, PyDict>)> {
        let arguments = PyDict::new(py);
        arguments.set_item("K", self.K(py)?)?;
        arguments.set_item("size", self.size())?;
        arguments.set_item("c2w", self.c2w(py)?)?;
        arguments.set_item("near", self.near)?;
        arguments.set_item("name", &self.name)?;
        arguments.set_item("lens", self.lens())?;
        Ok((PyTuple::empty(py), arguments))
    }

    fn __hash__(&self) -> u64 {
        let camera::Camera { position, rotation, focal_px, centre_px, size_px, lens } = &self.camera;
        let mut hasher = DefaultHasher::new();
        let (position, focal_px, centre_px) = (position.to_array(), focal_px.to_array(), centre_px.to_array());
        let (model, lens_parameters) = lens.as_ref().map_or(("", &[][..]), |lens| (lens.model(), lens.parameters()));
        let numbers = [&position[..], &focal_px, &centre_px, &rotation.to_cols_array(), lens_parameters];
        // Equal numbers have equal bits, but for the sign of 0.
        numbers.iter().copied().flatten().for_each(|number| (number + 0.0).to_bits().hash(&mut hasher));
        (size_px, model, self.near.map(f32::to_bits), &self.name).hash(&mut hasher);
        hasher.finish()
    }

    /// Width and height in pixels.
    #[getter]
    fn size(&self) -> (u32, u32) {
        self.camera.size_px.into()
    }

    /// The name of the model of its lens and the parameters; None for a pinhole.
    #[getter]
    fn lens(&self) -> Option<(&'static str, Vec<f64>)> {
        self.camera.lens.as_ref().map(|lens| (lens.model(), lens.parameters().to_vec()))
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
        let lens = self.camera.lens.as_ref().map_or(String::new(), |lens| format!(", {}", lens.model()));
        format!("Camera({width}x{height} at {:.3}, {:.3}, {:.3}{lens})", p.x, p.y, p.z)
    }
}

/// Origin and direction of the ray of a place in pixels, in world axes. The direction is NaN where nothing is seen.
fn world_ray(camera: &camera::Camera, place_px: DVec2) -> [DVec3; 2] {
    let to_world = camera.rotation.transpose();
    let ray = camera.ray(place_px).unwrap_or(DVec3::NAN);
    if camera.is_parallel() {
        return [camera.position + to_world * ray.with_z(0.0), camera.forward()];
    }
    [camera.position, to_world * ray.normalize()]
}

/// The camera, if a picture can be drawn with it.
pub fn usable(camera: camera::Camera) -> PyResult<camera::Camera> {
    camera.checked().map_err(|why| PyValueError::new_err(format!("the camera cannot be used: {why:#}")))
}

/// The lens of a model by its name, or by its name and its parameters. None for a pinhole.
fn named_lens(value: &Bound<PyAny>) -> PyResult<Option<Arc<Lens>>> {
    let (model, parameters) = match value.extract::<String>() {
        Ok(model) => (model, Vec::new()),
        Err(_) => given::<(String, Vec<f64>)>(value, "lens", "the name of a model, or (name, parameters)")?,
    };
    let lens = Lens::named(&model, &parameters);
    let lens = lens.map_err(|why| PyValueError::new_err(format!("lens: {why:#}")))?;
    Ok(lens.map(Arc::new))
}

/// Focal lengths and principal point of a matrix of intrinsics, which has no skew.
fn intrinsics(matrix: &Bound<PyAny>) -> PyResult<(DVec2, DVec2)> {
    let k = numbers::<f64>(matrix, "K", "float64", &[Some(3), Some(3)])?;
    let k = k.values();
    if [k[1], k[3], k[6], k[7], k[8] - 1.0] != [0.0; 5] {
        let why =
            "K: expected [[fx, 0, cx], [0, fy, cy], [0, 0, 1]]; pictures with a skew or another scale are not drawn";
        return Err(PyValueError::new_err(why));
    }
    Ok((DVec2::new(k[0], k[4]), DVec2::new(k[2], k[5])))
}

/// The upper left 3x3 and the last column of a 4x4 matrix, whose last row is 0, 0, 0, 1.
fn rows(matrix: &Bound<PyAny>, name: &str) -> PyResult<(DMat3, DVec3)> {
    let m = numbers::<f64>(matrix, name, "float64", &[Some(4), Some(4)])?;
    let m = m.values();
    if m[12..] != [0.0, 0.0, 0.0, 1.0] {
        return Err(PyValueError::new_err(format!("{name}: the last row is {:?}, and not 0, 0, 0, 1", &m[12..])));
    }
    Ok(split(m))
}

fn split(m: &[f64]) -> (DMat3, DVec3) {
    let rotation = DMat3::from_cols_array(&[m[0], m[1], m[2], m[4], m[5], m[6], m[8], m[9], m[10]]).transpose();
    (rotation, DVec3::new(m[3], m[7], m[11]))
}

fn pose(rotation: DMat3, last: DVec3) -> [f64; 16] {
    let [r, d, f] = [rotation.row(0), rotation.row(1), rotation.row(2)];
    [r.x, r.y, r.z, last.x, d.x, d.y, d.z, last.y, f.x, f.y, f.z, last.z, 0.0, 0.0, 0.0, 1.0]
}

fn square<'py>(py: Python<'py>, values: &[f64], side: usize) -> PyResult<Bound<'py, PyArray2<f64>>> {
    PyArray1::from_slice(py, values).reshape([side, side])
}
