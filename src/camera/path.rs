//! Scripted camera paths: an orbit, with or without zoom, a turn on the spot, and a smooth path through keyframes.

use std::f64::consts::TAU;

use glam::{DMat3, DQuat, DVec3};

use super::Camera;

/// Horizontal field of view of the orbits, in radians.
const FIELD_OF_VIEW: f64 = 60.0 * TAU / 360.0;

/// `views` cameras in equal steps of one turn around the sphere at `centre`, slightly from above. The distance is 2.3
/// radii; with `zooms` it goes twice from 1.5 to 3.2 radii and back.
pub fn orbit(centre: DVec3, radius: f64, zooms: bool, size_px: [u32; 2], views: usize) -> Vec<Camera> {
    let view = |i: usize| {
        let turn = i as f64 / views as f64 * TAU;
        let zoom = if zooms { 0.8 * (2.0 * turn).sin() } else { 0.0 };
        let offset = DVec3::new(turn.cos(), -0.35, turn.sin()) * radius * (2.2 + zoom);
        Camera::looking_at(centre + offset, centre, size_px, FIELD_OF_VIEW)
    };
    (0..views).map(view).collect()
}

/// `views` cameras in equal steps of one turn on the spot, level, a tenth of `radius` above `centre`: for scenes that
/// surround the camera.
pub fn turn(centre: DVec3, radius: f64, size_px: [u32; 2], views: usize) -> Vec<Camera> {
    let position = centre - DVec3::Y * 0.1 * radius;
    let view = |i: usize| {
        let turn = i as f64 / views as f64 * TAU;
        let ahead = DVec3::new(turn.cos(), 0.0, turn.sin()) * radius;
        Camera::looking_at(position, position + ahead, size_px, FIELD_OF_VIEW)
    };
    (0..views).map(view).collect()
}

/// A camera for each eye and its target, with the field of view of the orbits.
pub fn looking(views: &[[DVec3; 2]], size_px: [u32; 2]) -> Vec<Camera> {
    views.iter().map(|[eye, target]| Camera::looking_at(*eye, *target, size_px, FIELD_OF_VIEW)).collect()
}

/// `views` cameras in equal steps from the first keyframe to the last: positions on a Catmull-Rom spline, rotations
/// along the shortest arcs, intrinsics interpolated linearly. The keyframes must have the same size.
///
/// # Panics
/// If there is no keyframe and `views` is not 0.
pub fn through(keyframes: &[Camera], views: usize) -> Vec<Camera> {
    let segments = keyframes.len().saturating_sub(1);
    let view = |i: usize| {
        let along = i as f64 / views.saturating_sub(1).max(1) as f64 * segments as f64;
        let segment = (along as usize).min(segments.saturating_sub(1));
        let key = |step: usize| &keyframes[(segment + step).saturating_sub(1).min(segments)];
        let outer = [key(0), key(3)].map(|c| c.position);
        between(outer, [key(1), key(2)], along - segment as f64)
    };
    (0..views).map(view).collect()
}

/// The view at `t` from 0 to 1 between two cameras of the same size, on the Catmull-Rom spline with the positions `p0`
/// before and `p3` after them.
pub(super) fn between([p0, p3]: [DVec3; 2], [from, to]: [&Camera; 2], t: f64) -> Camera {
    let [p1, p2] = [from, to].map(|c| c.position);
    let cubic = 3.0 * (p1 - p2) + p3 - p0;
    let square = 2.0 * p0 - 5.0 * p1 + 4.0 * p2 - p3;
    Camera { position: p1 + 0.5 * t * (p2 - p0 + t * (square + t * cubic)), ..mixed(from, to, t) }
}

/// The view at `t` from 0 to 1 on the straight line from one camera to another of the same size.
pub(super) fn mixed(from: &Camera, to: &Camera, t: f64) -> Camera {
    let [a, b] = [from, to].map(|c| DQuat::from_mat3(&c.rotation));
    Camera {
        position: from.position.lerp(to.position, t),
        rotation: DMat3::from_quat(a.slerp(b, t)),
        focal_px: from.focal_px.lerp(to.focal_px, t),
        centre_px: from.centre_px.lerp(to.centre_px, t),
        size_px: from.size_px,
        lens: from.lens.clone(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn turn_looks_level_in_every_direction_from_one_place() {
        let centre = DVec3::new(1.0, 2.0, 3.0);
        let path = turn(centre, 5.0, [64, 64], 8);
        let sum: DVec3 = path.iter().map(|camera| camera.rotation.row(2)).sum();
        assert!(sum.length() < 1e-12, "{sum}");
        for camera in &path {
            assert_eq!(camera.position, centre - DVec3::Y * 0.5);
            assert!(camera.rotation.row(2).y.abs() < 1e-12);
        }
    }

    #[test]
    fn orbit_looks_at_the_centre_from_all_around_and_zooms() {
        let centre = DVec3::new(1.0, 2.0, 3.0);
        let distances = |zooms| {
            let path = orbit(centre, 2.0, zooms, [64, 64], 100);
            assert!(path.iter().all(|c| c.view(centre).truncate().length() < 1e-9), "the centre is in the middle");
            let mean = path.iter().map(|c| c.position).sum::<DVec3>() / 100.0;
            assert!((mean - centre).truncate().x.abs() < 0.1, "all around: {mean}");
            let distances = path.iter().map(|c| c.position.distance(centre));
            distances.fold((f64::INFINITY, 0.0_f64), |(low, high), d| (low.min(d), high.max(d)))
        };
        let (low, high) = distances(false);
        assert!((high / low - 1.0).abs() < 1e-9);
        let (low, high) = distances(true);
        assert!(high / low > 2.0);
    }

    #[test]
    fn a_way_through_keyframes_meets_them_and_keeps_rotations() {
        let keys: Vec<Camera> = orbit(DVec3::ZERO, 1.0, true, [64, 64], 5);
        let path = through(&keys, 41);
        for (i, camera) in path.iter().enumerate() {
            assert!((camera.rotation.determinant() - 1.0).abs() < 1e-9);
            if i % 10 == 0 {
                let key = &keys[i / 10];
                assert!(camera.position.distance(key.position) < 1e-9, "{i}");
                assert!((camera.rotation - key.rotation).abs_diff_eq(DMat3::ZERO, 1e-9), "{i}");
            }
        }
        let step = |i: usize| path[i + 1].position.distance(path[i].position);
        assert!((0..40).map(step).fold(0.0, f64::max) < 0.5, "no jumps");
    }

    #[test]
    fn one_keyframe_is_a_path_that_stands_still() {
        let key = orbit(DVec3::ZERO, 1.0, false, [64, 64], 1);
        assert_eq!(through(&key, 3).len(), 3);
        assert!(through(&key, 3).iter().all(|c| c.position == key[0].position));
    }
}
