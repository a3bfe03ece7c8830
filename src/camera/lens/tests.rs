//! All models against their inverse, differences, known values, and random coefficients.

use std::f64::consts::{FRAC_PI_2, PI};

use glam::{DVec2, DVec3};

use super::*;

/// A lens of each model, with the numbers of the known values where there are some.
const LENSES: [(&str, &[f64]); 27] = [
    ("SIMPLE_RADIAL", &[-0.12]),
    ("RADIAL", &[-0.12, 0.03]),
    ("OPENCV", &[-0.25, 0.05, 0.002, -0.001]),
    ("FULL_OPENCV", &[0.4, -0.05, 0.002, -0.001, 0.01, 0.6, 0.02, 0.001]),
    ("OPENCV_FISHEYE", &[-0.02, 0.004, -0.001, 0.0001]),
    ("THIN_PRISM_FISHEYE", &[-0.02, 0.004, 0.001, -0.002, -0.001, 0.0001, 0.001, -0.001]),
    (
        "RAD_TAN_THIN_PRISM_FISHEYE",
        &[-0.02, 0.01, -0.004, 0.001, -0.0002, 0.00001, 0.002, -0.001, 0.001, 0.0001, -0.001, 0.0001],
    ),
    ("FOV", &[0.9]),
    ("DIVISION", &[-0.15]),
    ("SIMPLE_DIVISION", &[0.15]),
    ("EUCM", &[0.6, 1.1]),
    ("EUCM", &[0.4, 1.1]),
    ("EUCM", &[0.5, 1.0]),
    ("EUCM", &[1.0, 1.2]),
    ("EQUIRECTANGULAR", &[]),
    ("SIMPLE_FISHEYE", &[]),
    ("FISHEYE", &[]),
    ("SIMPLE_RADIAL_FISHEYE", &[-0.05]),
    ("RADIAL_FISHEYE", &[0.04, -0.01]),
    ("OPENCV_THIN_PRISM", &[-0.2, 0.04, 0.0, 0.01, 0.002, 0.0, 0.001, 0.001, 0.002, 0.001, -0.002, 0.001]),
    ("PERSPECTIVE", &[-0.1, 0.03, -0.01, 0.002, 0.001, -0.001]),
    ("METASHAPE_FRAME", &[-0.1, 0.03, -0.01, 0.002, 0.001, -0.001, 0.01]),
    ("METASHAPE_FISHEYE", &[-0.02, 0.004, -0.001, 0.0001, 0.001, -0.001, -0.02]),
    ("FTHETA", &[0.02, -0.03, 0.01, -0.002, 2.0, 1.01, 0.002, -0.003]),
    ("FTHETA_INVERSE", &[0.02, 0.03, -0.01, 0.002, 1.9, 1.01, 0.002, -0.003]),
    ("FTHETA", &[0.0, -0.1, 0.0, 0.0, 3.0, 1.0, 0.0, 0.0]),
    ("FTHETA_INVERSE", &[0.0, -0.1, 0.0, 0.0, 3.0, 1.0, 0.0, 0.0]),
];

fn lens(model: &str, numbers: &[f64]) -> Lens {
    Lens::named(model, numbers).unwrap_or_else(|e| panic!("{model}: {e:#}")).unwrap_or_else(|| panic!("{model}: none"))
}

/// Numbers from 0 to 1.
struct Random(u64);

impl Random {
    fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (self.0 >> 11) as f64 / (1_u64 << 53) as f64
    }

    fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.next()
    }

    /// A point in view axes, at the largest angle from the axis that is a part of the field.
    fn view(&mut self, field: f64) -> DVec3 {
        let (angle, turn) = (self.next() * field, self.between(-PI, PI));
        let direction = DVec3::new(angle.sin() * turn.cos(), angle.sin() * turn.sin(), angle.cos());
        direction * 10_f64.powf(self.between(-2.0, 3.0))
    }
}

