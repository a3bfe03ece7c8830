//! What the tests share: a device whose every complaint fails the test, scenes, and the comparison with the reference.
#![allow(dead_code, reason = "each test file uses its own part")]

use std::path::PathBuf;

use smalto::camera::{self, Camera};
use smalto::environment::Environment;
use smalto::gpu::{Device, Validation};
use smalto::options::{Background, Options};
use smalto::pixels::Pixels;
use smalto::reference::{self, Rendering};
use smalto::render::{GpuScene, Still};
use smalto::scene::{self, Gaussians};

/// A device with validation on. A missing device fails the test; so does anything the validation layer or the
/// missing-barrier check says.
pub struct Gpu(pub Device);

impl Gpu {
    pub fn new() -> Self {
        let environment = Environment::read();
        let validation = environment.validation.unwrap_or(Validation::Required);
        Self(Device::open(&environment.device, validation).expect("GPU tests need a Vulkan device"))
    }

    pub fn render(&self, gaussians: &Gaussians, camera: &Camera, options: &Options) -> Pixels {
        let scene = GpuScene::new(&self.0, gaussians).expect("the scene fits");
        let mut still = Still::new(&self.0, options, &scene).expect("the renderer can be built");
        still.render(camera, Background::BLACK).expect("the frame can be rendered");
        still.pixels().expect("the picture can be read")
    }
}

impl Drop for Gpu {
    fn drop(&mut self) {
        if !std::thread::panicking() {
            assert_eq!(self.0.complaints(), Vec::<String>::new(), "the device has no complaints");
        }
    }
}

/// A captured scene of the folder `SMALTO_TEST_SCENES`, or of `../shared/scenes`.
pub fn captured(name: &str) -> Option<PathBuf> {
    let folder = std::env::var_os("SMALTO_TEST_SCENES").map_or_else(|| PathBuf::from("../shared/scenes"), PathBuf::from);
    let path = folder.join(name);
    if !path.exists() {
        eprintln!("not tested: {} is not here", path.display());
        return None;
    }
    Some(path)
}

pub fn read_captured(name: &str) -> Option<Gaussians> {
    Some(scene::read(&captured(name)?, &|_| {}).expect("a captured scene can be read").gaussians)
}

pub fn captured_cameras(name: &str, which: &[usize], size: [u32; 2]) -> Vec<Camera> {
    let file = captured(name).expect("a scene's cameras lie beside it");
    let cameras = camera::read(&file).expect("a captured scene's cameras can be read");
    which.iter().map(|i| cameras[*i].camera.resized(size)).collect()
}

/// How a GPU image compares with the reference.
#[derive(Debug)]
pub struct Comparison {
    pub psnr: f64,
    pub max_error: f32,
    /// Pixels that differ by more than [`ROUNDING`].
    pub different: usize,
    /// Those of them that differ by more than the doubt of the reference allows.
    pub unexplained: usize,
}

/// Largest difference that f32 arithmetic alone may make to a pixel whose decisions are not in doubt.
pub const ROUNDING: f64 = 1e-4;

pub fn compare(pixels: &Pixels, reference: &Rendering) -> Comparison {
    let exact = reference.to_pixels();
    let difference = |(a, b): (&[f32; 4], &reference::Pixel)| {
        (0..3).map(|i| (f64::from(a[i]) - b.colour[i]).abs()).fold(0.0, f64::max)
    };
    let pairs = || pixels.rgba.iter().zip(&reference.pixels);
    Comparison {
        psnr: smalto::metrics::psnr(pixels, &exact),
        max_error: smalto::metrics::max_error(pixels, &exact),
        different: pairs().filter(|p| !(difference(*p) <= ROUNDING)).count(),
        unexplained: pairs().filter(|p| !(difference(*p) <= ROUNDING + p.1.doubt)).count(),
    }
}
