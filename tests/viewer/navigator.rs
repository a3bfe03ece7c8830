//! Camera navigation by mouse and keys: properties of each motion.

use crate::common::Random;
use glam::{DMat3, DVec2, DVec3, dvec2, dvec3};
use smalto::camera::control::GLIDE_SECONDS;
use smalto::camera::{Camera, NamedCamera, Navigator, Up};

const SIZE: [u32; 2] = [1280, 720];
const CENTRE: DVec3 = dvec3(3.0, -1.0, 2.0);

fn navigator() -> Navigator {
    Navigator::new(CENTRE, 2.5, SIZE)
}

fn px(camera: &Camera, point: DVec3) -> DVec2 {
    let p = camera.view(point);
    camera.focal_px * p.truncate() / p.z + camera.centre_px
}

/// What is wrong with the rotation: zero for a perfect one.
fn crooked(rotation: DMat3) -> f64 {
    let products = (rotation * rotation.transpose() - DMat3::IDENTITY).to_cols_array();
    products.iter().fold((rotation.determinant() - 1.0).abs(), |most, v| most.max(v.abs()))
}

/// How far the horizon is from level: the sine of the angle.
fn roll(camera: &Camera, up: Up) -> f64 {
    camera.right().dot(up.vector())
}

/// A file's camera that nothing is regular about: tilted, its pixels not square, its principal point not in the middle.
fn irregular() -> Camera {
    let level = Camera::looking_at(dvec3(1.0, 0.5, -6.0), dvec3(2.0, -1.0, 0.0), [1600, 1063], 0.9);
    Camera {
        rotation: DMat3::from_rotation_z(0.3) * level.rotation,
        focal_px: dvec2(1200.0, 1210.0),
        centre_px: dvec2(790.0, 540.0),
        ..level
    }
}

#[test]
fn the_first_view_is_the_one_that_is_rendered_without_cameras() {
    assert_eq!(navigator().camera(SIZE), Camera::framing(CENTRE, 2.5, SIZE));
    assert!(navigator().pivot().distance(CENTRE) < 1e-12);
}

#[test]
fn orbit_keeps_the_distance_the_horizon_and_the_pivot_in_the_picture() {
    let mut hands = navigator();
    let mut random = Random(1);
    let distance = hands.camera(SIZE).position.distance(CENTRE);
    for _ in 0..1000 {
        hands.orbit(dvec2(random.between(-300.0, 300.0), random.between(-300.0, 300.0)), SIZE);
        let camera = hands.camera(SIZE);
        assert!((camera.position.distance(CENTRE) / distance - 1.0).abs() < 1e-10);
        assert!(roll(&camera, hands.up()).abs() < 1e-12);
        assert!(camera.down().dot(hands.up().vector()) < 0.0, "up is up");
        assert!(px(&camera, CENTRE).distance(dvec2(640.0, 360.0)) < 1e-7);
    }
}

#[test]
fn orbit_turns_near_things_with_the_drag() {
    let drag = |delta| {
        let mut hands = navigator();
        let near = hands.camera(SIZE).position.lerp(CENTRE, 0.5);
        hands.orbit(delta, SIZE);
        px(&hands.camera(SIZE), near) - dvec2(640.0, 360.0)
    };
    let (right, down) = (drag(dvec2(5.0, 0.0)), drag(dvec2(0.0, 5.0)));
    assert!(right.x > 1.0 && right.y.abs() < 0.5, "{right}");
    assert!(down.y > 1.0 && down.x.abs() < 0.5, "{down}");
}

#[test]
fn orbit_stops_before_the_poles_and_goes_half_around_across_the_shorter_side() {
    for up in Up::ALL {
        let mut hands = navigator();
        hands.set_up(up);
        hands.orbit(dvec2(0.0, 1e6), SIZE);
        let above = hands.camera(SIZE);
        let angle = above.forward().dot(-up.vector()).acos().to_degrees();
        assert!((angle - 0.1).abs() < 1e-6, "{up}: {angle} degrees from straight down");
        hands.orbit(dvec2(0.0, -1e6), SIZE);
        assert!(hands.camera(SIZE).forward().dot(up.vector()) > 0.999, "{up}");

        let mut hands = navigator();
        hands.set_up(up);
        let before = hands.camera(SIZE);
        hands.orbit(dvec2(720.0, 0.0), SIZE);
        let turned = hands.camera(SIZE).right().dot(before.right());
        assert!((turned + 1.0).abs() < 1e-12, "{up}");
    }
}