#[test]
fn the_inverse_finds_the_direction_and_the_place() {
    let mut random = Random(1);
    for (model, numbers) in LENSES {
        let lens = lens(model, numbers);
        assert_eq!((lens.model(), lens.parameters()), (model, numbers));
        for _ in 0..2000 {
            let view = random.view(0.999 * lens.field());
            let plane = lens.plane(view).unwrap_or_else(|| panic!("{model}: {view} of {}", lens.field()));
            let back = lens.direction(plane).unwrap_or_else(|| panic!("{model}: {plane} of {view}"));
            let off = back.distance(view.normalize());
            assert!(off < 1e-9 && (back.length() - 1.0).abs() < 1e-14, "{model} {numbers:?}: {off:e} at {view}");
            let again = lens.plane(back).unwrap();
            assert!(again.distance(plane) < 1e-9 * plane.length().max(1.0), "{model}: {plane}, then {again}");
        }
        // Places of a picture: none is seen twice.
        for _ in 0..2000 {
            let plane = DVec2::new(random.between(-4.0, 4.0), random.between(-4.0, 4.0));
            let Some(direction) = lens.direction(plane) else { continue };
            let Some(again) = lens.plane(direction) else {
                panic!("{model}: {plane} has the direction {direction}, which is not seen")
            };
            assert!(again.distance(plane) < 1e-9 * plane.length().max(1.0), "{model}: {plane}, then {again}");
        }
    }
}

#[test]
fn the_jacobian_is_that_of_differences() {
    let mut random = Random(2);
    for (model, numbers) in LENSES.into_iter().chain([("ORTHOGRAPHIC", &[][..])]) {
        let lens = lens(model, numbers);
        for i in 0..1000 {
            // A third of the points is close to the axis, where the series are.
            let part = [0.98, 0.2, 0.01][i % 3];
            let view = random.view(part * lens.field());
            let rows = lens.jacobian(view).unwrap();
            // The plane bends most at the end of the field: the step is short against the distance to it.
            let step = 1e-5 * view.length() * (FRAC_PI_2 - (view.z / view.length()).acos()).abs().clamp(1e-2, 1.0);
            for axis in 0..3 {
                let aside = DVec3::AXES[axis] * step;
                let number = (lens.plane(view + aside).unwrap() - lens.plane(view - aside).unwrap()) / (2.0 * step);
                let exact = DVec2::new(rows[0][axis], rows[1][axis]);
                let scale = rows[0].length().max(rows[1].length());
                let off = number.distance(exact) / scale;
                assert!(off < 1e-6, "{model} {numbers:?}, axis {axis}: {number}, not {exact} ({off:e}) at {view}");
            }
            if !lens.is_parallel() {
                let along = rows.map(|row| row.dot(view) / row.length() / view.length());
                assert!(along.iter().all(|a| a.abs() < 1e-11), "{model}: {along:?} along the ray");
            }
        }
    }
}

/// A lens of [`LENSES`], its focal lengths and principal point, the pixels of (0.6, -0.4, 1), and of (0.6, -0.4, -0.2)
/// if it is seen, and the tolerance of the first.
type Known = (usize, [DVec2; 2], [f64; 2], Option<[f64; 2]>, f64);

