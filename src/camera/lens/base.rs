//! Bases of lenses: maps from the angle to the axis to a radius in the plane, without distortion of the plane.

use std::f64::consts::PI;

use glam::{DVec2, DVec3};

use super::roots::{bisected, derivative, first_root, solved, value, value_and_slope};

/// Radii beyond this one, in focal lengths, belong to no picture: of a slope, 1e-6 radians before 90 degrees.
const LARGEST_RADIUS: f64 = 1e6;

/// Below this squared slope, the series of the arc tangent is used. Ten of its terms are then exact to the last bit,
/// and above it the difference of two close numbers loses two digits.
const SERIES_BELOW: f64 = 1e-2;

/// The kind of a base. R is the radius in the plane, theta the angle from the axis.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Shape {
    /// R = tan theta
    Slope,
    /// R = theta
    Angle,
    /// R = atan(2 tan theta tan(omega / 2)) / omega, by Devernay and Faugeras. Number: omega.
    Fov,
    /// tan theta = R / (1 + k R^2), by Fitzgibbon. Number: k.
    Division,
    /// R = rho / (alpha sqrt(beta rho^2 + z^2) + (1 - alpha) z), by Khomutenko. Numbers: alpha, beta.
    Eucm,
    /// Azimuth and elevation in radians.
    Sphere,
    /// x and y in world units.
    Parallel,
    /// R = theta + c2 theta^2 + ... + c5 theta^5. Numbers: c2 to c5.
    Polynomial,
    /// theta = R + c2 R^2 + ... + c5 R^5. Numbers: c2 to c5.
    Inverse,
}

/// A base with its numbers and its end.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Base {
    pub shape: Shape,
    pub numbers: [f64; 4],
    /// Radius and angle at which the base ends: where it turns back, or where the angle is 180 degrees.
    pub radius: f64,
    pub angle: f64,
}

/// `b = h (x, y)` of a point (x, y, z) in view axes, as h and its derivatives by x^2 + y^2 and by z.
#[derive(Clone, Copy)]
pub(super) struct Factor {
    pub h: f64,
    pub by_square: f64,
    pub by_z: f64,
}

impl Base {
    /// A base that sees up to `largest_angle` at most.
    pub fn new(shape: Shape, numbers: &[f64], largest_angle: f64) -> Self {
        let numbers: [f64; 4] = std::array::from_fn(|i| numbers.get(i).copied().unwrap_or(0.0));
        let mut base = Self { shape, numbers, radius: LARGEST_RADIUS, angle: largest_angle.min(PI) };
        let (growth, [a, b, ..]) = (derivative(&base.polynomial()), numbers);
        base.radius = match shape {
            Shape::Angle => PI,
            Shape::Fov => PI / a,
            Shape::Division if a > 0.0 => 1.0 / a.sqrt(),
            Shape::Inverse => {
                let fold = first_root(&growth, LARGEST_RADIUS).unwrap_or(LARGEST_RADIUS);
                bisected(0.0, fold, |radius| value(&base.polynomial(), radius) < base.angle)
            }
            // At the end of the next two the radius does not grow, and the angle of a radius has half the digits only.
            Shape::Eucm if a > 0.5 => {
                base.angle = ((2.0 * a - 1.0) / b).sqrt().atan2(a - 1.0);
                return Self { radius: 1.0 / ((2.0 * a - 1.0) * b).sqrt(), ..base };
            }
            Shape::Polynomial => {
                base.angle = first_root(&growth, base.angle).unwrap_or(base.angle);
                return Self { radius: value(&base.polynomial(), base.angle), ..base };
            }
            Shape::Slope | Shape::Division | Shape::Eucm | Shape::Sphere | Shape::Parallel => LARGEST_RADIUS,
        };
        base.radius = base.radius.min(LARGEST_RADIUS);
        base.angle = base.angle_of(base.radius);
        base
    }

    /// The polynomial of [`Shape::Polynomial`] and [`Shape::Inverse`].
    fn polynomial(&self) -> [f64; 6] {
        let [c2, c3, c4, c5] = self.numbers;
        [0.0, 1.0, c2, c3, c4, c5]
    }

    /// The angle from the axis at a radius up to the end.
    pub fn angle_of(&self, radius: f64) -> f64 {
        let (across, forward) = self.ray(radius);
        // The sine of the last angle may round to less than 0.
        (radius * across).max(0.0).atan2(forward)
    }

    /// The direction (b across, forward), of any length, that is seen at a point b of the plane within the end.
    pub fn direction(&self, b: DVec2) -> DVec3 {
        let (across, forward) = self.ray(b.length());
        (b * across).extend(forward).normalize()
    }

