//! `smalto.Scene`: a scene in memory or in a page file.

use std::ops::RangeInclusive;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::Ordering;

use numpy::{PyArray1, PyArrayMethods};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use rayon::prelude::*;
use smalto::camera;
use smalto::formats::{SceneFile, write_file};
use smalto::procedural::Procedural;
use smalto::render::SceneSource;
use smalto::scene::{Arrays, Gaussians, MAX_SH_DEGREE, Watch, sh_coefficients};

use crate::arrays::{Numbers, numbers};
use crate::camera::{Camera, usable};
use crate::errors::exception;
use crate::given::{self, given, optional};
use crate::process::{check_process, interruptible};
use crate::renderer::Rows;

/// Gaussians, in the memory of the host or in a page file.
#[pyclass(module = "smalto", frozen)]
pub struct Scene {
    pub source: SceneSource,
    /// Of a scene of features, the rows of its arrays that became Gaussians; those with the opacity 0 did not.
    pub rows: Option<Rows>,
}

#[pymethods]
impl Scene {
    /// Reads a scene file of any format that `smalto render` reads, or makes a procedural scene such as
    /// "cactus:100000". A page file (.smalto) stays on the disk and is drawn page by page. `up` is the axis of the file
    /// that points up, like "z" or "-y", `flip` names axes to reverse, like "yz", and `sog_level` is the level of a
    /// streamed SOG, 0 the finest. Errors: UnreadableError, MemoryError, ValueError for an axis or a level that there
    /// is not. Ctrl-C ends the reading.
    #[staticmethod]
    #[pyo3(signature = (path, *, up = None, flip = None, sog_level = None))]
    fn read(
        py: Python,
        path: &Bound<PyAny>,
        up: Option<&Bound<PyAny>>,
        flip: Option<&Bound<PyAny>>,
        sog_level: Option<&Bound<PyAny>>,
    ) -> PyResult<Self> {
        check_process()?;
        let path: PathBuf = given(path, "path", "a path")?;
        let up: Option<String> = optional(up, "up", "an axis, or None")?;
        let flip: Option<String> = optional(flip, "flip", "names of axes, or None")?;
        let sog_level = optional(sog_level, "sog_level", "the number of a level, or None")?;
        let reading = smalto::cli::reading(up.as_deref(), flip.as_deref(), sog_level);
        let reading = reading.map_err(|why| PyValueError::new_err(format!("{why:#}")))?;
        interruptible(py, move |is_cancelled| {
            if let Some(made) = path.to_str().and_then(Procedural::parse) {
                let made = made.map_err(|why| PyValueError::new_err(format!("{}: {why:#}", path.display())))?;
                let made = reading.make(made).map_err(exception)?;
                return Ok(Self::of(SceneSource::of_scene(made, &path.display().to_string())));
            }
            let is_cancelled = || is_cancelled.load(Ordering::Relaxed);
            let watch = Watch { is_cancelled: &is_cancelled, ..Watch::NONE };
            Ok(Self::of(SceneSource::open_watched(path, &reading, &watch).map_err(exception)?))
        })?
    }

    /// A scene of N Gaussians: means (N, 3) in world units, quats (N, 4) as w, x, y, z of any length but 0, scales
    /// (N, 3), the standard deviations in world units, opacities (N) from 0 to 1, and sh (N, K, 3), the coefficients of
    /// spherical harmonics with K = 1, 4, 9, 16 or 25. Values become 32-bit floats. Gaussians with the opacity 0 are
    /// left out. Errors: ValueError for another shape or a value that cannot be drawn, TypeError for what is not numbers.
    #[staticmethod]
    #[pyo3(signature = (means, quats, scales, opacities, sh, *, antialiased = false))]
    pub fn from_arrays(
        py: Python,
        means: &Bound<PyAny>,
        quats: &Bound<PyAny>,
        scales: &Bound<PyAny>,
        opacities: &Bound<PyAny>,
        sh: &Bound<PyAny>,
        antialiased: bool,
    ) -> PyResult<Self> {
        check_process()?;
        let arrays = Given::of([means, quats, scales, opacities], Some(sh))?;
        let values = arrays.view();
        py.detach(|| {
            let gaussians = gaussians(values)?;
            Ok(Self::of(SceneSource { is_antialiased: antialiased, ..SceneSource::of(gaussians) }))
        })
    }