#[test]
fn known_places_are_met() {
    let (focal, centre) = (DVec2::new(900.0, 905.0), DVec2::new(1010.0, 740.0));
    let sphere = Lens::sphere_px(DVec2::new(2000.0, 1500.0));
    let known: [Known; 11] = [
        (0, [DVec2::splat(900.0), centre], [1516.304, 402.464], None, 1e-3),
        (2, [focal, centre], [1485.1208, 422.12056], None, 1e-5),
        (3, [focal, centre], [1498.156363303, 413.381904601], None, 1e-6),
        (4, [focal, centre], [1474.450189266, 428.646354603], Some([2323.262904, -140.372539]), 1e-6),
        (5, [focal, centre], [1472.801848876, 429.515861665], Some([2308.944328, -132.819425]), 1e-6),
        (6, [focal, centre], [1477.137131729, 426.867495503], Some([2337.747954, -148.676684]), 1e-6),
        (7, [focal, centre], [1516.293336515, 400.595948484], Some([2549.590426, -292.095804]), 1e-6),
        (8, [focal, centre], [1513.396602138, 402.537833382], Some([3756.024196, -1100.853258]), 1e-6),
        (9, [focal, centre], [1600.338889539, 344.254299976], None, 1e-6),
        (10, [focal, centre], [1478.637500600, 425.839305153], Some([2396.810908, -189.676942]), 1e-6),
        (14, sphere, [1172.020869623, 592.234806826], Some([1602.416382, 480.737223]), 1e-6),
    ];
    for (index, [focal, centre], first, second, tolerance) in known {
        let (model, numbers) = LENSES[index];
        let lens = lens(model, numbers);
        let px = |z: f64| Some(lens.plane(DVec3::new(0.6, -0.4, z))? * focal + centre);
        let first_px = px(1.0).unwrap();
        assert!(first_px.distance(first.into()) < tolerance, "{model}: {first_px}, not {first:?}");
        assert_eq!(px(-0.2).is_some(), second.is_some(), "{model}");
        let off = px(-0.2).zip(second).map_or(0.0, |(px, known)| px.distance(known.into()));
        assert!(off < 2e-6, "{model}: {off:e} px off behind the camera");
    }
    let eucm = lens("EUCM", &[0.4, 1.1]);
    let px = |z: f64| eucm.plane(DVec3::new(0.6, -0.4, z)).unwrap() * focal + centre;
    assert!(px(1.0).distance(DVec2::new(1500.232704993, 411.362519986)) < 1e-6);
    assert!(px(-0.2).distance(DVec2::new(3809.062815, -1136.408776)) < 2e-6);
}

#[test]
fn folds_are_those_of_the_reports_on_them() {
    for (k, degrees, tolerance) in [
        ([-0.0187, 0.0585, -0.0349, -0.0334], 65.53, 0.005), // COLMAP, issue 1629
        ([-0.0232, 0.0924, -0.0591, 0.003], 79.47, 0.005),   // COLMAP, issue 2802
        // OpenCV, issue 26174. These coefficients are rounded; the last one to a tenth.
        ([0.0567, -0.0049, -0.0001, -0.0003], 123.12, 0.5),
    ] {
        let lens = lens("OPENCV_FISHEYE", &k);
        assert!((lens.field().to_degrees() - degrees).abs() < tolerance, "{}", lens.field().to_degrees());
        assert!(lens.folds());
        let at = |angle: f64| lens.plane(DVec3::new(angle.sin(), 0.0, angle.cos()));
        assert!(at(lens.field() - 1e-9).is_some() && at(lens.field() + 1e-9).is_none());
    }
    for (k, slope) in [(-0.12, 1.6667), (-0.3, 1.0541)] {
        assert!((lens("SIMPLE_RADIAL", &[k]).field().tan() - slope).abs() < 5e-5);
    }
    let never = lens("RADIAL", &[-0.25, 0.05]);
    assert!(!never.folds() && (never.field() - FRAC_PI_2).abs() < 2e-6);
    let mut straight = [0.0; 12];
    straight[6] = 1e-4;
    let never = lens("RAD_TAN_THIN_PRISM_FISHEYE", &straight);
    assert!(!never.folds() && never.field() == PI);
    // The denominator 1 - 0.25 r^2 is 0 at r = 2.
    let pole = lens("FULL_OPENCV", &[0.0, 0.0, 0.0, 0.0, 0.0, -0.25, 0.0, 0.0]);
    assert!((pole.field().tan() - 2.0).abs() < 1e-12);
    // Tangential terms alone: 1 = 6 r |p|.
    let tangential = lens("OPENCV", &[0.0, 0.0, 0.03, 0.04]);
    assert!((tangential.field().tan() - 1.0 / 0.3).abs() < 1e-12);
    for (model, numbers, field) in [
        ("FISHEYE", &[][..], PI),
        ("FOV", &[0.9], PI),
        ("EQUIRECTANGULAR", &[], PI),
        ("EUCM", &[1.0, 1.2], FRAC_PI_2),
        ("EUCM", &[0.6, 1.1], (0.2_f64 / 1.1).sqrt().atan2(-0.4)),
        ("DIVISION", &[0.15], 1.0_f64.atan2(2.0 * 0.15_f64.sqrt())),
        ("FTHETA", &[0.0, -0.1, 0.0, 0.0, 3.0, 1.0, 0.0, 0.0], (1.0_f64 / 0.3).sqrt()),
        ("FTHETA", &[0.0, -0.1, 0.0, 0.0, 1.0, 1.0, 0.0, 0.0], 1.0),
        ("FTHETA_INVERSE", &[0.0, 0.1, 0.0, 0.0, 1.0, 1.0, 0.0, 0.0], 1.0),
    ] {
        let found = lens(model, numbers).field();
        assert!((found - field).abs() < 1e-8, "{model} {numbers:?}: {found}, not {field}");
    }
}