    /// `across` and `forward` of [`Base::direction`].
    fn ray(&self, radius: f64) -> (f64, f64) {
        let [a, b, ..] = self.numbers;
        let by_angle = |angle: f64| if radius > 0.0 { (angle.sin() / radius, angle.cos()) } else { (1.0, 1.0) };
        match self.shape {
            Shape::Slope | Shape::Sphere | Shape::Parallel => (1.0, 1.0),
            Shape::Angle => by_angle(radius),
            Shape::Fov => {
                let ((across, forward), widening) = (by_angle(radius * a), 2.0 * (a / 2.0).tan());
                (if radius > 0.0 { across } else { a }, widening * forward)
            }
            Shape::Division => (1.0, 1.0 + a * radius * radius),
            Shape::Eucm => {
                let square = b * radius * radius;
                let under = a * (1.0 - (2.0 * a - 1.0) * square).max(0.0).sqrt() + 1.0 - a;
                // Both are 0 at the end of alpha = 1, at 90 degrees.
                (1.0, if under > 0.0 { (1.0 - a * a * square) / under } else { 0.0 })
            }
            Shape::Polynomial => {
                by_angle(solved(self.angle, radius, |angle| value_and_slope(&self.polynomial(), angle)))
            }
            Shape::Inverse => by_angle(value(&self.polynomial(), radius)),
        }
    }

    /// The map at a point in view axes within the end: `square` is x^2 + y^2.
    pub fn factor(&self, square: f64, z: f64) -> Factor {
        let [a, b, ..] = self.numbers;
        match self.shape {
            Shape::Slope | Shape::Sphere | Shape::Parallel => {
                Factor { h: 1.0 / z, by_square: 0.0, by_z: -1.0 / (z * z) }
            }
            Shape::Angle => angle_over(square, z),
            Shape::Fov => {
                let t = 2.0 * (a / 2.0).tan();
                let Factor { h, by_square, by_z } = angle_over(t * t * square, z);
                Factor { h: t * h / a, by_square: t * t * t * by_square / a, by_z: t * by_z / a }
            }
            Shape::Division => {
                let root = (z * z - 4.0 * a * square).max(0.0).sqrt();
                // z + root loses its digits behind the camera, where k < 0.
                let h = if z > 0.0 { 2.0 / (z + root) } else { (z - root) / (2.0 * a * square) };
                Factor { h, by_square: h * h * a / root, by_z: -h / root }
            }
            Shape::Eucm => {
                let root = (b * square + z * z).sqrt();
                let h = 1.0 / (a * root + (1.0 - a) * z);
                Factor { h, by_square: -h * h * a * b / (2.0 * root), by_z: -h * h * (a * z / root + 1.0 - a) }
            }
            Shape::Polynomial | Shape::Inverse => self.polynomial_factor(square, z),
        }
    }

    /// The map of an f-theta lens: theta / rho times the quotient R / theta.
    fn polynomial_factor(&self, square: f64, z: f64) -> Factor {
        let (over, rho) = (angle_over(square, z), square.sqrt());
        let (angle, polynomial) = (rho.atan2(z), self.polynomial());
        let slope = |x: f64| value_and_slope(&polynomial, x)[1];
        let (quotient, growth) = match self.shape {
            Shape::Polynomial => (value(&polynomial[1..], angle), slope(angle)),
            _ => {
                let radius = solved(self.radius, angle, |radius| value_and_slope(&polynomial, radius));
                (if angle > 0.0 { radius / angle } else { 1.0 }, 1.0 / slope(radius))
            }
        };
        // d(theta) = z / (2 rho n^2) d(rho^2) - rho / n^2 dz; the quotient has no influence on the axis.
        let aside = if angle > 0.0 { over.h * (growth - quotient) / angle / (square + z * z) } else { 0.0 };
        Factor {
            h: over.h * quotient,
            by_square: over.by_square * quotient + if rho > 0.0 { aside * z / (2.0 * rho) } else { 0.0 },
            by_z: over.by_z * quotient - aside * rho,
        }
    }
}

/// theta / rho of a point with rho^2 = `square`: h of [`Shape::Angle`].
fn angle_over(square: f64, z: f64) -> Factor {
    let by_z = -1.0 / (square + z * z);
    let s = square / (z * z);
    if z > 0.0 && s < SERIES_BELOW {
        // atan(t) / t = 1 - s/3 + s^2/5 - ..., with s = t^2, and its derivative by s
        const TERMS: [f64; 10] = {
            let mut terms = [0.0; 10];
            let mut i = 0;
            while i < terms.len() {
                terms[i] = if i % 2 == 0 { 1.0 } else { -1.0 } / (2 * i + 1) as f64;
                i += 1;
            }
            terms
        };
        let [value, slope] = value_and_slope(&TERMS, s);
        return Factor { h: value / z, by_square: slope / (z * z * z), by_z };
    }
    let rho = square.sqrt();
    let h = rho.atan2(z) / rho;
    Factor { h, by_square: (-z * by_z - h) / (2.0 * square), by_z }
}
