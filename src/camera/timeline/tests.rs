//! Tests of paths.

use super::*;
use crate::camera::path::{orbit, through};

const SIZE: [u32; 2] = [64, 48];

fn cameras() -> Vec<Camera> {
    orbit(DVec3::new(1.0, 2.0, 3.0), 2.0, true, SIZE, 6)
}

fn timeline(times: &[f64]) -> Timeline {
    let mut timeline = Timeline::default();
    for (seconds, camera) in times.iter().zip(cameras()) {
        timeline.insert(*seconds, camera).unwrap();
    }
    timeline
}

fn times(timeline: &Timeline) -> Vec<f64> {
    timeline.keys().iter().map(|key| key.seconds).collect()
}

#[test]
fn equal_steps_are_the_way_through_keyframes() {
    let timeline = timeline(&[2.0, 3.0, 4.0, 5.0, 6.0, 7.0]);
    let path: Vec<Camera> = timeline.frames(10.0).collect();
    let expected = through(&cameras(), 51);
    assert_eq!(path.len(), expected.len());
    for (ours, expected) in path.iter().zip(&expected) {
        assert!(ours.position.distance(expected.position) < 1e-12);
        assert!(ours.rotation.abs_diff_eq(expected.rotation, 1e-12));
        assert!(ours.focal_px.distance(expected.focal_px) < 1e-12);
    }
}

#[test]
fn keys_are_met_exactly_and_the_ends_stand_still() {
    let timeline = timeline(&[0.5, 1.0, 1.7, 4.0, 4.1, 9.0]);
    for key in timeline.keys() {
        assert_eq!(timeline.at(key.seconds).as_ref(), Some(&key.camera));
    }
    let keys = timeline.keys();
    for (seconds, key) in [(0.0, 0), (-5.0, 0), (f64::NAN, 0), (9.5, 5), (f64::INFINITY, 5)] {
        assert_eq!(timeline.at(seconds).as_ref(), Some(&keys[key].camera), "{seconds}");
    }
    assert_eq!(timeline.duration(), 8.5);
    assert_eq!((Timeline::default().at(1.0), Timeline::default().duration()), (None, 0.0));
}

#[test]
fn uneven_times_make_no_jumps_of_speed() {
    let timeline = timeline(&[0.0, 1.0, 1.7, 4.0, 5.5, 6.0]);
    let place = |seconds| timeline.at(seconds).unwrap().position;
    let h = 1e-6;
    for key in &timeline.keys()[1..5] {
        let (t, p) = (key.seconds, key.camera.position);
        let (before, after) = ((p - place(t - h)) / h, (place(t + h) - p) / h);
        assert!(before.distance(after) < 1e-4 * before.length(), "{t} s: {before} then {after}");
    }
}

#[test]
fn the_motion_rests_at_a_key_and_is_as_before_elsewhere() {
    let mut timeline = timeline(&[0.0, 1.0, 2.0, 3.0]);
    let before: Vec<Camera> = timeline.frames(20.0).collect();
    timeline.set_rest(2, true);
    timeline.set_rest(9, true);
    let after: Vec<Camera> = timeline.frames(20.0).collect();
    assert_eq!(before[..21], after[..21], "the first second ends at a key that does not rest");
    assert!(before[30] != after[30] && before[50] != after[50]);
    let speed = |at: f64, h: f64| {
        let [a, b] = [at - h, at + h].map(|seconds| timeline.at(seconds).unwrap());
        (a.position.distance(b.position) + (a.rotation.row(2) - b.rotation.row(2)).length()) / (2.0 * h)
    };
    assert!(speed(2.0, 1e-4) < 1e-3 * speed(1.5, 1e-4), "{} against {}", speed(2.0, 1e-4), speed(1.5, 1e-4));
    // The speed does not jump where the bent time begins.
    let [left, right] = [speed(1.0 - 1e-5, 1e-6), speed(1.0 + 1e-5, 1e-6)];
    assert!((left / right - 1.0).abs() < 1e-3, "{left} then {right}");
    assert_eq!(timeline.retime(2, 2.5).unwrap(), 2);
    assert!(timeline.keys()[2].rests, "a key that is moved rests still");
    timeline.insert(2.5, cameras()[5].clone()).unwrap();
    assert!(timeline.keys()[2].rests, "and one whose view is replaced");
}

#[test]
fn a_closed_path_goes_round_without_a_corner() {
    let mut timeline = timeline(&[0.0, 1.0, 2.0, 4.0]);
    assert!(!timeline.is_closed());
    timeline.insert(5.0, cameras()[0].clone()).unwrap();
    assert!(timeline.is_closed());
    let place = |seconds| timeline.at(seconds).unwrap().position;
    let h = 1e-6;
    let (out, back) = ((place(h) - place(0.0)) / h, (place(5.0) - place(5.0 - h)) / h);
    assert!(out.distance(back) < 1e-4 * out.length(), "{out} and {back}");
}

