//! The directions that a pixel covers: the low-pass of a lens.

use std::f64::consts::{PI, TAU};

use glam::{DMat2, DMat3, DVec2, DVec3};

use super::{Camera, Lens};

/// A pixel may cover at most as many times the width of a pixel on the axis.
const WIDEST: f64 = 4.0;
/// Rings and azimuths at which [`Footprints::of`] looks for wide pixels.
const RINGS: usize = 256;
const AZIMUTHS: usize = 16;

/// The covariances of directions that the lens of a camera maps to a covariance of 1 px^2 on the picture.
///
/// A scene that was trained with 0.3 px^2 of low-pass on the picture has 0.3 times as much in directions. Around a fold
/// the pixels of a lens cover ever more, and beyond it there is none, but Gaussians there may reach into the picture:
/// from the angle on at which a pixel is 4 times as wide as on the axis, footprints keep their size.
#[derive(Clone, Debug)]
pub struct Footprints<'a> {
    lens: &'a Lens,
    focal_px: DVec2,
    /// The largest angle from the axis whose pixels are measured, in radians.
    limit: f64,
}

/// Two directions across a direction: away from the axis, and around the axis.
fn frame(angle: f64, azimuth: DVec2) -> [DVec3; 2] {
    [(angle.cos() * azimuth).extend(-angle.sin()), azimuth.perp().extend(0.0)]
}

impl<'a> Footprints<'a> {
    /// Finds the directions that footprints are measured at. `None` for a pinhole.
    pub fn of(camera: &'a Camera) -> Option<Self> {
        let lens = camera.lens.as_deref()?;
        let mut footprints = Self { lens, focal_px: camera.focal_px, limit: 0.0 };
        let azimuths = (0..AZIMUTHS).map(|i| DVec2::from_angle(TAU * i as f64 / AZIMUTHS as f64));
        let at = |angle: f64| azimuths.clone().map(move |azimuth| (angle, azimuth));
        let width = |(angle, azimuth)| footprints.width(angle, azimuth);
        let on_axis = at(1e-6).map(width).fold(f64::NAN, f64::min);
        let angle_of = |ring: usize| lens.field().min(0.999 * PI) * ring as f64 / RINGS as f64;
        let is_measured = |ring: &usize| at(angle_of(*ring)).map(width).all(|width| width <= WIDEST * on_axis);
        let limit = (1..RINGS).take_while(is_measured).last().map_or(1e-6, angle_of);
        footprints.limit = limit;
        Some(footprints)
    }

    /// The covariance around a direction of any length, in view axes and squared radians, across the direction. Around
    /// the direction of a parallel lens, it is in squared world units across z.
    pub fn covariance(&self, direction: DVec3) -> DMat3 {
        if self.lens.is_parallel() {
            return DMat3::from_diagonal(self.focal_px.recip().powf(2.0).extend(0.0));
        }
        let across = direction.truncate();
        let azimuth = across.normalize_or(DVec2::X);
        let angle = across.length().atan2(direction.z);
        let [along, mixed, across] = self.in_frame(angle.min(self.limit), azimuth);
        let [out, around] = frame(angle, azimuth);
        let outer = |a: DVec3, b: DVec3| DMat3::from_cols(a * b.x, a * b.y, a * b.z);
        outer(out, out) * along + (outer(out, around) + outer(around, out)) * mixed + outer(around, around) * across
    }

    /// The largest angle from the axis whose pixels are measured, in radians. Beyond it footprints stay the same.
    pub fn limit(&self) -> f64 {
        self.limit
    }

    /// The covariance of a central lens at an angle from the axis, at most [`Footprints::limit`], and at an azimuth of
    /// length 1: variance away from the axis, covariance, variance around it, in squared radians.
    pub fn in_frame(&self, angle: f64, azimuth: DVec2) -> [f64; 3] {
        if self.lens.is_sphere() {
            // Columns near a pole repeat what others show: a pixel is as wide as its row is high.
            let variance = self.focal_px.y.powi(-2);
            return [variance, 0.0, variance];
        }
        let inverse = self.per_px(angle, azimuth).map_or(DMat2::NAN, |per_px| per_px.inverse());
        [inverse.x_axis.x, inverse.x_axis.y, inverse.y_axis.y]
    }

