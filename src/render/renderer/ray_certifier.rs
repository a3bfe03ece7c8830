//! Certificates of pictures against the response along rays, whatever drew them.

use anyhow::{Result, ensure};

use super::Renderer;
use crate::camera::Camera;
use crate::gpu::Device;
use crate::options::Options;
use crate::pixels::Pixels;
use crate::render::GpuScene;
use crate::rules::{Background, Response, Rules};

/// Bounds the distance of pictures from the complete sum along rays of a scene, so that the error of their projection
/// is bounded, too: by the distance from a picture along rays, and the bound of that.
pub struct RayCertifier(Renderer);

impl RayCertifier {
    /// Builds a certified renderer along rays. `scene` is uploaded for certificates:
    /// [`Upload::is_certifiable`](crate::render::Upload::is_certifiable).
    ///
    /// # Errors
    /// If pictures with these options have no certificate: [`Options::uncertifiable`].
    pub fn new(device: &Device, options: &Options, scene: &GpuScene) -> Result<Self> {
        let rules = Rules { response: Response::Ray, ..options.rules };
        Ok(Self(Renderer::certified(device, &Options { rules, ..*options }, scene)?))
    }

    /// The certificate of a picture, as [`Renderer::certificate`], against the complete sum along rays in the order of
    /// the distance.
    ///
    /// # Errors
    /// If rays do not see the scene, the picture has another size, memory runs out or the device is lost.
    pub fn certificate(&mut self, picture: &Pixels, camera: &Camera, background: Background) -> Result<Pixels> {
        ensure!(picture.size == camera.size_px, "a picture is certified by its own camera");
        self.0.render(camera, background)?;
        let along_rays = self.0.pixels()?;
        let mut certificate = self.0.certificate()?.expect("the renderer is certified");
        for ((pixel, other), bound) in picture.rgba.iter().zip(&along_rays.rgba).zip(&mut certificate.rgba) {
            let apart = |i: usize| (f64::from(pixel[i]) - f64::from(other[i])).abs();
            let sum = f64::from(bound[0]) + [0, 1, 2].map(apart).into_iter().fold(0.0, largest);
            bound[..3].fill(rounded_up(sum));
        }
        Ok(certificate)
    }
}

/// The larger number, infinite for NaN.
fn largest(a: f64, b: f64) -> f64 {
    if b.is_nan() { f64::INFINITY } else { a.max(b) }
}

fn rounded_up(value: f64) -> f32 {
    let near = value as f32;
    if f64::from(near) < value { near.next_up() } else { near }
}