    /// A scene whose Gaussians have features in the place of colours. `Renderer._bring` brings them to the device.
    #[staticmethod]
    fn _of_features(
        py: Python,
        means: &Bound<PyAny>,
        quats: &Bound<PyAny>,
        scales: &Bound<PyAny>,
        opacities: &Bound<PyAny>,
    ) -> PyResult<Self> {
        check_process()?;
        let arrays = Given::of([means, quats, scales, opacities], None)?;
        let values = arrays.view();
        py.detach(|| scene_of_features(values))
    }

    /// Writes the scene as .ply, .compressed.ply, .spz, .splat, .sog or .glb, and reads it back before it replaces what
    /// is there. Errors: ValueError for another ending or a scene in a page file, smalto.Error if it cannot be written.
    fn write(&self, py: Python, path: &Bound<PyAny>) -> PyResult<()> {
        check_process()?;
        let path: PathBuf = given(path, "path", "a path")?;
        let kind = SceneFile::of(&path).map_err(|why| PyValueError::new_err(format!("{why:#}")))?;
        let gaussians = self.gaussians("write")?;
        py.detach(|| {
            let arranged = kind.arranged(gaussians)?;
            write_file(&path, kind, &arranged, self.antialiased(), &|_| {}).map(|_| ())
        })
        .map_err(exception)
    }

    /// The camera of `smalto render` where none is given: it shows the whole scene.
    fn camera(&self, py: Python, width: &Bound<PyAny>, height: &Bound<PyAny>) -> PyResult<Camera> {
        check_process()?;
        let side = |value, name| given::side(given(value, name, "a whole number of pixels")?, name);
        let (width, height) = (side(width, "width")?, side(height, "height")?);
        let focus = py.detach(|| self.source.focus());
        let camera = usable(camera::Camera::framing(focus.centre.into(), focus.radius, [width, height]))?;
        let near = Some(camera.framed_near(focus.centre.into()));
        Ok(Camera { camera, near, name: None })
    }

    /// True if it was trained with the antialiasing of Mip-Splatting, and is drawn so.
    #[getter]
    fn antialiased(&self) -> bool {
        self.source.is_antialiased
    }

    /// Differences between the scene and its file, a sentence each.
    #[getter]
    fn notices(&self) -> Vec<String> {
        self.source.notices.clone()
    }

    /// The highest degree of its spherical harmonics.
    #[getter]
    fn sh_degree(&self) -> u32 {
        self.source.statistics().sh_degree
    }

    /// The means, (N, 3) in world units: a copy.
    #[getter]
    fn means<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        rows(py, self.gaussians("means")?.means().as_flattened(), &[3])
    }

    /// The rotations, (N, 4) as w, x, y, z of length 1: a copy.
    #[getter]
    fn quats<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        rows(py, self.gaussians("quats")?.rotations().as_flattened(), &[4])
    }

    /// The standard deviations, (N, 3) in world units: a copy.
    #[getter]
    fn scales<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        rows(py, self.gaussians("scales")?.scales().as_flattened(), &[3])
    }

    /// The opacities, (N) from 0 to 1: a copy.
    #[getter]
    fn opacities<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        rows(py, self.gaussians("opacities")?.opacities(), &[])
    }

    /// The coefficients of spherical harmonics, (N, K, 3): a copy.
    #[getter]
    fn sh<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let all = self.gaussians("sh")?;
        rows(py, all.all_sh().as_flattened(), &[sh_coefficients(all.sh_degree()), 3])
    }

    fn __len__(&self) -> usize {
        self.source.count()
    }

    fn __repr__(&self) -> String {
        format!("Scene({} Gaussians, SH degree {})", self.__len__(), self.sh_degree())
    }
}

impl Scene {
    fn of(source: SceneSource) -> Self {
        Self { source, rows: None }
    }

    /// The Gaussians in memory. `user` names the method that needs them.
    pub fn gaussians(&self, user: &str) -> PyResult<&Gaussians> {
        let missing = || PyValueError::new_err(format!("{user}: the Gaussians of a page file are not in memory"));
        self.source.gaussians().ok_or_else(missing)
    }
}

/// The arrays of a scene, as Python gave them.
struct Given<'py> {
    geometry: [Numbers<'py, f32>; 4],
    sh: Option<Numbers<'py, f32>>,
    degree: u32,
}