    /// J^T J of the map from directions to pixels, in the frame of a direction.
    fn per_px(&self, angle: f64, azimuth: DVec2) -> Option<DMat2> {
        let rows = self.lens.jacobian((angle.sin() * azimuth).extend(angle.cos()))?;
        let [out, around] = frame(angle, azimuth);
        let column = |axis: DVec3| DVec2::new(rows[0].dot(axis), rows[1].dot(axis)) * self.focal_px;
        let jacobian = DMat2::from_cols(column(out), column(around));
        Some(jacobian.transpose() * jacobian)
    }

    /// Largest width of a pixel in radians; infinite where there is none.
    fn width(&self, angle: f64, azimuth: DVec2) -> f64 {
        let Some(square) = self.per_px(angle, azimuth) else { return f64::INFINITY };
        let (half_sum, half_difference) =
            ((square.x_axis.x + square.y_axis.y) / 2.0, (square.x_axis.x - square.y_axis.y) / 2.0);
        (half_sum - half_difference.hypot(square.x_axis.y)).max(0.0).sqrt().recip()
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;

    fn camera(name: &str, parameters: &[f64]) -> Camera {
        let lens = Lens::named(name, parameters).unwrap().map(Arc::new);
        Camera {
            focal_px: DVec2::new(500.0, 520.0),
            lens,
            ..Camera::looking_at(DVec3::ZERO, DVec3::Z, [800, 600], 1.0)
        }
    }

    /// A pixel is moved by the covariance as by 1 px^2: J covariance J^T = I.
    #[test]
    fn footprints_are_one_pixel() {
        for (name, parameters) in
            [("OPENCV", vec![-0.1, 0.02, 0.002, -0.001]), ("OPENCV_FISHEYE", vec![-0.02, 0.004, -0.001, 0.0001])]
        {
            let camera = camera(name, &parameters);
            let footprints = Footprints::of(&camera).unwrap();
            for view in [DVec3::new(0.3, -0.4, 1.0), DVec3::new(0.0, 0.0, 2.0), DVec3::new(-0.5, 0.1, 0.8)] {
                let unit = view.normalize();
                let rows = camera.lens.as_ref().unwrap().jacobian(unit).unwrap();
                let rows = [rows[0] * camera.focal_px.x, rows[1] * camera.focal_px.y];
                let covariance = footprints.covariance(view);
                assert!((covariance * unit).length() < 1e-15, "it is across the direction");
                for (i, j, expected) in [(0, 0, 1.0), (0, 1, 0.0), (1, 1, 1.0)] {
                    assert!((rows[i].dot(covariance * rows[j]) - expected).abs() < 1e-9, "{name} {view}");
                }
            }
        }
    }

    #[test]
    fn footprints_keep_their_size_around_a_fold_and_behind() {
        // k1 -0.3 folds at slope 1.0541.
        let camera = camera("SIMPLE_RADIAL", &[-0.3]);
        let footprints = Footprints::of(&camera).unwrap();
        let at = |slope: f64| footprints.covariance(DVec3::new(slope, 0.0, 1.0));
        let widest = |covariance: DMat3| (covariance.x_axis.x + covariance.y_axis.y + covariance.z_axis.z).sqrt();
        assert!(footprints.limit < 1.0541_f64.atan() && widest(at(0.9)) > 1.5 * widest(at(0.0)));
        for slope in [1.05, 1.06, 5.0] {
            assert!((widest(at(slope)) - widest(at(1.04))).abs() < 1e-12, "{slope}");
        }
        assert!(widest(footprints.covariance(DVec3::NEG_Z)) < 5.0 / 500.0);
    }

    #[test]
    fn a_pixel_of_a_sphere_is_as_wide_as_high() {
        let [focal_px, centre_px] = Lens::sphere_px(DVec2::new(400.0, 200.0));
        let camera = Camera { focal_px, centre_px, ..camera("EQUIRECTANGULAR", &[]) };
        let covariance = Footprints::of(&camera).unwrap().covariance(DVec3::Y);
        let expected = (PI / 200.0).powi(2);
        assert!((covariance.x_axis.x - expected).abs() < 1e-15 && (covariance.z_axis.z - expected).abs() < 1e-15);
    }
}
