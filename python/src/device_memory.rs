//! Memory of the device that CUDA opens: pixels of pictures, features, and arrays of Gaussians, from which renderers draw.

use std::sync::{Arc, Mutex};

use anyhow::Result;
use pyo3::prelude::*;
use smalto::gpu::{Device, Handle};
use smalto::render::{self, Features, HostFrame, HostNeeded, Upload};
use smalto::scene::{MAX_SH_DEGREE, sh_coefficients};

use crate::errors::exception;
use crate::process::lock;
use crate::renderer::{Inner, Rows};

/// Memory of the device that holds the pixels of one picture, and opens in CUDA.
#[pyclass(module = "smalto", frozen)]
pub struct Exported(pub Arc<Mutex<HostFrame>>);

#[pymethods]
impl Exported {
    #[new]
    fn new() -> Self {
        Self(Arc::default())
    }

    /// File descriptors and sizes in bytes: of color and alpha, then of the depths. They are there after the first
    /// picture, and hold until one of another size or with other depths. The caller owns the files.
    fn handles(&self) -> PyResult<Vec<(i32, u64)>> {
        let handles = lock(&self.0).handles().map_err(exception)?;
        Ok(handles.into_iter().map(|Handle { file, bytes }| (file, bytes)).collect())
    }
}

/// Up to three channels of features of a scene, on the device of its renderer.
#[pyclass(module = "smalto", frozen)]
pub struct Channels(pub Features);

#[pymethods]
impl Channels {
    /// A file descriptor, which the caller owns, and the size in bytes.
    fn handle(&self) -> PyResult<(i32, u64)> {
        let Handle { file, bytes } = self.0.export().map_err(exception)?;
        Ok((file, bytes))
    }
}

/// Memory of the device for arrays of Gaussians, which CUDA opens.
#[pyclass(module = "smalto", frozen)]
pub struct DeviceArrays(pub Arc<Mutex<render::DeviceArrays>>);

#[pymethods]
impl DeviceArrays {
    /// A file descriptor, which the caller owns, and the size in bytes.
    fn handle(&self) -> PyResult<(i32, u64)> {
        let Handle { file, bytes } = lock(&self.0).export().map_err(exception)?;
        Ok((file, bytes))
    }

    /// Where the means, quats, scales, opacities and spherical harmonics begin and end, in numbers of 4 bytes.
    fn parts(&self) -> Vec<(usize, usize)> {
        lock(&self.0).parts().into_iter().map(|part| (part.start, part.end)).collect()
    }
}

impl DeviceArrays {
    /// Memory for `count` Gaussians with this many coefficients.
    pub fn new(device: &Device, count: usize, coefficients: usize) -> Result<Self> {
        let degree = (0..=MAX_SH_DEGREE).find(|degree| sh_coefficients(*degree) == coefficients);
        let degree = degree.expect("the caller checked the coefficients");
        Ok(Self(Arc::new(Mutex::new(render::DeviceArrays::exportable(device, count, degree)?))))
    }
}

impl Inner {
    /// Draws the Gaussians of these arrays from now on; those of features get their colours later. Returns the reason if
    /// the host is needed; then what was drawn before may be gone.
    pub fn take(
        &mut self,
        arrays: &mut render::DeviceArrays,
        has_features: bool,
        is_antialiased: bool,
    ) -> Result<Option<HostNeeded>> {
        let near = self.near();
        let before = self.options();
        let options = self.options_of(is_antialiased, has_features);
        let upload = Upload { is_certifiable: self.is_certified, ..Upload::default() };
        let mut own = options;
        own.rules.near = near;
        let examination = match arrays.examine(&own, upload)? {
            Ok(examination) => examination,
            Err(why) => return Ok(Some(why)),
        };
        // Views that are on the device may be drawn again, and need their scene.
        let is_idle = self.drawing.as_ref().is_none_or(|drawing| Arc::strong_count(drawing) == 1);
        let spare = self.scene.take().filter(|scene| is_idle && examination.fits(scene));
        let kept = self.drawing.take().filter(|_| spare.is_some() && options == before);
        let scene = match arrays.pack(&examination, spare, upload)? {
            Ok(scene) => scene,
            Err(why) => return Ok(Some(why)),
        };
        (self.source, self.is_antialiased) = (None, is_antialiased);
        self.rows = has_features.then_some(Rows::All);
        self.drawing = kept.filter(|drawing| lock(drawing).stream.renderer().replace_scene(&scene));
        self.scene = Some(scene);
        self.drawing(near)?;
        Ok(None)
    }
}