#[test]
fn a_tilt_vanishes_as_the_camera_turns_and_never_jumps() {
    let mut hands = navigator();
    hands.snap(&irregular());
    let tilt = |hands: &Navigator| roll(&hands.camera(SIZE), hands.up()).abs();
    let mut before = (tilt(&hands), hands.camera(SIZE).rotation);
    assert!(before.0 > 0.2);
    for _ in 0..100 {
        hands.orbit(dvec2(2.0, 1.0), SIZE);
        let now = (tilt(&hands), hands.camera(SIZE).rotation);
        let step = (now.1 - before.1).to_cols_array().iter().fold(0.0, |m: f64, v| m.max(v.abs()));
        assert!(now.0 <= before.0 && step < 0.03, "{} after {}, step {step}", now.0, before.0);
        before = now;
    }
    assert!(before.0 < 1e-12);
}

#[test]
fn pan_moves_points_at_the_pivots_depth_with_the_pointer() {
    let mut hands = navigator();
    hands.snap(&irregular());
    for (delta, size) in
        [(dvec2(17.0, -5.5), SIZE), (dvec2(-400.0, 250.0), [1600, 1063]), (dvec2(3.0, 3.0), [200, 900])]
    {
        let (pivot, before) = (hands.pivot(), hands.camera(size));
        let beside = pivot + 0.7 * before.right() - 0.2 * before.down();
        hands.pan(delta, size);
        let after = hands.camera(size);
        for point in [pivot, beside] {
            assert!((px(&after, point) - px(&before, point)).distance(delta) < 1e-8);
        }
        assert_eq!(after.rotation, before.rotation);
        assert!(px(&after, hands.pivot()).distance(px(&before, pivot)) < 1e-8, "the pivot comes along");
    }
}

#[test]
fn dolly_keeps_the_pivot_in_place_and_never_passes_it() {
    let mut hands = navigator();
    let pivot = CENTRE + dvec3(0.4, 0.3, -0.2);
    hands.set_pivot(pivot);
    let before = hands.camera(SIZE);
    let (place, distance) = (px(&before, pivot), before.position.distance(pivot));
    hands.dolly(1.0);
    assert!((hands.camera(SIZE).position.distance(pivot) / distance - 0.9).abs() < 1e-12);
    hands.dolly(-1.0);
    assert!(hands.camera(SIZE).position.distance(before.position) < 1e-12);
    for steps in [1e9, -3.0, 40.0, f64::MAX, -50.0, f64::INFINITY, -130.0, -1e9, f64::NEG_INFINITY, 145.0] {
        hands.dolly(steps);
        let camera = hands.camera(SIZE);
        assert!(camera.view(pivot).z > 0.0, "after {steps}");
        assert!(px(&camera, pivot).distance(place) < 1e-3 && hands.pivot().distance(pivot) < 1e-3, "after {steps}");
    }
}

#[test]
fn look_turns_in_place_with_the_drag() {
    let mut hands = navigator();
    let before = hands.camera(SIZE);
    let focal = before.focal_px.x;
    hands.look(dvec2(0.5, 0.0), SIZE);
    let after = hands.camera(SIZE);
    assert_eq!(after.position, before.position);
    let moved = px(&after, before.position + before.forward()) - before.centre_px;
    assert!(moved.x < 0.0 && moved.y.abs() < 0.1, "what was ahead goes to the left: {moved}");
    hands.look(dvec2(0.0, focal * 0.1), SIZE);
    let down = hands.camera(SIZE).forward().y.asin() - after.forward().y.asin();
    assert!((down - 0.1).abs() < 1e-9, "{down}");
    hands.look(dvec2(0.0, 1e7), SIZE);
    assert!(hands.camera(SIZE).forward().y > 0.999 && roll(&hands.camera(SIZE), hands.up()).abs() < 1e-12);
}

#[test]
fn fly_goes_at_the_speed_along_view_axes() {
    let mut hands = navigator();
    hands.set_speed(4.0);
    let before = hands.camera(SIZE);
    hands.fly(DVec3::Z, 0.5, 1.0);
    let step = hands.camera(SIZE).position - before.position;
    assert!(step.distance(2.0 * before.forward()) < 1e-12);
    assert!(hands.pivot().distance(CENTRE + step) < 1e-12, "the pivot comes along");
    let before = hands.camera(SIZE);
    hands.fly(dvec3(3.0, -3.0, 0.0), 0.25, 2.0);
    let step = hands.camera(SIZE).position - before.position;
    assert!((step.length() - 2.0).abs() < 1e-12, "no faster across");
    assert!(step.dot(before.right()) > 0.0 && step.dot(before.down()) < 0.0);
    for wrong in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        hands.set_speed(wrong);
        assert_eq!(hands.speed(), 4.0);
    }
}

