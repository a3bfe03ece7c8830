//! Prediction of the camera's motion, so that pages are prefetched for the view it is about to reach.

use std::collections::VecDeque;
use std::time::{Duration, Instant};

use glam::{DMat3, DQuat};

use crate::camera::Camera;

/// Time by which the motion is extrapolated.
const HORIZON: Duration = Duration::from_millis(300);
/// The motion is estimated over this time: the difference of two frames alone is too noisy.
const WINDOW: Duration = Duration::from_millis(100);
/// Frames that are further apart are not one motion.
const PAUSE: Duration = Duration::from_secs(1);
/// Largest predicted turn, in radians.
const MAX_TURN: f64 = 1.0;

/// The cameras of the last frames, with the times at which they were drawn.
#[derive(Default)]
pub struct CameraMotion(VecDeque<(Duration, Camera)>);

/// The clock by which the motion is measured.
pub enum MotionClock {
    /// The time since this moment.
    Since(Instant),
    /// A time that a test sets.
    #[cfg(test)]
    Fixed(Duration),
}

impl Default for MotionClock {
    fn default() -> Self {
        Self::Since(Instant::now())
    }
}

impl MotionClock {
    pub fn now(&self) -> Duration {
        match self {
            Self::Since(start) => start.elapsed(),
            #[cfg(test)]
            Self::Fixed(time) => *time,
        }
    }
}

impl CameraMotion {
    /// Records the camera of a frame drawn at `now`, a time of the [`MotionClock`]. Returns the camera
    /// expected after [`HORIZON`] if it moves.
    pub fn predict(&mut self, now: Duration, camera: &Camera) -> Option<Camera> {
        if self.0.back().is_some_and(|(_, last)| last.size_px != camera.size_px || last.focal_px != camera.focal_px) {
            self.0.clear();
        }
        // At low frame rates, the last frame stays, although it is older than the window.
        let age = |(then, _): &(Duration, Camera)| now.saturating_sub(*then);
        while self.0.get(1).is_some_and(|next| age(next) >= WINDOW) || self.0.front().is_some_and(|v| age(v) > PAUSE) {
            self.0.pop_front();
        }
        self.0.push_back((now, camera.clone()));
        let (then, first) = self.0.front().filter(|(_, first)| first != camera)?;
        let elapsed = now.saturating_sub(*then);
        (!elapsed.is_zero()).then(|| extrapolated(first, camera, HORIZON.div_duration_f64(elapsed)))
    }
}

/// The camera after `times` times the motion from `from` to `to`, starting at `to`.
fn extrapolated(from: &Camera, to: &Camera, times: f64) -> Camera {
    let turn = DQuat::from_mat3(&(to.rotation * from.rotation.transpose()));
    let (axis, angle) = turn.to_axis_angle();
    let angle = if angle > std::f64::consts::PI { angle - std::f64::consts::TAU } else { angle };
    let turn = DMat3::from_axis_angle(axis, (angle * times).clamp(-MAX_TURN, MAX_TURN));
    let position = to.position + (to.position - from.position) * times;
    Camera { position, rotation: turn * to.rotation, ..to.clone() }
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;

    #[test]
    fn a_steady_motion_is_extrapolated() {
        let at = |ms: u64, turn: f64| {
            let camera = Camera::framing(DVec3::ZERO, 1.0, [64, 48]);
            let seconds = ms as f64 / 1e3;
            let position = camera.position + DVec3::new(2.0, 0.0, -1.0) * seconds;
            let rotation = DMat3::from_rotation_y(turn * seconds) * camera.rotation;
            (Duration::from_millis(ms), Camera { position, rotation, ..camera })
        };
        for turn in [0.0, 1.5, -1.5] {
            let mut motion = CameraMotion::default();
            let mut expected = None;
            for ms in (0..200).step_by(10) {
                let (now, camera) = at(ms, turn);
                expected = motion.predict(now, &camera);
                assert_eq!(expected.is_some(), ms > 0);
            }
            let (expected, (_, reached)) = (expected.unwrap(), at(490, turn));
            assert!(expected.position.distance(reached.position) < 1e-9);
            assert!((0..3).all(|i| expected.rotation.col(i).distance(reached.rotation.col(i)) < 1e-9), "{turn}");
            // The camera stops.
            let (now, camera) = at(190, turn);
            motion.predict(now + WINDOW, &camera);
            assert_eq!(motion.predict(now + WINDOW * 2, &camera), None);
            assert_eq!(motion.predict(now + PAUSE * 2, &at(500, turn).1), None);
        }
    }

    #[test]
    fn the_predicted_turn_is_limited() {
        let camera = Camera::framing(DVec3::ZERO, 1.0, [64, 48]);
        let mut motion = CameraMotion::default();
        motion.predict(Duration::ZERO, &camera);
        let turned = Camera { rotation: DMat3::from_rotation_y(2.0) * camera.rotation, ..camera };
        let far = motion.predict(Duration::from_millis(1), &turned).unwrap();
        let angle = DQuat::from_mat3(&(far.rotation * turned.rotation.transpose())).to_axis_angle().1;
        assert!((angle - MAX_TURN).abs() < 1e-9);
    }
}
