//! The models of files by name: the names, order and meaning of their parameters.

use std::f64::consts::PI;

use anyhow::{Context, Result, bail, ensure};
use glam::{DMat2, DVec2};

use super::Lens;
use super::base::{Base, Shape};
use super::planar::Planar;

/// Names of the parameters that follow the focal lengths and the principal point, by model. The first 18 are COLMAP's.
const MODELS: [(&str, &[&str]); 25] = [
    ("SIMPLE_PINHOLE", &[]),
    (PINHOLE, &[]),
    ("SIMPLE_RADIAL", &["k1"]),
    ("RADIAL", &["k1", "k2"]),
    ("OPENCV", &["k1", "k2", "p1", "p2"]),
    ("OPENCV_FISHEYE", &["k1", "k2", "k3", "k4"]),
    ("FULL_OPENCV", &["k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"]),
    ("FOV", &["omega"]),
    ("SIMPLE_RADIAL_FISHEYE", &["k1"]),
    ("RADIAL_FISHEYE", &["k1", "k2"]),
    ("THIN_PRISM_FISHEYE", &["k1", "k2", "p1", "p2", "k3", "k4", "sx1", "sy1"]),
    ("RAD_TAN_THIN_PRISM_FISHEYE", &["k0", "k1", "k2", "k3", "k4", "k5", "p0", "p1", "s0", "s1", "s2", "s3"]),
    ("SIMPLE_DIVISION", &["k"]),
    ("DIVISION", &["k"]),
    ("SIMPLE_FISHEYE", &[]),
    ("FISHEYE", &[]),
    ("EUCM", &["alpha", "beta"]),
    ("EQUIRECTANGULAR", &[]),
    // OpenCV's 12 coefficients, grouped as gsplat's `radial_coeffs`, `tangential_coeffs` and `thin_prism_coeffs`.
    ("OPENCV_THIN_PRISM", &["k1", "k2", "k3", "k4", "k5", "k6", "p1", "p2", "s1", "s2", "s3", "s4"]),
    // nerfstudio's perspective cameras: k4 is of r^8, and no denominator.
    ("PERSPECTIVE", &["k1", "k2", "k3", "k4", "p1", "p2"]),
    // Metashape exchanges p1 and p2 against OpenCV. Its focal lengths are f + b1 and f; b2 is divided by f + b1 here.
    ("METASHAPE_FRAME", &["k1", "k2", "k3", "k4", "p1", "p2", "b2"]),
    ("METASHAPE_FISHEYE", &["k1", "k2", "k3", "k4", "p1", "p2", "b2"]),
    // f-theta: radius = theta + k2 theta^2 + ... in focal lengths, then (c x + d y, e x + y). max_angle in radians.
    ("FTHETA", &["k2", "k3", "k4", "k5", "max_angle", "c", "d", "e"]),
    // f-theta the other way round: theta = radius + k2 radius^2 + ...
    ("FTHETA_INVERSE", &["k2", "k3", "k4", "k5", "max_angle", "c", "d", "e"]),
    ("ORTHOGRAPHIC", &[]),
];

const PINHOLE: &str = "PINHOLE";

/// Largest absolute value of a parameter: with it, no intermediate value of a map overflows.
const LARGEST_PARAMETER: f64 = 1e9;

/// A lens that ends within this radius, in focal lengths, folds at the centre of the picture.
const SMALLEST_RADIUS: f64 = 1e-3;

/// Up to this omega a lens of the model FOV is a pinhole.
const SMALLEST_OMEGA: f64 = 1e-6;

impl Lens {
    /// The names of the parameters of a model, without focal lengths and principal point. `None` if there is no such
    /// model.
    pub fn parameter_names(model: &str) -> Option<&'static [&'static str]> {
        MODELS.iter().find(|(name, _)| *name == model).map(|(_, names)| *names)
    }

    /// The lens that sees what a pinhole sees.
    pub(in crate::camera) fn straight() -> Self {
        Self::new(PINHOLE, &[], (Base::new(Shape::Slope, &[], f64::INFINITY), Planar::default(), DMat2::IDENTITY))
    }

    /// The lens of a model by its name and its numbers, without focal lengths and principal point, like
    /// `("OPENCV_FISHEYE", &[k1, k2, k3, k4])`. `None` if it is a pinhole.
    ///
    /// The models are all of COLMAP; `OPENCV_THIN_PRISM` (k1 to k6, p1, p2, s1 to s4) of OpenCV and gsplat;
    /// `PERSPECTIVE` of nerfstudio (k1 to k4, p1, p2; k4 of r^8); `METASHAPE_FRAME` and `METASHAPE_FISHEYE` (k1 to k4,
    /// p1, p2, b2 / (f + b1), with focal lengths f + b1 and f); `FTHETA` and `FTHETA_INVERSE` (k2 to k5, max_angle in
    /// radians, c, d, e, see [`Lens::f_theta`]); `ORTHOGRAPHIC`.
    ///
    /// # Errors
    /// One sentence if there is no such model, the count of the numbers is wrong, a number is none or out of its range,
    /// or the lens folds at the centre.
    pub fn named(model: &str, numbers: &[f64]) -> Result<Option<Self>> {
        let known = MODELS.iter().find(|(name, _)| *name == model);
        let (model, names) =
            *known.with_context(|| format!("its camera model {} is not known", model.escape_debug()))?;
        if numbers.len() != names.len() {
            let (wanted, found) = (names.len(), numbers.len());
            let listed = if names.is_empty() { String::new() } else { format!(" ({})", names.join(", ")) };
            bail!("{model} has {wanted} lens parameters{listed}, it has {found}");
        }
        ensure!(numbers.iter().all(|number| number.is_finite()), "its parameters are not all numbers");
        for (name, number) in names.iter().zip(numbers) {
            let is_small = number.abs() <= LARGEST_PARAMETER;
            ensure!(is_small, "its parameter {name} {number:e} is not within {LARGEST_PARAMETER:e}");
        }
        let (base, planar, skew) = parts(model, numbers)?;
        if base.shape == Shape::Slope && planar == Planar::default() && skew == DMat2::IDENTITY {
            return Ok(None);
        }
        let lens = Self::new(model, numbers, (base, planar, skew));
        if lens.radius < SMALLEST_RADIUS {
            let given = names.iter().zip(numbers).filter(|(_, number)| **number != 0.0);
            let given: Vec<_> = given.map(|(name, number)| format!("{name} {number:?}")).collect();
            bail!("its coefficients {} fold at the centre of the picture", given.join(", "));
        }
        Ok(Some(lens))
    }
}

