//! f-theta lenses with polynomials in pixels: those of gsplat, and of instant-ngp as a part of them.

use std::f64::consts::PI;

use anyhow::{Result, ensure};

use super::Lens;
use super::roots::{value, value_and_slope};

/// The parameters of gsplat's `FThetaCameraDistortionParameters`. instant-ngp's `ftheta_p0` to `ftheta_p4` are
/// `px_to_angle`, with `max_angle` pi / 2 and `linear` 1, 0, 0.
#[derive(Clone, Debug, PartialEq)]
pub struct FTheta {
    /// Radius in pixels as a polynomial of the angle in radians, from the constant term on.
    pub angle_to_px: [f64; 6],
    /// The way back.
    pub px_to_angle: [f64; 6],
    /// Which of the two is the lens: the other one approximates its inverse and may be all zero.
    pub is_px_to_angle: bool,
    /// Largest angle from the axis in radians.
    pub max_angle: f64,
    /// c, d, e of the picture (c x + d y, e x + y).
    pub linear: [f64; 3],
}

/// A lens whose parameters had lengths in pixels.
#[derive(Clone, Debug, PartialEq)]
pub struct InPixels {
    /// Both focal lengths, in pixels.
    pub focal_px: f64,
    /// The lens.
    pub lens: Lens,
    /// Largest distance in pixels between the two polynomials within the domain; 0 if only one is given.
    pub disagreement_px: f64,
}

/// Radii at which the two polynomials are compared.
const SAMPLES: u32 = 256;

impl Lens {
    /// An f-theta lens. Its focal lengths are the growth of the radius on the axis.
    ///
    /// # Errors
    /// If the polynomial does not begin at 0 and grow there, and those of [`Lens::named`].
    pub fn f_theta(given: &FTheta) -> Result<InPixels> {
        let FTheta { angle_to_px, px_to_angle, is_px_to_angle, max_angle, linear: [c, d, e] } = given;
        let (polynomial, other) = if *is_px_to_angle { (px_to_angle, angle_to_px) } else { (angle_to_px, px_to_angle) };
        let are_numbers = polynomial.iter().chain(other).all(|number| number.is_finite()) && !max_angle.is_nan();
        ensure!(are_numbers, "its parameters are not all numbers");
        ensure!(polynomial[0] == 0.0, "its polynomial {polynomial:?} is not 0 on the axis");
        ensure!(polynomial[1] > 0.0, "its polynomial {polynomial:?} does not grow on the axis");
        let focal_px = if *is_px_to_angle { 1.0 / polynomial[1] } else { polynomial[1] };
        // In units of the focal length.
        let in_focal = |power: usize| match is_px_to_angle {
            true => polynomial[power] * focal_px.powi(power as i32),
            false => polynomial[power] / focal_px,
        };
        let model = if *is_px_to_angle { "FTHETA_INVERSE" } else { "FTHETA" };
        let numbers = [in_focal(2), in_focal(3), in_focal(4), in_focal(5), max_angle.min(PI), *c, *d, *e];
        let lens = Self::named(model, &numbers)?.expect("an f-theta lens is no pinhole");
        // The other polynomial at points of the lens; its angles become pixels by the growth of the radius.
        let difference_px = |i: u32| {
            let radius = lens.base.radius * f64::from(i) / f64::from(SAMPLES);
            let (angle, radius_px) = (lens.base.angle_of(radius), radius * focal_px);
            match is_px_to_angle {
                true => (value(angle_to_px, angle) - radius_px).abs(),
                false => (value(px_to_angle, radius_px) - angle).abs() * value_and_slope(angle_to_px, angle)[1],
            }
        };
        let is_given = other.iter().any(|number| *number != 0.0);
        let disagreement_px = if is_given { (1..=SAMPLES).map(difference_px).fold(0.0, f64::max) } else { 0.0 };
        Ok(InPixels { focal_px, lens, disagreement_px })
    }
}
