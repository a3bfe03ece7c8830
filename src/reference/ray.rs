//! Depth at which a Gaussian is densest along the ray of a pixel: the ideal sort key (StopThePop, Radl et al. 2024).

use glam::{DMat3, DQuat, DVec2, DVec3};
use rayon::prelude::*;

use crate::camera::Camera;
use crate::scene::Gaussians;

/// Gaussians prepared for [`Rays::depth`].
pub struct Rays {
    camera: Camera,
    whitened: Vec<Whitened>,
}

/// A Gaussian in coordinates in which it is the unit sphere.
struct Whitened {
    /// From view axes to these coordinates.
    from_view: DMat3,
    /// The mean, relative to the camera.
    mean: DVec3,
}

/// Smallest standard deviation of a Gaussian, as a part of its largest.
const FLATTEST: f64 = 1e-6;

impl Rays {
    /// Prepares the Gaussians `ids`; a splat id is an index into them.
    pub fn new(gaussians: &Gaussians, ids: &[u32], camera: &Camera) -> Self {
        let whitened = |id: &u32| {
            let index = *id as usize;
            let [w, x, y, z] = gaussians.rotations()[index].map(f64::from);
            let rotation = DMat3::from_quat(DQuat::from_xyzw(x, y, z, w).normalize());
            let scale = DVec3::from(gaussians.scales()[index].map(f64::from));
            let scale = scale.max(DVec3::splat(FLATTEST * scale.max_element())).max(DVec3::splat(f64::MIN_POSITIVE));
            let from_view = DMat3::from_diagonal(scale.recip()) * (camera.rotation * rotation).transpose();
            let mean = from_view * camera.view(DVec3::from(gaussians.means()[index].map(f64::from)));
            Whitened { from_view, mean }
        };
        Self { camera: camera.clone(), whitened: ids.par_iter().map(whitened).collect() }
    }

    /// The ray through a point of the image, if there is one: [`Camera::ray`].
    pub fn ray(&self, point_px: DVec2) -> Option<DVec3> {
        self.camera.ray(point_px)
    }

    /// Depth at which splat `id` is densest along a ray, at least 0: view depth for a pinhole and for a parallel lens,
    /// distance for other lenses.
    pub fn depth(&self, id: u32, ray: DVec3) -> f64 {
        let Whitened { from_view, mean } = &self.whitened[id as usize];
        let (origin, direction) =
            if self.camera.is_parallel() { (ray - DVec3::Z, DVec3::Z) } else { (DVec3::ZERO, ray) };
        let direction = *from_view * direction;
        (direction.dot(*mean - *from_view * origin) / direction.length_squared()).max(0.0)
    }
}
