//! The planar map of a lens: radial, tangential and thin prism distortion, as OpenCV and COLMAP define them.

use glam::{DMat2, DVec2};

use super::roots::{derivative, first_root, product, solved, sum, value_and_slope};

/// The distortion of a point b of the plane. With r2 = |b|^2:
///
/// ```text
/// g = (1 + over[0] r2 + over[1] r2^2 + ...) / (1 + under[0] r2 + ...)
/// x = g b.x + 2 p1 b.x b.y + p2 (r2 + 2 b.x^2) + s1 r2 + s2 r2^2
/// y = g b.y + 2 p2 b.x b.y + p1 (r2 + 2 b.y^2) + s3 r2 + s4 r2^2
/// ```
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Planar {
    pub over: [f64; 6],
    pub under: [f64; 3],
    /// p1, p2
    pub tangential: [f64; 2],
    /// s1 to s4
    pub prism: [f64; 4],
    /// The tangential and prism terms are those of the point g b, not of b.
    pub is_in_turn: bool,
}

impl Planar {
    /// The numerator and the denominator of g, as polynomials of r2.
    fn radial(&self) -> ([f64; 7], [f64; 4]) {
        let (over, under) = (self.over, self.under);
        let number = |of: &[f64], i: usize| if i == 0 { 1.0 } else { of[i - 1] };
        (std::array::from_fn(|i| number(&over, i)), std::array::from_fn(|i| number(&under, i)))
    }

    /// g at a squared radius, and its derivative by that square.
    fn factor(&self, square: f64) -> [f64; 2] {
        let (over, under) = self.radial();
        let ([n, dn], [m, dm]) = (value_and_slope(&over, square), value_and_slope(&under, square));
        [n / m, (dn * m - n * dm) / (m * m)]
    }

    /// The radius that the radial part maps a radius to, and its derivative.
    fn radius(&self, radius: f64) -> [f64; 2] {
        let square = radius * radius;
        let [g, slope] = self.factor(square);
        [radius * g, g + 2.0 * square * slope]
    }

    /// The point that `b` is mapped to, and the Jacobian.
    pub fn map(&self, b: DVec2) -> (DVec2, DMat2) {
        let [g, slope] = self.factor(b.length_squared());
        let (radial, by_b) = (g * b, scaled_identity(g) + 2.0 * slope * outer(b, b));
        if self.is_in_turn {
            let (aside, by_radial) = self.aside(radial);
            return (radial + aside, by_b + by_radial * by_b);
        }
        let (aside, more) = self.aside(b);
        (radial + aside, by_b + more)
    }

    /// The tangential and prism terms, and their Jacobian.
    fn aside(&self, b: DVec2) -> (DVec2, DMat2) {
        let ([p1, p2], [s1, s2, s3, s4], square) = (self.tangential, self.prism, b.length_squared());
        let w = DVec2::new(p2, p1);
        // As vectors, the tangential terms are |b|^2 w + 2 (w.b) b.
        let tangential = square * w + 2.0 * w.dot(b) * b;
        let by_tangential = 2.0 * (outer(w, b) + outer(b, w) + scaled_identity(w.dot(b)));
        let (first, second) = (DVec2::new(s1, s3), DVec2::new(s2, s4));
        let prism = square * (first + square * second);
        let by_prism = 2.0 * outer(first + 2.0 * square * second, b);
        (tangential + prism, by_tangential + by_prism)
    }

    fn is_radial(&self) -> bool {
        (self.tangential, self.prism) == ([0.0; 2], [0.0; 4])
    }