/// The base, the map of the plane and the skew of a model with as many numbers as it has names.
fn parts(model: &str, numbers: &[f64]) -> Result<(Base, Planar, DMat2)> {
    let slope = || Base::new(Shape::Slope, &[], f64::INFINITY);
    let angle = || Base::new(Shape::Angle, &[], f64::INFINITY);
    let radial = |k: &[f64]| Planar { over: padded(k), ..Planar::default() };
    let tangential = |k: &[f64], p1: f64, p2: f64| Planar { tangential: [p1, p2], ..radial(k) };
    let straight = Planar::default;
    let (base, planar) = match (model, numbers) {
        ("SIMPLE_PINHOLE" | "PINHOLE", _) => (slope(), straight()),
        ("SIMPLE_RADIAL" | "RADIAL", k) => (slope(), radial(k)),
        ("OPENCV", &[k1, k2, p1, p2]) => (slope(), tangential(&[k1, k2], p1, p2)),
        ("FULL_OPENCV", &[k1, k2, p1, p2, k3, ref under @ ..]) => {
            (slope(), Planar { under: padded(under), ..tangential(&[k1, k2, k3], p1, p2) })
        }
        ("OPENCV_THIN_PRISM", &[k1, k2, k3, k4, k5, k6, p1, p2, ref prism @ ..]) => {
            let planar = tangential(&[k1, k2, k3], p1, p2);
            (slope(), Planar { under: [k4, k5, k6], prism: padded(prism), ..planar })
        }
        ("PERSPECTIVE", &[ref k @ .., p1, p2]) => (slope(), tangential(k, p1, p2)),
        ("SIMPLE_FISHEYE" | "FISHEYE" | "SIMPLE_RADIAL_FISHEYE" | "RADIAL_FISHEYE" | "OPENCV_FISHEYE", k) => {
            (angle(), radial(k))
        }
        ("THIN_PRISM_FISHEYE", &[k1, k2, p1, p2, k3, k4, s1, s3]) => {
            (angle(), Planar { prism: [s1, 0.0, s3, 0.0], ..tangential(&[k1, k2, k3, k4], p1, p2) })
        }
        // Its p0 takes the place of OpenCV's p2, its p1 that of p1.
        ("RAD_TAN_THIN_PRISM_FISHEYE", &[ref k @ .., p0, p1, s0, s1, s2, s3]) => {
            (angle(), Planar { prism: [s0, s1, s2, s3], is_in_turn: true, ..tangential(k, p1, p0) })
        }
        ("FOV", &[omega]) => {
            let is_pinhole = omega.abs() < SMALLEST_OMEGA;
            ensure!(is_pinhole || omega > 0.0 && omega < PI, "its omega {omega:?} is not over 0 and under pi");
            (if is_pinhole { slope() } else { Base::new(Shape::Fov, numbers, PI) }, straight())
        }
        ("SIMPLE_DIVISION" | "DIVISION", &[k]) => {
            (if k == 0.0 { slope() } else { Base::new(Shape::Division, numbers, PI) }, straight())
        }
        ("EUCM", &[alpha, beta]) => {
            ensure!((0.0..=1.0).contains(&alpha), "its alpha {alpha:?} is not from 0 to 1");
            ensure!(beta > 0.0, "its beta {beta:?} is not over 0");
            (if alpha == 0.0 { slope() } else { Base::new(Shape::Eucm, numbers, PI) }, straight())
        }
        ("METASHAPE_FRAME" | "METASHAPE_FISHEYE", &[ref k @ .., p1, p2, b2]) => {
            let base = if model == "METASHAPE_FRAME" { slope() } else { angle() };
            let skew = DMat2::from_cols(DVec2::X, DVec2::new(b2, 1.0));
            return Ok((base, tangential(k, p2, p1), skew));
        }
        ("FTHETA" | "FTHETA_INVERSE", &[ref k @ .., max_angle, c, d, e]) => {
            ensure!(max_angle > 0.0, "its max_angle {max_angle:?} is not over 0");
            ensure!(c - d * e > 0.0, "its c, d and e, {c:?}, {d:?} and {e:?}, mirror or flatten the picture");
            let shape = if model == "FTHETA" { Shape::Polynomial } else { Shape::Inverse };
            return Ok((Base::new(shape, k, max_angle), straight(), DMat2::from_cols_array(&[c, e, d, 1.0])));
        }
        ("EQUIRECTANGULAR", _) => (Base::new(Shape::Sphere, &[], PI), straight()),
        ("ORTHOGRAPHIC", _) => (Base::new(Shape::Parallel, &[], PI), straight()),
        _ => unreachable!("the names and the meaning of the parameters of {model} disagree"),
    };
    Ok((base, planar, DMat2::IDENTITY))
}

/// The values, filled up with zeros.
fn padded<const N: usize>(values: &[f64]) -> [f64; N] {
    std::array::from_fn(|i| values.get(i).copied().unwrap_or(0.0))
}