/// The bases without their closed forms' cancellation: the same point, computed in another way.
#[test]
fn values_near_the_axis_have_all_their_digits() {
    for rho in [1e-9, 1e-6, 1e-4, 1e-3, 0.0999, 0.1001] {
        let view = DVec3::new(0.6 * rho, 0.8 * rho, 1.0);
        // theta / rho by its series, to the 20th power
        let s = -rho * rho;
        let h = (0..11).rev().fold(0.0, |sum, i| sum * s + 1.0 / f64::from(2 * i + 1));
        let slope = (1..11).rev().fold(0.0, |sum, i| sum * s - f64::from(i) / f64::from(2 * i + 1));
        let fisheye = lens("FISHEYE", &[]);
        assert!(fisheye.plane(view).unwrap().distance(h * view.truncate()) < 3e-16 * rho);
        let rows = fisheye.jacobian(view).unwrap();
        let mixed = 2.0 * view.x * view.y * slope;
        assert!((rows[0].y - mixed).abs() < 1e-12 * mixed.abs(), "{rho}: {} {mixed}", rows[0].y);
        let fov = lens("FOV", &[0.9]).plane(view).unwrap().length();
        let t = 2.0 * 0.45_f64.tan();
        assert!((fov - (t * rho).atan() / 0.9).abs() < 4e-16 * rho);
    }
    for (model, numbers) in LENSES {
        let lens = lens(model, numbers);
        let axis = lens.plane(DVec3::new(0.0, 0.0, 3.0)).unwrap();
        assert_eq!(axis, DVec2::ZERO, "{model}");
        assert_eq!(lens.direction(DVec2::ZERO).unwrap(), DVec3::Z, "{model}");
        assert!(lens.jacobian(DVec3::Z).unwrap().iter().all(|row| row.is_finite()), "{model}");
        for view in [DVec3::ZERO, DVec3::NAN, DVec3::INFINITY] {
            assert_eq!((lens.plane(view), lens.jacobian(view)), (None, None), "{model}: {view}");
        }
        assert_eq!(lens.direction(DVec2::NAN), None, "{model}");
        assert_eq!(lens.direction(DVec2::new(f64::INFINITY, 0.0)), None, "{model}");
        assert!(model == "EQUIRECTANGULAR" || lens.plane(DVec3::NEG_Z).is_none(), "{model}: behind");
    }
}

/// A lens with coefficients of any size. Most of them fold somewhere.
fn random_lens(random: &mut Random) -> Lens {
    let models = [
        ["SIMPLE_RADIAL", "RADIAL", "OPENCV", "FULL_OPENCV", "OPENCV_FISHEYE", "RADIAL_FISHEYE", "THIN_PRISM_FISHEYE"],
        ["RAD_TAN_THIN_PRISM_FISHEYE", "OPENCV_THIN_PRISM", "METASHAPE_FRAME", "FOV", "DIVISION", "EUCM", "FTHETA"],
    ];
    let model = models.as_flattened()[(random.next() * 14.0) as usize];
    let size = 10_f64.powf(random.between(-4.0, 0.5));
    let mut number = |name: &&str| match *name {
        "omega" => random.between(0.01, 3.1),
        "alpha" => random.between(0.01, 1.0),
        "beta" => random.between(0.1, 3.0),
        "max_angle" => random.between(0.5, 3.0),
        "c" => random.between(0.9, 1.1),
        coefficient => size * random.between(-1.0, 1.0) * if coefficient.starts_with('k') { 1.0 } else { 0.1 },
    };
    let numbers: Vec<f64> = Lens::parameter_names(model).unwrap().iter().map(&mut number).collect();
    lens(model, &numbers)
}

