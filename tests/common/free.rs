//! Scenes as lists of raw Gaussians that tests change, and their pictures.

use glam::{DQuat, DVec3};
use smalto::camera::Camera;
use smalto::options::Options;
use smalto::pixels::Pixels;
use smalto::procedural::cactus;
use smalto::scene::{Builder, Gaussians, Raw, sh_coefficients};

use super::{Gpu, Random};

pub const SIZE: [u32; 2] = [112, 80];

pub fn camera() -> Camera {
    Camera::looking_at(DVec3::new(1.5, -2.5, -4.0), DVec3::new(0.0, -1.2, 0.0), SIZE, 0.9)
}

/// A Gaussian that tests change: raw values and SH coefficients.
#[derive(Clone)]
pub struct Free {
    pub raw: Raw,
    pub sh: Vec<[f32; 3]>,
}

pub fn free(gaussians: &Gaussians) -> Vec<Free> {
    let one = |i: usize| {
        let opacity = f64::from(gaussians.opacities()[i]);
        let raw = Raw {
            mean: gaussians.means()[i].map(f64::from),
            log_scale: gaussians.scales()[i].map(|s| f64::from(s).ln()),
            rotation: gaussians.rotations()[i].map(f64::from),
            opacity_logit: (opacity / (1.0 - opacity)).ln(),
        };
        Free { raw, sh: gaussians.sh(i).to_vec() }
    };
    (0..gaussians.len()).map(one).collect()
}

pub fn build(free: &[Free], degree: u32) -> Gaussians {
    let mut builder = Builder::new(degree, free.len()).unwrap();
    builder.extend(free.len(), |i, sh| {
        sh.copy_from_slice(&free[i].sh[..sh_coefficients(degree)]);
        free[i].raw
    });
    builder.finish().0
}

/// A cactus with random coefficients of degree 4, too.
pub fn of_degree_4(count: usize) -> Vec<Free> {
    let (mut all, mut random) = (free(&cactus(count).unwrap().gaussians), Random(4));
    for one in &mut all {
        one.sh.resize_with(sh_coefficients(4), || std::array::from_fn(|_| random.between(-0.3, 0.3) as f32));
    }
    all
}

pub fn scene() -> Vec<Free> {
    free(&cactus(3000).unwrap().gaussians)
}

/// The Gaussians turned about the origin by `turn`, then moved by `shift`.
pub fn moved(scene: &[Free], turn: DQuat, shift: DVec3) -> Vec<Free> {
    let moved = |free: &Free| {
        let [w, x, y, z] = free.raw.rotation;
        let q = turn * DQuat::from_xyzw(x, y, z, w);
        let mean = (turn * DVec3::from(free.raw.mean) + shift).to_array();
        Free { raw: Raw { mean, rotation: [q.w, q.x, q.y, q.z], ..free.raw }, sh: free.sh.clone() }
    };
    scene.iter().map(moved).collect()
}

pub fn render(scene: &[Free]) -> Pixels {
    render_from(scene, &camera())
}

pub fn render_from(scene: &[Free], camera: &Camera) -> Pixels {
    Gpu::new().render(&build(scene, 3), camera, &Options::EXACT)
}