#[test]
fn a_snapped_camera_is_exactly_that_of_the_file() {
    let mut hands = navigator();
    let camera = irregular();
    hands.orbit(dvec2(33.0, 4.0), SIZE);
    hands.glide_to(&Camera::framing(CENTRE, 1.0, SIZE), 1.0);
    hands.snap(&camera);
    for size in [SIZE, [1600, 1063], [1, 1], [800, 1063]] {
        assert_eq!(hands.camera(size), camera.resized(size));
    }
    assert!(!hands.advance(1.0));
    let pivot = camera.view(hands.pivot());
    assert!(pivot.truncate().length() < 1e-12 && (pivot.z - camera.view(CENTRE).z).abs() < 1e-12);
}

#[test]
fn a_glide_is_smooth_and_ends_exactly_at_its_target() {
    let mut hands = navigator();
    let camera = irregular();
    let from = hands.camera(SIZE);
    hands.glide_to(&camera, GLIDE_SECONDS);
    let mut positions = vec![from.position];
    while hands.advance(0.01) {
        assert!(crooked(hands.camera(SIZE).rotation) < 1e-12 && hands.is_gliding());
        positions.push(hands.camera(SIZE).position);
    }
    assert!((29..=31).contains(&positions.len()), "{}", positions.len());
    assert_eq!(hands.camera([1600, 1063]), camera);
    let whole = from.position.distance(camera.position);
    let steps: Vec<f64> = positions.windows(2).map(|w| w[0].distance(w[1]) / whole).collect();
    assert!(steps.iter().all(|step| *step < 0.06) && steps[0] < 0.01, "{steps:?}");
    assert!(!hands.advance(0.01));
}

#[test]
fn input_stops_a_glide_where_it_is() {
    let mut hands = navigator();
    hands.glide_to(&irregular(), GLIDE_SECONDS);
    assert!(hands.advance(0.1));
    let on_the_way = hands.camera(SIZE).position;
    // No motion is none.
    hands.fly(DVec3::ZERO, 0.016, 1.0);
    hands.orbit(DVec2::ZERO, SIZE);
    hands.dolly(0.0);
    hands.pan(DVec2::ZERO, SIZE);
    assert!(hands.is_gliding());
    hands.look(dvec2(1.0, 0.0), SIZE);
    assert!(!hands.advance(0.1));
    assert_eq!(hands.camera(SIZE).position, on_the_way);
}

#[test]
fn glides_without_duration_are_steps() {
    for seconds in [0.0, -1.0, f64::NAN] {
        let mut hands = navigator();
        hands.glide_to(&irregular(), seconds);
        assert!(!hands.advance(0.0));
        assert_eq!(hands.camera([1600, 1063]), irregular());
    }
}

#[test]
fn focus_turns_to_the_point_and_makes_it_the_pivot() {
    let mut hands = navigator();
    let before = hands.camera(SIZE);
    let point = CENTRE + dvec3(1.0, -0.5, 0.3);
    hands.focus(point);
    while hands.advance(0.01) {}
    let after = hands.camera(SIZE);
    assert_eq!(after.position, before.position);
    assert!(px(&after, point).distance(after.centre_px) < 1e-7);
    assert!(hands.pivot().distance(point) < 1e-12);
    hands.focus(after.position);
    assert!(!hands.is_gliding(), "there is no looking at where one is");
}

#[test]
fn the_field_of_view_is_horizontal_and_within_its_limits() {
    let mut hands = navigator();
    for (wanted, expected) in [(60.0, 60.0), (0.1, 0.1), (179.0, 179.0), (0.0, 0.1), (360.0, 179.0), (f64::NAN, 179.0)]
    {
        hands.set_field_of_view(wanted);
        assert!((hands.field_of_view() - expected).abs() < 1e-9, "{wanted}");
        let camera = hands.camera([333, 77]);
        assert!((2.0 * (166.5 / camera.focal_px.x).atan() - expected.to_radians()).abs() < 1e-12);
    }
    hands.snap(&irregular());
    hands.set_field_of_view(40.0);
    let Camera { focal_px, centre_px, .. } = hands.camera([1600, 1063]);
    assert_eq!(centre_px, irregular().centre_px);
    assert!((focal_px.y / focal_px.x - 1210.0 / 1200.0).abs() < 1e-12);
}