#[test]
fn random_lenses_are_one_to_one_in_their_domain() {
    let mut random = Random(3);
    let (mut folded, mut refused) = (0, 0);
    for _ in 0..10_000 {
        let lens = random_lens(&mut random);
        folded += usize::from(lens.folds());
        for _ in 0..10 {
            let view = random.view(0.999 * lens.field());
            let plane = lens.plane(view).unwrap();
            let back = lens.direction(plane).unwrap_or_else(|| panic!("{lens:?}: {plane} of {view} has no direction"));
            let off = back.distance(view.normalize());
            assert!(off < 1e-9, "{lens:?}: {view} is seen at {plane}, which sees {back} ({off:e})");
            // What lies beyond the domain is not seen, and what a place sees lies in the domain.
            let beyond = lens.field() + random.next() * (PI - lens.field());
            assert_eq!(lens.plane(DVec3::new(beyond.sin(), 0.0, beyond.cos())), None);
            let place = DVec2::new(random.between(-3.0, 3.0), random.between(-3.0, 3.0));
            match lens.direction(place) {
                None => refused += 1,
                Some(direction) => {
                    let again = lens.plane(direction).unwrap_or_else(|| panic!("{lens:?}: {place} sees {direction}"));
                    assert!(again.distance(place) < 1e-8 * place.length().max(1.0), "{lens:?}: {place} {again}");
                }
            }
        }
    }
    assert!(folded > 4000 && refused > 20_000, "{folded} fold, {refused} places see nothing");
}

#[test]
fn lenses_without_distortion_are_pinholes() {
    let pinholes = ["PINHOLE", "SIMPLE_RADIAL", "RADIAL", "OPENCV", "FULL_OPENCV", "OPENCV_THIN_PRISM", "PERSPECTIVE"];
    for model in pinholes.into_iter().chain(["SIMPLE_PINHOLE", "METASHAPE_FRAME", "FOV", "DIVISION"]) {
        let zeros = vec![0.0; Lens::parameter_names(model).unwrap().len()];
        assert_eq!(Lens::named(model, &zeros).unwrap(), None, "{model}");
        let negative: Vec<f64> = zeros.iter().map(|zero| -zero).collect();
        assert_eq!(Lens::named(model, &negative).unwrap(), None, "{model}");
    }
    assert_eq!(Lens::named("EUCM", &[0.0, 1.3]).unwrap(), None);
    assert_eq!(Lens::named("FOV", &[-9e-7]).unwrap(), None);
    for model in ["FISHEYE", "OPENCV_FISHEYE", "EQUIRECTANGULAR", "ORTHOGRAPHIC"] {
        let zeros = vec![0.0; Lens::parameter_names(model).unwrap().len()];
        assert!(Lens::named(model, &zeros).unwrap().is_some(), "{model}");
    }
}

#[test]
fn wrong_parameters_are_refused_in_one_sentence() {
    for (model, numbers, expected) in [
        ("OPENCV", &[0.0; 5][..], "OPENCV has 4 lens parameters (k1, k2, p1, p2), it has 5"),
        ("PINHOLE", &[1.0], "PINHOLE has 0 lens parameters, it has 1"),
        ("VOF", &[], "its camera model VOF is not known"),
        ("RADIAL", &[0.0, f64::NAN], "its parameters are not all numbers"),
        ("RADIAL", &[f64::INFINITY, 0.0], "its parameters are not all numbers"),
        ("RADIAL", &[0.0, -1e10], "its parameter k2 -1e10 is not within 1e9"),
        ("RADIAL", &[-1e6, 0.0], "its coefficients k1 -1000000.0 fold at the centre of the picture"),
        ("DIVISION", &[1e7], "its coefficients k 10000000.0 fold at the centre of the picture"),
        ("FOV", &[-0.5], "its omega -0.5 is not over 0 and under pi"),
        ("FOV", &[3.15], "its omega 3.15 is not over 0 and under pi"),
        ("EUCM", &[1.5, 1.0], "its alpha 1.5 is not from 0 to 1"),
        ("EUCM", &[0.5, 0.0], "its beta 0.0 is not over 0"),
        ("FTHETA", &[0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0], "its max_angle 0.0 is not over 0"),
        (
            "FTHETA",
            &[0.0, 0.0, 0.0, 0.0, 1.0, -1.0, 0.0, 0.0],
            "its c, d and e, -1.0, 0.0 and 0.0, mirror or flatten the picture",
        ),
    ] {
        assert_eq!(format!("{:#}", Lens::named(model, numbers).unwrap_err()), expected);
    }
}