#[test]
fn haste_before_a_long_way_does_not_swing_it_about() {
    let mut timeline = Timeline::default();
    for (seconds, x) in [(0.0, 0.0), (0.01, 10.0), (10.0, 11.0), (20.0, 12.0)] {
        let there = DVec3::X * x;
        timeline.insert(seconds, Camera::looking_at(there, there + DVec3::Z, SIZE, 1.0)).unwrap();
    }
    let path: Vec<f64> = timeline.frames(100.0).map(|camera| camera.position.x).collect();
    assert!(path.iter().all(|x| (-1e-9..=12.5).contains(x)), "{path:?}");
    assert_eq!(path.len(), 2001);
}

#[test]
fn keys_stay_in_order_and_one_at_a_time() {
    let mut timeline = timeline(&[3.0, 1.0, 2.0]);
    assert_eq!(times(&timeline), [1.0, 2.0, 3.0]);
    let other = cameras().remove(5);
    assert_eq!(timeline.insert(2.0 + 1e-9, cameras().remove(4)).unwrap(), 1);
    assert_eq!(timeline.insert(2.0, other.clone()).unwrap(), 1);
    assert_eq!((times(&timeline), &timeline.keys()[1].camera), (vec![1.0, 2.0, 3.0], &other));
    assert_eq!(timeline.retime(1, 4.5).unwrap(), 2);
    assert_eq!(times(&timeline), [1.0, 3.0, 4.5]);
    assert_eq!(timeline.retime(2, 4.5).unwrap(), 2, "where it is");
    assert!(timeline.retime(2, 1.0).is_err(), "onto another");
    assert_eq!((times(&timeline), &timeline.keys()[2].camera), (vec![1.0, 3.0, 4.5], &other));
    let before = timeline.clone();
    for wrong in [f64::NAN, -1.0, f64::INFINITY, 1e7] {
        assert!(timeline.insert(wrong, other.clone()).is_err() && timeline.retime(0, wrong).is_err());
    }
    assert!(timeline.retime(3, 0.0).is_err() && timeline.remove(3).is_none());
    assert_eq!(timeline, before);
    assert_eq!(timeline.remove(2).unwrap().camera, other);
    assert_eq!(times(&timeline), [1.0, 3.0]);
}

#[test]
fn frames_are_those_of_the_whole_duration() {
    let timeline = timeline(&[0.0, 0.3]);
    for (fps, count) in [(10.0, 4), (30.0, 10), (1.0, 1), (0.0, 0), (-1.0, 0), (f64::NAN, 0), (f64::INFINITY, 0)] {
        assert_eq!(timeline.frames(fps).len(), count, "{fps} frames a second");
    }
    assert_eq!(timeline.frames(10.0).last().unwrap(), timeline.keys()[1].camera);
    assert_eq!(Timeline::default().frames(30.0).len(), 0);
}

#[test]
fn keys_of_other_sizes_are_seen_in_the_first_ones() {
    let mut timeline = timeline(&[0.0, 1.0]);
    timeline.insert(2.0, cameras()[2].resized([640, 640])).unwrap();
    assert!(timeline.frames(5.0).all(|camera| camera.size_px == SIZE));
    assert!((timeline.at(2.0).unwrap().focal_px.x / cameras()[2].focal_px.x - 1.0).abs() < 1e-12);
}

#[test]
fn timelines_are_camera_files_and_camera_files_timelines() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("path.json");
    let mut timeline = timeline(&[0.1, 1.0 / 3.0, 2.5]);
    timeline.set_rest(1, true);
    timeline.write(&path).unwrap();
    assert_eq!(Timeline::read(&path).unwrap(), timeline);
    let plain = crate::camera::read(&path).unwrap().cameras;
    assert_eq!(plain.iter().map(|named| &named.camera).collect::<Vec<_>>(), cameras()[..3].iter().collect::<Vec<_>>());
    crate::camera::write(&path, &plain).unwrap();
    assert_eq!(times(&Timeline::read(&path).unwrap()), [0.0, 1.0, 2.0]);
    assert!(Timeline::default().write(&path).is_err());
    let text = |second: f64| {
        let key = |seconds: f64| {
            let entry = crate::camera::to_json(&cameras()[0]);
            format!("{}, \"seconds\": {seconds}}}", entry.strip_suffix('}').unwrap())
        };
        format!("[{}, {}]", key(2.0), key(second))
    };
    for (second, expected) in [(1.0, None), (2.0, Some("cameras 0 and 1 are both at 2 s")), (-1.0, Some("camera 1:"))] {
        std::fs::write(&path, text(second)).unwrap();
        match (Timeline::read(&path), expected) {
            (Ok(timeline), None) => assert_eq!(times(&timeline), [1.0, 2.0]),
            (Err(problem), Some(expected)) => assert!(format!("{problem:#}").contains(expected), "{problem:#}"),
            (read, _) => panic!("{second}: {read:?}"),
        }
    }
}