#[test]
fn flipping_twice_changes_nothing() {
    let mut hands = navigator();
    for camera in [hands.camera(SIZE), irregular()] {
        hands.snap(&camera);
        hands.set_pivot(CENTRE);
        let (before, pivot) = (hands.camera(SIZE), hands.pivot());
        hands.flip_up();
        assert_eq!(hands.up(), Up::PlusY);
        assert_eq!((hands.camera(SIZE).right(), hands.camera(SIZE).forward()), (-before.right(), before.forward()));
        assert!(hands.pivot().distance(pivot) < 1e-12);
        hands.flip_up();
        assert_eq!((hands.up(), hands.camera(SIZE), hands.pivot()), (Up::MinusY, before, pivot));
    }
}

#[test]
fn any_axis_can_be_up() {
    for up in Up::ALL {
        assert_eq!(up.flipped().vector(), -up.vector());
        let mut hands = navigator();
        hands.set_up(up);
        let camera = hands.camera(SIZE);
        assert!(roll(&camera, up).abs() < 1e-12 && camera.down().dot(up.vector()) < 0.0, "{up}");
        assert!(
            hands.pivot().distance(CENTRE) < 1e-12 && px(&camera, CENTRE).distance(camera.centre_px) < 1e-7,
            "{up}"
        );
        hands.frame(CENTRE * 2.0, 1.0, SIZE);
        let home = hands.camera(SIZE);
        assert!(roll(&home, up).abs() < 1e-12 && home.down().dot(up.vector()) < 0.0, "{up}");
        assert!(home.forward().dot(up.vector()) < -0.1, "{up}: from above");
        assert!(px(&home, CENTRE * 2.0).distance(home.centre_px) < 1e-7 && hands.up() == up);
    }
    assert_eq!(Up::ALL.map(|up| up.to_string()).join(" "), "+x -x +y -y +z -z");
}

#[test]
fn the_nearest_camera_is_near_and_looks_the_same_way() {
    let mut hands = navigator();
    let here = hands.camera(SIZE);
    let away = Camera { position: here.position + 3.0 * here.right(), ..here.clone() };
    let back = Camera { rotation: DMat3::from_diagonal(dvec3(-1.0, 1.0, -1.0)) * here.rotation, ..here.clone() };
    let close = Camera { position: here.position + 0.5 * here.right(), ..here };
    let cameras = [away.clone(), back.clone(), close].map(|camera| NamedCamera::new(String::new(), camera));
    assert_eq!(hands.nearest(&cameras), Some(2));
    assert_eq!(hands.nearest(&cameras[..2]), Some(0), "behind is farther than beside");
    hands.snap(&back);
    assert_eq!(hands.nearest(&cameras), Some(1));
    assert_eq!(hands.nearest(&[]), None);
}

/// Whatever hands do, in windows of any size, the camera stays one.
#[test]
fn ten_thousand_motions_leave_a_valid_camera() {
    let mut random = Random(99);
    let mut hands = navigator();
    let sizes = [SIZE, [0, 0], [1, 1], [65536, 2], [u32::MAX, 7], [0, 500]];
    let extremes = [0.0, -0.0, 1e-300, 1e9, -1e30, 1e300, f64::MAX, f64::NAN, f64::INFINITY, f64::NEG_INFINITY];
    for i in 0..10_000 {
        let size = sizes[random.below(6) as usize];
        let mut number = |largest: f64| match random.below(40) {
            0 => extremes[random.below(10) as usize],
            _ => random.between(-largest, largest),
        };
        let delta = dvec2(number(500.0), number(500.0));
        let vector = dvec3(number(5.0), number(5.0), number(5.0));
        let (amount, other) = (number(3.0), number(1.0));
        match i % 13 {
            0 | 1 => hands.orbit(delta, size),
            2 => hands.pan(delta, size),
            3 => hands.dolly(amount),
            4 | 5 => hands.look(delta, size),
            6 => hands.fly(vector, amount, other),
            7 => hands.focus(vector),
            8 => hands.set_pivot(vector),
            9 => hands.set_up(Up::ALL[(i / 13) % 6]),
            10 => hands.set_field_of_view(amount * 60.0),
            11 => hands.glide_to(&irregular(), amount),
            _ if i % 91 == 12 => hands.frame(vector, amount, size),
            _ => hands.snap(&irregular()),
        }
        hands.advance(other);
        let camera = hands.camera(size);
        assert!(crooked(camera.rotation) < 1e-9, "{i}: {camera:?}");
        let is_finite = camera.position.is_finite() && camera.focal_px.is_finite() && camera.centre_px.is_finite();
        assert!(is_finite && camera.focal_px.min_element() > 0.0 && hands.pivot().is_finite(), "{i}: {camera:?}");
        assert!(camera.size_px.iter().all(|side| (1..=65536).contains(side)));
    }
}
