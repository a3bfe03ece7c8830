//! Small scenes and cameras, rendered on both paths and compared with the f64 reference.

use glam::{DVec3, dvec2};
use smalto::camera::Camera;
use smalto::options::Options;
use smalto::pixels::Pixels;
use smalto::reference::{self, Rendering};
use smalto::rules::Background;
use smalto::scene::{Gaussians, Raw};

use super::{Gpu, compare, difference};

pub const RED: [f32; 3] = [1.0, 0.0, 0.0];
pub const GREEN: [f32; 3] = [0.0, 1.0, 0.0];

/// Looks along z from the origin; `focal` px.
pub fn ahead(size: [u32; 2], focal: f64) -> Camera {
    let mut camera = Camera::looking_at(DVec3::ZERO, DVec3::Z, size, 1.0);
    camera.focal_px = dvec2(focal, focal);
    camera
}

/// A round Gaussian.
pub fn ball(mean: [f64; 3], scale: f64, opacity: f64) -> Raw {
    Raw { mean, log_scale: [scale.ln(); 3], rotation: [1.0, 0.0, 0.0, 0.0], opacity_logit: logit(opacity) }
}

pub fn logit(opacity: f64) -> f64 {
    (opacity / (1.0 - opacity)).ln()
}

/// The picture over black on the fastest path of the device, after both paths are checked.
pub fn render(scene: &Gaussians, camera: &Camera) -> Pixels {
    let [pixels, _] = render_by(&Options::EXACT, scene, camera);
    pixels
}

/// The pictures of the device's fastest path and of the portable path. All values are finite, all coverages in 0 to 1.
fn render_by(options: &Options, scene: &Gaussians, camera: &Camera) -> [Pixels; 2] {
    let gpu = Gpu::new();
    [options.portable, true].map(|portable| {
        let pixels = gpu.render(scene, camera, &Options { portable, ..*options });
        assert!(pixels.rgba.iter().flatten().all(|v| v.is_finite()), "every pixel is finite");
        assert!(pixels.rgba.iter().all(|p| (0.0..=1.0).contains(&p[3])), "coverage is a fraction");
        pixels
    })
}

/// The same picture in f64.
pub fn reference_of(scene: &Gaussians, camera: &Camera) -> Rendering {
    reference::render(scene, camera, &Options::EXACT.rules, Background::BLACK)
}

/// Renders on both paths. Pixels differ from the reference by rounding and by the doubt of the reference at most.
pub fn agrees(name: &str, scene: &Gaussians, camera: &Camera) -> Pixels {
    agrees_by(&Options::EXACT, name, scene, camera)
}

pub fn agrees_by(options: &Options, name: &str, scene: &Gaussians, camera: &Camera) -> Pixels {
    let exact = reference::render(scene, camera, &options.rules, Background::BLACK);
    let [pixels, portable] = render_by(options, scene, camera);
    for (path, pixels) in [("", &pixels), (", portable path", &portable)] {
        let comparison = compare(pixels, &exact);
        assert_eq!(comparison.unexplained, 0, "{name}{path}: {comparison:?}");
    }
    pixels
}

/// Renders on both paths. Pixels differ from the reference by `rounding` and by its doubt at most.
pub fn agrees_within(rounding: f64, name: &str, scene: &Gaussians, camera: &Camera) -> Pixels {
    let exact = reference_of(scene, camera);
    let [pixels, portable] = render_by(&Options::EXACT, scene, camera);
    for pixels in [&pixels, &portable] {
        for (index, pair) in pixels.rgba.iter().zip(&exact.pixels).enumerate() {
            assert!(difference(pair) <= rounding + pair.1.doubt, "{name}: pixel {index}: {pair:?}");
        }
    }
    pixels
}
