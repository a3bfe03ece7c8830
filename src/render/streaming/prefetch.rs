//! Where a view goes: what it will show a moment later, if it moves on as it did.

use std::collections::VecDeque;
use std::time::{Duration, Instant};

use glam::{DMat3, DQuat};

use crate::camera::Camera;

/// How far a view is followed into the future.
const AHEAD: Duration = Duration::from_millis(300);
/// The motion is that of the last views in this time: of two views alone, it would tremble.
const MEMORY: Duration = Duration::from_millis(100);
/// Two views that lie further apart are no motion.
const PAUSE: Duration = Duration::from_secs(1);
/// No view turns further than this, in radians.
const MOST_TURN: f64 = 1.0;

/// The last views.
#[derive(Default)]
pub struct Trail(VecDeque<(Instant, Camera)>);

impl Trail {
    /// Notes a view that is drawn now. Returns the one that is expected later, if the view moves.
    pub fn follow(&mut self, now: Instant, camera: &Camera) -> Option<Camera> {
        if self.0.back().is_some_and(|(_, last)| last.size_px != camera.size_px || last.focal_px != camera.focal_px) {
            self.0.clear();
        }
        // Of slow pictures, the last one is kept.
        let age = |(then, _): &(Instant, Camera)| now.duration_since(*then);
        while self.0.get(1).is_some_and(|next| age(next) >= MEMORY) || self.0.front().is_some_and(|v| age(v) > PAUSE) {
            self.0.pop_front();
        }
        self.0.push_back((now, camera.clone()));
        let (then, first) = self.0.front().filter(|(_, first)| first != camera)?;
        let took = now.duration_since(*then);
        (!took.is_zero()).then(|| moved_on(first, camera, AHEAD.div_duration_f64(took)))
    }
}

/// The view that is reached from `to` by the motion between the two, done `times` as often.
fn moved_on(from: &Camera, to: &Camera, times: f64) -> Camera {
    let turn = DQuat::from_mat3(&(to.rotation * from.rotation.transpose()));
    let (axis, angle) = turn.to_axis_angle();
    let angle = if angle > std::f64::consts::PI { angle - std::f64::consts::TAU } else { angle };
    let turn = DMat3::from_axis_angle(axis, (angle * times).clamp(-MOST_TURN, MOST_TURN));
    let position = to.position + (to.position - from.position) * times;
    Camera { position, rotation: turn * to.rotation, ..to.clone() }
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;

    #[test]
    fn a_view_goes_on_as_it_went() {
        let begun = Instant::now();
        let at = |ms: u64, turn: f64| {
            let camera = Camera::framing(DVec3::ZERO, 1.0, [64, 48]);
            let seconds = ms as f64 / 1e3;
            let position = camera.position + DVec3::new(2.0, 0.0, -1.0) * seconds;
            let rotation = DMat3::from_rotation_y(turn * seconds) * camera.rotation;
            (begun + Duration::from_millis(ms), Camera { position, rotation, ..camera })
        };
        for turn in [0.0, 1.5, -1.5] {
            let mut trail = Trail::default();
            let mut expected = None;
            for ms in (0..200).step_by(10) {
                let (now, camera) = at(ms, turn);
                expected = trail.follow(now, &camera);
                assert_eq!(expected.is_some(), ms > 0);
            }
            let (expected, (_, reached)) = (expected.unwrap(), at(490, turn));
            assert!(expected.position.distance(reached.position) < 1e-9);
            assert!((0..3).all(|i| expected.rotation.col(i).distance(reached.rotation.col(i)) < 1e-9), "{turn}");
            // It stops.
            let (now, camera) = at(190, turn);
            trail.follow(now + MEMORY, &camera);
            assert_eq!(trail.follow(now + MEMORY * 2, &camera), None);
            assert_eq!(trail.follow(now + PAUSE * 2, &at(500, turn).1), None);
        }
        // A view that turns at once is not followed around.
        let mut trail = Trail::default();
        let (now, camera) = at(0, 0.0);
        trail.follow(now, &camera);
        let turned = Camera { rotation: DMat3::from_rotation_y(2.0) * camera.rotation, ..camera.clone() };
        let far = trail.follow(now + Duration::from_millis(1), &turned).unwrap();
        let angle = DQuat::from_mat3(&(far.rotation * turned.rotation.transpose())).to_axis_angle().1;
        assert!((angle - MOST_TURN).abs() < 1e-9);
    }
}