impl<'py> Given<'py> {
    fn of(
        [means, quats, scales, opacities]: [&Bound<'py, PyAny>; 4],
        sh: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Self> {
        let means = numbers::<f32>(means, "means", "float32", &[None, Some(3)])?;
        let count = Some(means.shape()[0]);
        let quats = numbers::<f32>(quats, "quats", "float32", &[count, Some(4)])?;
        let scales = numbers::<f32>(scales, "scales", "float32", &[count, Some(3)])?;
        let opacities = numbers::<f32>(opacities, "opacities", "float32", &[count])?;
        let sh = sh.map(|sh| numbers::<f32>(sh, "sh", "float32", &[count, None, Some(3)])).transpose()?;
        let coefficients = sh.as_ref().map_or(1, |sh| sh.shape()[1]);
        let degree = (0..=MAX_SH_DEGREE).find(|degree| sh_coefficients(*degree) == coefficients);
        let degree = degree.ok_or_else(|| {
            let known: Vec<String> = (0..=MAX_SH_DEGREE).map(|degree| sh_coefficients(degree).to_string()).collect();
            let (last, others) = known.split_last().expect("there is a degree 0");
            let expected = format!("{} or {last}", others.join(", "));
            PyValueError::new_err(format!("sh: expected {expected} coefficients, found {coefficients}"))
        })?;
        Ok(Self { geometry: [means, quats, scales, opacities], sh, degree })
    }

    /// The values; without `sh` for a scene of features.
    fn view(&self) -> Arrays<'_> {
        let [means, rotations, scales, opacities] = self.geometry.each_ref().map(Numbers::values);
        Arrays {
            means: means.as_chunks().0,
            rotations: rotations.as_chunks().0,
            scales: scales.as_chunks().0,
            opacities,
            sh: self.sh.as_ref().map_or(&[], |sh| sh.values().as_chunks().0),
            sh_degree: self.degree,
        }
    }
}

/// Opacities that are taken. The builder clamps what rounding adds to the range from 0 to 1.
const OPACITIES: RangeInclusive<f32> = -1e-5..=1.0 + 1e-5;

/// The colours of the scene are the vectors of its rotations until it gets features: numbers of the size 1, by which
/// the two paths of the renderer can be compared, while features may be of any size.
fn scene_of_features(arrays: Arrays) -> PyResult<Scene> {
    let vector = |quat: &[f32; 4]| {
        let length = quat.iter().map(|v| v * v).sum::<f32>().sqrt().max(f32::MIN_POSITIVE);
        [1, 2, 3].map(|i| (quat[i] / length).clamp(-1.0, 1.0))
    };
    let vectors: Vec<_> = arrays.rotations.par_iter().map(vector).collect();
    let gaussians = gaussians(Arrays { sh: &vectors, ..arrays })?;
    let rows = (0..).zip(arrays.opacities).filter(|(_, opacity)| **opacity > 0.0).map(|(row, _)| row);
    let rows = Some(Rows::Some(Arc::new(rows.collect())));
    Ok(Scene { rows, ..Scene::of(SceneSource::of(gaussians)) })
}

fn gaussians(arrays: Arrays) -> PyResult<Gaussians> {
    let wrong = |what: &str, row: usize| Err(PyValueError::new_err(format!("{what} in row {row}")));
    if let Some(row) = arrays.scales.iter().position(|scale| scale.iter().any(|scale| *scale < 0.0)) {
        return wrong("scales: a standard deviation is negative", row);
    }
    if let Some(row) = arrays.opacities.iter().position(|opacity| !OPACITIES.contains(opacity)) {
        return wrong("opacities: a value is not from 0 to 1", row);
    }
    if let Some(row) = arrays.rotations.iter().position(|quat| *quat == [0.0; 4]) {
        return wrong("quats: the length is 0", row);
    }
    let (gaussians, report) = arrays.gaussians().map_err(|why| exception(why.into()))?;
    let unusable = report.dropped() - report.transparent;
    if unusable > 0 {
        return Err(PyValueError::new_err(format!("{unusable} Gaussians have values too large to be drawn")));
    }
    Ok(gaussians)
}

/// An array with one row per Gaussian.
fn rows<'py>(py: Python<'py>, values: &[f32], row: &[usize]) -> PyResult<Bound<'py, PyAny>> {
    let count = values.len() / row.iter().product::<usize>().max(1);
    let shape: Vec<usize> = std::iter::once(count).chain(row.iter().copied()).collect();
    Ok(PyArray1::from_slice(py, values).reshape(shape)?.into_any())
}
