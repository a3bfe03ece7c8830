//! Lenses: where the plane of a picture sees a direction, its derivatives, the way back, and the domain, in f64.
//!
//! - `base` - the bases: slope, angle, field of view, division, EUCM, sphere, parallel, f-theta polynomials
//! - `planar` - the map of the plane, its fold, and its inverse
//! - `models` - the models of files by name, with the meaning of their parameters
//! - `f_theta` - f-theta lenses with polynomials in pixels
//! - `roots` - roots of polynomials
//! - `tests` - all models against their inverse, differences, known values, and random coefficients

mod base;
mod f_theta;
mod models;
mod planar;
mod roots;
#[cfg(test)]
mod tests;

use std::f64::consts::{FRAC_PI_2, PI};

use glam::{DMat2, DVec2, DVec3};

use self::base::{Base, Factor, Shape};
pub use self::f_theta::{FTheta, InPixels};
use self::planar::Planar;

/// The lens of a camera: a map from points in view axes (x right, y down, z forward) to *plane coordinates*.
///
/// Plane coordinates are pixels minus the principal point, divided by the focal lengths, which stay in
/// [`Camera`](super::Camera). So a lens does not depend on the size of a picture. A pinhole has no lens: its plane
/// coordinates are the slopes (x / z, y / z). Of a sphere they are azimuth and elevation in radians, with the focal
/// lengths width / 2 pi and height / pi; of a parallel lens x and y in world units, with focal lengths in pixels per
/// world unit.
///
/// ```text
/// b     = base(x, y, z)     a radius that depends on the angle from the axis alone
/// d     = planar(b)         radial, tangential and thin prism distortion
/// plane = skew d            a 2x2 matrix
/// ```
///
/// The domain of a central lens is a cone around the axis, in which the map is one-to-one. It ends where the base does,
/// or before, at the *fold*. With tangential and prism terms the true fold is no circle, and the cone lies within.
///
/// Formulas: COLMAP (`src/colmap/sensor/models.h`), the documentation of OpenCV (`calib3d`: camera calibration,
/// fisheye), and Agisoft Metashape's manual (appendix "Camera models"). Kannala and Brandt, "A generic camera model and
/// calibration method for conventional, wide-angle, and fish-eye lenses", 2006. Devernay and Faugeras, "Straight lines
/// have to be straight", 2001. Fitzgibbon, "Simultaneous linear estimation of multiple view geometry and lens
/// distortion", 2001. Khomutenko, Garcia and Martinet, "An enhanced unified camera model", 2016.
#[derive(Clone, Debug, PartialEq)]
pub struct Lens {
    model: &'static str,
    parameters: Vec<f64>,
    base: Base,
    planar: Planar,
    skew: DMat2,
    /// The domain: the radius of a disc in the plane of the base, and its angle from the axis.
    radius: f64,
    field: f64,
}

impl Lens {
    /// A lens with its domain: where the base has not ended and the map of the plane is one-to-one.
    fn new(model: &'static str, parameters: &[f64], (base, planar, skew): (Base, Planar, DMat2)) -> Self {
        let radius = planar.fold(base.radius);
        let field = match base.shape {
            Shape::Sphere => PI,
            Shape::Parallel => FRAC_PI_2,
            _ if radius < base.radius => base.angle_of(radius),
            _ => base.angle,
        };
        Self { model, parameters: parameters.to_vec(), base, planar, skew, radius, field }
    }