#[test]
fn f_theta_takes_the_polynomial_that_is_the_reference() {
    let angle_to_px = [0.0, 800.0, 10.0, -30.0, 0.0, 1.0];
    let linear = [1.001, 0.002, -0.003];
    let there = FTheta { angle_to_px, px_to_angle: [0.0; 6], is_px_to_angle: false, max_angle: 1.8, linear };
    let InPixels { focal_px, lens, disagreement_px } = Lens::f_theta(&there).unwrap();
    assert_eq!((focal_px, disagreement_px), (800.0, 0.0));
    assert_eq!(Lens::named(lens.model(), lens.parameters()).unwrap(), Some(lens.clone()));
    assert!((lens.field() - 1.8).abs() < 1e-14);
    // gsplat: px = [c d; e 1] R(theta) / rho (x, y)
    let (view, angle) = (DVec3::new(0.3, -0.4, 0.5), 1.0_f64.atan());
    let radius = 800.0 * angle + 10.0 * angle.powi(2) - 30.0 * angle.powi(3) + angle.powi(5);
    let (x, y) = (0.6 * radius, -0.8 * radius);
    let px = lens.plane(view).unwrap() * focal_px;
    assert!(px.distance(DVec2::new(1.001 * x + 0.002 * y, -0.003 * x + y)) < 1e-10, "{px}");
    // instant-ngp: theta is a polynomial of the radius in pixels.
    let px_to_angle = [0.0, 0.00125, 1e-8, 2e-11, 0.0, 0.0];
    let back = FTheta { px_to_angle, is_px_to_angle: true, linear: [1.0, 0.0, 0.0], max_angle: FRAC_PI_2, ..there };
    let read = Lens::f_theta(&back).unwrap();
    assert!((read.lens.field() - FRAC_PI_2).abs() < 1e-14 && read.focal_px == 800.0);
    assert_eq!(Lens::named(read.lens.model(), read.lens.parameters()).unwrap(), Some(read.lens.clone()));
    let seen = read.lens.direction(DVec2::new(700.0 / 800.0, 0.0)).unwrap();
    let angle = 0.00125 * 700.0 + 1e-8 * 700.0 * 700.0 + 2e-11 * 700.0_f64.powi(3);
    assert!((seen.x.atan2(seen.z) - angle).abs() < 1e-14);
    let ends = Lens::f_theta(&FTheta { max_angle: 1.0, ..back.clone() }).unwrap();
    let (px, other) = (bisect(&px_to_angle, 1.0), 800.0 + 10.0 - 30.0 + 1.0);
    assert!((ends.disagreement_px - (px - other).abs()).abs() < 1e-6, "{} {px}", ends.disagreement_px);
    let same = FTheta {
        angle_to_px: [0.0, 800.0, 0.0, 0.0, 0.0, 0.0],
        px_to_angle: [0.0, 0.00125, 0.0, 0.0, 0.0, 0.0],
        ..back.clone()
    };
    for is_px_to_angle in [false, true] {
        assert!(Lens::f_theta(&FTheta { is_px_to_angle, ..same.clone() }).unwrap().disagreement_px < 1e-9);
    }
    assert!(Lens::f_theta(&FTheta { max_angle: f64::NAN, ..back.clone() }).is_err());
    for (angle_to_px, expected) in [
        ([1.0, 800.0, 0.0, 0.0, 0.0, 0.0], "is not 0 on the axis"),
        ([0.0, -800.0, 0.0, 0.0, 0.0, 0.0], "does not grow on the axis"),
        ([0.0, f64::NAN, 0.0, 0.0, 0.0, 0.0], "not all numbers"),
    ] {
        let wrong = FTheta { angle_to_px, is_px_to_angle: false, ..back.clone() };
        assert!(Lens::f_theta(&wrong).unwrap_err().to_string().contains(expected));
    }
}

