//! Gaussians as the rays of a lens meet them: the exact response along each ray.
//!
//! A ray sees a Gaussian with its greatest value along the ray. For a central lens, let v be the mean in view axes, r
//! its distance, n = v / r, and e1, e2 any two unit vectors across n and each other. With M = W R S / r (rotation into
//! view axes, rotation and scales of the Gaussian) and its rows m1, m2, m3 in the frame (e1, e2, n):
//!
//! ```text
//! A' = (mi . mj) + 0.3 F               2x2; F: the footprint of a pixel at v in the frame, squared radians per px^2
//! gamma = A'^-1 (m1 . m3, m2 . m3)
//! kappa = |m3 - gamma1 m1 - gamma2 m2|^2 + 0.3 gamma . F gamma
//! P = L^T (e1; e2) with L L^T = A'^-1  2x3
//! q = n - gamma1 e1 - gamma2 e2
//!
//! s = P (d - n), w = q . d = 1 + q . (d - n)         of a ray d of unit length
//! distance^2 = |s|^2 / (w^2 + kappa |s|^2)           where w > 0; elsewhere the Gaussian is not met
//! ```
//!
//! In units of r, A' is the covariance across n with the low-pass, and kappa the variance along n for a fixed place
//! across n. The greatest value lies before the camera if w > 0, behind it otherwise. The rays whose distance^2 is a
//! level or less are the cone `|s|^2 (1 - kappa level) <= level w^2`, w > 0; if kappa level is 1 or more, the camera is
//! inside of the Gaussian's ellipsoid of that level, and the cone is the half space w > 0. P depends on the choice of
//! e1, e2 and L; P^T P does not.
//!
//! For a parallel lens the ray along z through (x, y) is d = (x, y, 1), n is the ray through the mean, e1 and e2 are
//! the x and y axes, M is not divided by r, and F is in squared world units. The value along a ray does not depend on
//! where the ray begins: gamma = 0, kappa = 0, q = (0, 0, 1). This is EWA splatting, which is exact for parallel rays.

use glam::{DMat2, DVec2, DVec3};

use super::project::{axes, colour, compensation, level};
use crate::camera::{Camera, Footprints};
use crate::rules::{Footprint, LOW_PASS, Rules};
use crate::scene::Gaussians;

/// A Gaussian as the rays of a lens meet it.
///
/// Of a ray d, s = P (d - n) and w = 1 + q . (d - n). Where w > 0, the squared distance of the Gaussian's greatest
/// value along the ray is |s|^2 / (w^2 + kappa |s|^2); elsewhere the ray does not meet the Gaussian.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RaySplat {
    /// n: the ray through the mean.
    pub centre: DVec3,
    /// The rows of P, in view axes.
    pub p: [DVec3; 2],
    /// In view axes.
    pub q: DVec3,
    /// Variance along n for a fixed place across n, in units of the squared distance of the mean.
    pub kappa: f64,
    /// After the compensation for the low-pass, if the rules ask for it.
    pub opacity: f64,
    /// Red, green, blue from this direction, at least 0; features of any sign if the rules say so.
    pub colour: DVec3,
    /// [`Camera::depth`] of the mean, world units: the sort key in every order but the one per pixel.
    pub depth: f64,
}

/// The box around some rays, in view axes.
#[derive(Clone, Copy, Debug)]
pub(super) struct RayBox {
    pub middle: DVec3,
    /// Half of the side lengths.
    pub half: DVec3,
}

impl RayBox {
    /// The box of these rays. `None` if there are none.
    pub fn of(rays: impl Iterator<Item = DVec3>) -> Option<Self> {
        let corners = rays.map(|ray| (ray, ray)).reduce(|a, b| (a.0.min(b.0), a.1.max(b.1)));
        corners.map(|(low, high)| Self { middle: (low + high) / 2.0, half: (high - low) / 2.0 })
    }
}

/// Part of the numbers of a test of a box that rounding may change.
const SLACK: f64 = 1e-9;

impl RaySplat {
    /// s and w of a ray.
    fn s_and_w(&self, ray: DVec3) -> (DVec2, f64) {
        let aside = ray - self.centre;
        (DVec2::new(self.p[0].dot(aside), self.p[1].dot(aside)), 1.0 + self.q.dot(aside))
    }

    /// Squared Mahalanobis distance of a ray: infinite if it does not meet the Gaussian.
    pub fn distance(&self, ray: DVec3) -> f64 {
        let (s, w) = self.s_and_w(ray);
        if w > 0.0 { s.length_squared() / (w * w + self.kappa * s.length_squared()) } else { f64::INFINITY }
    }

    /// Squared Mahalanobis distance at which alpha falls to the threshold, or at which the rules cut the splat: for a
    /// lens, squares are the ellipses within.
    pub fn level(&self, rules: &Rules) -> f64 {
        level(self.opacity, rules, rules.extent != Footprint::Exact)
    }