    /// The radius of a disc, up to `end`, in which the map is certainly one-to-one: there, the symmetric part of the
    /// Jacobian is positive definite, or that of each of two maps in turn. Without tangential and prism terms this is
    /// the fold, the first radius at which the mapped radius no longer grows.
    ///
    /// Along a unit vector at the angle a to b, with c = cos^2 a, the radial part of the form is linear in c, from g at
    /// c = 0 to (r g)' at c = 1. The tangential terms take `2 r |w| sqrt(1 + 8 c)` from it at most, the prism terms
    /// `2 r |u| sqrt(c)`, where u is (s1, s3) + 2 r^2 (s2, s4). Both are below their tangents at c = 1, so that the
    /// ends suffice: at c = 1, `6 r |w| + 2 r |u|`; at c = 0, `10/3 r |w| + r |u|`.
    pub fn fold(&self, end: f64) -> f64 {
        let (over, under) = self.radial();
        let [n, m] = [&over[..], &under[..]].map(in_radius);
        let first = |polynomial: &[f64], end: f64| first_root(polynomial, end).unwrap_or(end);
        let end = first(&m, end);
        // Numerators of g and of (r g)'.
        let turn = sum(&product(&derivative(&n), &m), -1.0, &product(&n, &derivative(&m)));
        let across = product(&n, &m);
        let along = sum(&across, 1.0, &product(&[0.0, 1.0], &turn));
        let ([p1, p2], [s1, s2, s3, s4]) = (self.tangential, self.prism);
        if self.is_radial() {
            return first(&along, end);
        }
        let (w, u) = (p1.hypot(p2), [s1.hypot(s3), 2.0 * s2.hypot(s4)]);
        let taken_along = [0.0, 6.0 * w + 2.0 * u[0], 0.0, 2.0 * u[1]];
        if self.is_in_turn {
            let fold = first(&along, end);
            let end = self.radius(fold)[0];
            let largest = first(&sum(&[1.0], -1.0, &taken_along), end);
            return if largest < end { solved(fold, largest, |radius| self.radius(radius)) } else { fold };
        }
        let taken_across = [0.0, 10.0 / 3.0 * w + u[0], 0.0, u[1]];
        let square = product(&m, &m);
        let left = |of: &[f64], taken: &[f64]| sum(of, -1.0, &product(&square, taken));
        first(&left(&across, &taken_across), first(&left(&along, &taken_along), end))
    }

    /// The point that is mapped to `wanted`, within the disc of `fold`; `None` if there is none.
    ///
    /// The radial part is found in an interval, the rest by Newton's method. In the disc the squared distance to
    /// `wanted` has no other minimum than the point itself, so that shortened steps end there.
    pub fn inverse(&self, wanted: DVec2, fold: f64) -> Option<DVec2> {
        if *self == Self::default() {
            return (wanted.length() < fold).then_some(wanted);
        }
        let unbent = |mapped: DVec2| {
            let length = mapped.length();
            mapped * if length > 0.0 { solved(fold, length, |radius| self.radius(radius)) / length } else { 0.0 }
        };
        let b = match self.is_in_turn {
            true => {
                let disc = self.radius(fold)[0];
                unbent(newton(wanted, wanted.clamp_length_max(0.999 * disc), disc, |b| {
                    let (aside, by_b) = self.aside(b);
                    (b + aside, by_b + DMat2::IDENTITY)
                }))
            }
            false if self.is_radial() => unbent(wanted),
            false => newton(wanted, unbent(wanted), fold, |b| self.map(b)),
        };
        let is_found = self.map(b).0.distance(wanted) < LARGEST_RESIDUAL * wanted.length().max(1.0);
        is_found.then_some(b)
    }
}

/// Newton's method for the point in a disc that is mapped to `wanted`, from a point in the disc, in steps that stay
/// there and come closer.
fn newton(wanted: DVec2, start: DVec2, disc: f64, map: impl Fn(DVec2) -> (DVec2, DMat2)) -> DVec2 {
    let mut b = start;
    let (mut mapped, mut jacobian) = map(b);
    for _ in 0..NEWTON_STEPS {
        let error = mapped - wanted;
        if error.length() <= ROUNDING * wanted.length() {
            break;
        }
        let step = jacobian.inverse() * error;
        let mut fraction = 1.0;
        (b, mapped, jacobian) = loop {
            let next = b - fraction * step;
            let (at, by) = map(next);
            if next.length() < disc && (at - wanted).length_squared() < error.length_squared() {
                break (next, at, by);
            }
            fraction *= 0.5;
            // No step comes closer: what is left is rounding, or the point lies beyond the disc.
            if fraction < SMALLEST_FRACTION {
                return b;
            }
        };
    }
    b
}

/// Relative residual that no step improves much.
const ROUNDING: f64 = 4.0 * f64::EPSILON;

const NEWTON_STEPS: usize = 100;
const SMALLEST_FRACTION: f64 = 1e-6;

/// Largest distance between a point of the plane and the map of its inverse, relative beyond 1.
const LARGEST_RESIDUAL: f64 = 1e-9;

/// A polynomial of the squared radius as one of the radius.
fn in_radius(polynomial: &[f64]) -> Vec<f64> {
    polynomial.iter().flat_map(|coefficient| [*coefficient, 0.0]).collect()
}

fn scaled_identity(factor: f64) -> DMat2 {
    DMat2::from_diagonal(DVec2::splat(factor))
}

/// `a b^T`
fn outer(a: DVec2, b: DVec2) -> DMat2 {
    DMat2::from_cols(a * b.x, a * b.y)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_coefficients_are_the_identity() {
        let (b, planar) = (DVec2::new(0.3, -7.0), Planar::default());
        assert_eq!(planar.map(b), (b, DMat2::IDENTITY));
        assert_eq!(planar.fold(5.0), 5.0);
    }
}