/// The place below 10,000 at which a growing polynomial has this value.
fn bisect(polynomial: &[f64], wanted: f64) -> f64 {
    roots::bisected(0.0, 1e4, |x| roots::value(polynomial, x) < wanted)
}

/// OpenCV's own formulas (calib3d, "Detailed Description").
#[test]
fn opencv_has_twelve_coefficients() {
    let numbers = [0.4, -0.05, 0.01, 0.6, 0.02, 0.001, 0.002, -0.001, 0.003, 0.0004, -0.005, 0.0006];
    let [k1, k2, k3, k4, k5, k6, p1, p2, s1, s2, s3, s4] = numbers;
    let (x, y) = (0.5, -0.7);
    let r2 = x * x + y * y;
    let (r4, r6) = (r2 * r2, r2 * r2 * r2);
    let g = (1.0 + k1 * r2 + k2 * r4 + k3 * r6) / (1.0 + k4 * r2 + k5 * r4 + k6 * r6);
    let radial = DVec2::new(
        x * g + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x),
        y * g + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y,
    );
    let expected = radial + DVec2::new(s1 * r2 + s2 * r4, s3 * r2 + s4 * r4);
    let view = DVec3::new(x, y, 1.0) * 7.0;
    let whole = lens("OPENCV_THIN_PRISM", &numbers);
    assert!(whole.plane(view).unwrap().distance(expected) < 1e-15);
    let full = lens("FULL_OPENCV", &[k1, k2, p1, p2, k3, k4, k5, k6]);
    assert!(full.plane(view).unwrap().distance(radial) < 1e-15);
}

/// Metashape's own formulas (manual, "Frame cameras"), in pixels.
#[test]
fn metashape_exchanges_its_tangential_terms() {
    let ([k1, k2, k3, k4], [p1, p2]) = ([-0.1, 0.03, -0.01, 0.002], [0.003, -0.004]);
    let (f, b1, b2) = (1000.0, 5.0, 3.0);
    let (x, y) = (0.3, -0.4);
    let r2 = x * x + y * y;
    let g = 1.0 + k1 * r2 + k2 * r2 * r2 + k3 * r2 * r2 * r2 + k4 * r2 * r2 * r2 * r2;
    let xd = x * g + p1 * (r2 + 2.0 * x * x) + 2.0 * p2 * x * y;
    let yd = y * g + p2 * (r2 + 2.0 * y * y) + 2.0 * p1 * x * y;
    let expected = DVec2::new(xd * f + xd * b1 + yd * b2, yd * f);
    let lens = lens("METASHAPE_FRAME", &[k1, k2, k3, k4, p1, p2, b2 / (f + b1)]);
    let found = lens.plane(DVec3::new(x, y, 1.0)).unwrap() * DVec2::new(f + b1, f);
    assert!(found.distance(expected) < 1e-10, "{found} {expected}");
}

#[test]
fn spheres_and_parallel_lenses_end_where_nothing_is_seen() {
    let sphere = lens("EQUIRECTANGULAR", &[]);
    assert_eq!(sphere.plane(DVec3::NEG_Y), None, "a pole has no azimuth");
    assert!(sphere.direction(DVec2::new(0.3, -FRAC_PI_2)).unwrap().distance(DVec3::NEG_Y) < 1e-15);
    assert_eq!(sphere.direction(DVec2::new(3.2, 0.0)), None);
    assert_eq!(sphere.direction(DVec2::new(0.0, 1.6)), None);
    let parallel = lens("ORTHOGRAPHIC", &[]);
    assert_eq!(parallel.plane(DVec3::new(2.0, -3.0, 5.0)), Some(DVec2::new(2.0, -3.0)));
    assert_eq!(parallel.plane(DVec3::new(2.0, -3.0, -5.0)), None);
    assert_eq!(parallel.direction(DVec2::new(2.0, -3.0)), Some(DVec3::Z));
    assert!(parallel.is_parallel() && sphere.is_sphere() && parallel.field() == FRAC_PI_2);
}