    /// True if a ray of the box may have a squared distance of `level` or less. False is certain.
    pub(super) fn may_reach(&self, rays: &RayBox, level: f64) -> bool {
        // If a linear function of the ray is 0 or less somewhere in the box: by its gradient and value in the middle.
        let falls_to_zero = |gradient: DVec3, value: f64| {
            value <= gradient.abs().dot(rays.half) + SLACK * (1.0 + gradient.length() + value.abs())
        };
        let (s, w) = self.s_and_w(rays.middle);
        if level.is_nan() || level < 0.0 || !falls_to_zero(self.q, -w) {
            return false;
        }
        // The cone is |s| <= t w. A plane that touches it on the side of s may separate it from the box.
        let inside = 1.0 - self.kappa * level;
        if inside <= 0.0 {
            return true;
        }
        let t = (level / inside).sqrt();
        let side = s.normalize_or_zero();
        falls_to_zero(side.x * self.p[0] + side.y * self.p[1] - t * self.q, s.length() - t * w)
    }

    /// Change of a ray that rounding to f32 is equal to: a few times 2^-24 of its size.
    fn shift(&self, ray: DVec3) -> f64 {
        4.0 * 0.5_f64.powi(24) * ((ray - self.centre).abs().max_element() + ray.abs().max_element())
    }

    /// At least |ds| / |dd|.
    fn steepest(&self) -> f64 {
        (self.p[0].length_squared() + self.p[1].length_squared()).sqrt()
    }

    /// True if rounding to f32 may give w the other sign: of the ray, and of q, whose rounding grows with the quotient
    /// of the extents along n and across it.
    pub(super) fn is_edge_in_doubt(&self, ray: DVec3) -> bool {
        let (_, w) = self.s_and_w(ray);
        w.abs() < self.shift(ray) * (self.q.length() + self.steepest() * (1.0 + self.kappa.sqrt()))
    }

    /// Relative error of a weight from rounding rays to f32.
    pub(super) fn weight_doubt(&self, ray: DVec3) -> f64 {
        let (s, w) = self.s_and_w(ray);
        if w <= 0.0 {
            return 0.0;
        }
        let (shift, steepest) = (self.shift(ray), self.steepest());
        // The derivatives of distance^2 / 2 by |s| and by w.
        let below = w * w + self.kappa * s.length_squared();
        s.length() * w * (w * steepest + s.length() * self.q.length()) / (below * below) * shift
    }
}

/// Gaussian `id`, whose mean must have a positive [depth](Camera::depth), as the rays of the camera's lens meet it.
/// `footprints` are those of the camera.
pub fn ray_splat(gaussians: &Gaussians, id: u32, camera: &Camera, footprints: &Footprints, rules: &Rules) -> RaySplat {
    let index = id as usize;
    let mean_world = DVec3::from(gaussians.means()[index].map(f64::from));
    let mean_view = camera.view(mean_world);
    let is_parallel = camera.is_parallel();
    let (centre, e, unit) = if is_parallel {
        (mean_view.truncate().extend(1.0), [DVec3::X, DVec3::Y, DVec3::ZERO], 1.0)
    } else {
        let unit = mean_view.length();
        let n = mean_view / unit;
        let (e1, e2) = n.any_orthonormal_pair();
        (n, [e1, e2, n], unit)
    };

    // Along the rays of a parallel lens, m3 = 0 makes gamma and kappa 0.
    let view_axes = axes(gaussians, index, camera) * unit.recip();
    let [m1, m2, m3] = e.map(|axis| view_axes.transpose() * axis);
    let footprint = footprints.covariance(mean_view);
    let entry = |i: usize, j: usize| LOW_PASS * e[i].dot(footprint * e[j]);
    let low_pass = DMat2::from_cols_array(&[entry(0, 0), entry(0, 1), entry(0, 1), entry(1, 1)]);
    let adjugate = DMat2::from_cols_array(&[entry(1, 1), -entry(0, 1), -entry(0, 1), entry(0, 0)]);

    // det A' and adj(A') b, computed without cancellation (Cauchy-Binet).
    let across = m1.cross(m2);
    let mixed = entry(1, 1) * m1.dot(m1) - 2.0 * entry(0, 1) * m1.dot(m2) + entry(0, 0) * m2.dot(m2);
    let determinant = across.length_squared() + mixed + low_pass.determinant();
    let b = DVec2::new(m1.dot(m3), m2.dot(m3));
    let crossed = DVec2::new(-across.dot(m2.cross(m3)), across.dot(m1.cross(m3)));
    let gamma = (crossed + adjugate * b) / determinant;
    let kappa = (m3 - gamma.x * m1 - gamma.y * m2).length_squared() + gamma.dot(low_pass * gamma);

    // The lower triangle L.
    let (covariance, variance) = (m1.dot(m2) + entry(0, 1), m2.dot(m2) + entry(1, 1));
    let p1 = (variance / determinant).sqrt() * e[0] - covariance / (variance * determinant).sqrt() * e[1];
    let p2 = variance.sqrt().recip() * e[1];

    RaySplat {
        centre,
        p: [p1, p2],
        q: if is_parallel { DVec3::Z } else { centre - gamma.x * e[0] - gamma.y * e[1] },
        kappa,
        opacity: f64::from(gaussians.opacities()[index]) * compensation(across.length_squared(), determinant, rules),
        colour: colour(gaussians, index, mean_world - camera.position, rules),
        depth: camera.depth(mean_view),
    }
}
