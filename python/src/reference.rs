//! Pictures of the reference on the CPU.

use pyo3::prelude::*;
use pyo3::types::PyDict;
use smalto::rules::{Background, Order, Rules};

use crate::asked::Asked;
use crate::camera::Camera;
use crate::given::{Ground, given};
use crate::picture::{Content, Picture};
use crate::process::{check_process, interruptible};
use crate::scene::Scene;

/// The picture of the f64 reference on the CPU, by the rules of the preset and the knobs, exact; of the knobs that
/// trade accuracy, `sh_degree` alone counts. Takes seconds to minutes. Arguments are those of `Renderer` and `render`.
/// Errors: ValueError, also for scenes in page files.
#[pyfunction]
#[pyo3(
    signature = (scene, camera, *, preset = None, background = Ground::BLACK, **knobs),
    text_signature = "(scene, camera, *, preset='balanced', background=(0.0, 0.0, 0.0), **knobs)"
)]
pub fn reference(
    py: Python,
    scene: &Bound<PyAny>,
    camera: &Bound<PyAny>,
    preset: Option<&Bound<PyAny>>,
    background: Ground,
    knobs: Option<&Bound<PyDict>>,
) -> PyResult<Picture> {
    check_process()?;
    let scene: PyRef<Scene> = given(scene, "scene", "a Scene")?;
    let camera: Camera = given(camera, "camera", "a Camera")?;
    let asked = Asked::exact(preset, knobs)?;
    let background = background.background()?;
    scene.gaussians("reference")?;
    let options = asked.options(scene.source.is_antialiased);
    let rules = Rules { near: asked.near(&camera), ..options.rules };
    let source = scene.source.clone();
    interruptible(py, move |_| {
        let gaussians = source.gaussians().expect("the scene is in memory");
        let shortened = options.sh_degree < gaussians.sh_degree();
        let shortened = shortened.then(|| gaussians.clone().of_degree(options.sh_degree));
        let gaussians = shortened.as_ref().unwrap_or(gaussians);
        let rendering = smalto::reference::render(gaussians, &camera.camera, &rules, background);
        let depths = (rules.order != Order::PerPixel).then(|| rendering.depths());
        Picture {
            content: Content::Computed(rendering.to_pixels(), depths),
            is_transparent: background == Background::Transparent,
            certificate: None,
            timings: Vec::new(),
            visible: None,
        }
    })
}