    /// Name of the model. With [`Lens::parameters`], [`Lens::named`] makes the same lens of it, bit for bit.
    pub fn model(&self) -> &'static str {
        self.model
    }

    /// The numbers of the model, in the order of [`Lens::parameter_names`].
    pub fn parameters(&self) -> &[f64] {
        &self.parameters
    }

    /// The largest angle from the axis that the lens sees, in radians: pi for a sphere, pi / 2 for a parallel lens. A
    /// central lens sees exactly the directions below this angle.
    pub fn field(&self) -> f64 {
        self.field
    }

    /// True if the lens ends before its base does: directions beyond [`Lens::field`] would be mapped into the picture a
    /// second time.
    pub fn folds(&self) -> bool {
        self.radius < self.base.radius
    }

    /// True if the rays of the lens are parallel, with plane coordinates in world units.
    pub fn is_parallel(&self) -> bool {
        self.base.shape == Shape::Parallel
    }

    /// True if the lens sees all directions: plane coordinates are azimuth and elevation in radians.
    pub fn is_sphere(&self) -> bool {
        self.base.shape == Shape::Sphere
    }

    /// Focal lengths and principal point, in pixels, with which a sphere fills a picture of this size.
    pub fn sphere_px(size_px: DVec2) -> [DVec2; 2] {
        [size_px / DVec2::new(2.0 * PI, PI), size_px / 2.0]
    }

    /// Plane coordinates of a point in view axes, at any distance. `None` outside the domain.
    pub fn plane(&self, view: DVec3) -> Option<DVec2> {
        let plane = match self.base.shape {
            Shape::Sphere => {
                let across = self.beside_the_poles(view)?;
                DVec2::new(view.x.atan2(view.z), view.y.atan2(across))
            }
            Shape::Parallel => (view.z > 0.0).then_some(view.truncate())?,
            _ => self.skew * self.planar.map(self.factor(view)?.h * view.truncate()).0,
        };
        Some(plane).filter(|plane| plane.is_finite())
    }

    /// The derivatives of [`Lens::plane`] by the point: the row of each plane coordinate. `None` outside the domain.
    pub fn jacobian(&self, view: DVec3) -> Option<[DVec3; 2]> {
        let DVec3 { x, y, z } = view;
        let rows = match self.base.shape {
            Shape::Sphere => {
                let across = self.beside_the_poles(view)?;
                let (a2, n2) = (across * across, view.length_squared());
                let below = DVec3::new(-x * y / across, across, -y * z / across);
                [DVec3::new(z, 0.0, -x) / a2, below / n2]
            }
            Shape::Parallel => (z > 0.0).then_some([DVec3::X, DVec3::Y])?,
            _ => {
                let Factor { h, by_square, by_z } = self.factor(view)?;
                let mixed = 2.0 * x * y * by_square;
                let base = [
                    DVec3::new(h + 2.0 * x * x * by_square, mixed, x * by_z),
                    DVec3::new(mixed, h + 2.0 * y * y * by_square, y * by_z),
                ];
                let map = self.skew * self.planar.map(h * view.truncate()).1;
                [0, 1].map(|i| map.row(i).x * base[0] + map.row(i).y * base[1])
            }
        };
        Some(rows).filter(|rows| rows.iter().all(|row| row.is_finite()))
    }

    /// The direction that is seen at a place in plane coordinates, in view axes, unit length: forward for a parallel
    /// lens. `None` if nothing is seen there.
    pub fn direction(&self, plane: DVec2) -> Option<DVec3> {
        match self.base.shape {
            Shape::Sphere => {
                let DVec2 { x: azimuth, y: elevation } = plane;
                let is_inside = azimuth.abs() <= PI && elevation.abs() <= FRAC_PI_2;
                let across = DVec2::new(azimuth.sin(), azimuth.cos()) * elevation.cos();
                is_inside.then_some(DVec3::new(across.x, elevation.sin(), across.y))
            }
            Shape::Parallel => plane.is_finite().then_some(DVec3::Z),
            _ => Some(self.base.direction(self.planar.inverse(self.skew.inverse() * plane, self.radius)?)),
        }
    }

    /// The map of the base at a point of the domain of a central lens.
    fn factor(&self, view: DVec3) -> Option<Factor> {
        let square = view.truncate().length_squared();
        (square.sqrt().atan2(view.z) < self.field).then(|| self.base.factor(square, view.z))
    }

    /// The distance of a point from the axis through the poles of a sphere, unless the point lies on it.
    fn beside_the_poles(&self, view: DVec3) -> Option<f64> {
        let across = view.x.hypot(view.z);
        (across > 1e-12 * view.length()).then_some(across)
    }
}
