//! A camera path of timed keys, and the smooth motion through them.

use anyhow::{Result, ensure};
use glam::DVec3;

use super::Camera;
use super::path::between;

/// Largest time of a key.
pub(super) const MAX_SECONDS: f64 = 1e6;

/// Seconds; closer times count as equal.
pub(super) const RESOLUTION: f64 = 1e-6;

/// The camera at a time.
#[derive(Clone, Debug, PartialEq)]
pub struct Key {
    /// From 0 to 1e6.
    pub seconds: f64,
    /// The view at this time.
    pub camera: Camera,
    /// The motion slows down before this key, stands still at it, and speeds up after it.
    pub rests: bool,
}

/// Keys in the order of time, no two at the same time.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Timeline {
    pub(super) keys: Vec<Key>,
}

impl Timeline {
    /// The keys in the order of time.
    pub fn keys(&self) -> &[Key] {
        &self.keys
    }

    /// Adds a key, or replaces the camera of the one at the same time. Returns its index.
    ///
    /// # Errors
    /// If `seconds` is not from 0 to 1e6.
    pub fn insert(&mut self, seconds: f64, camera: Camera) -> Result<usize> {
        check(seconds)?;
        let index = self.keys.partition_point(|key| key.seconds <= seconds - RESOLUTION);
        let replaced = self.keys.get(index).filter(|key| key.seconds < seconds + RESOLUTION).map(|key| key.rests);
        let key = Key { seconds, camera, rests: replaced.unwrap_or_default() };
        self.keys.splice(index..index + usize::from(replaced.is_some()), [key]);
        Ok(index)
    }

    /// Removes the key of this index, if there is one.
    pub fn remove(&mut self, index: usize) -> Option<Key> {
        (index < self.keys.len()).then(|| self.keys.remove(index))
    }

    /// Moves a key to another time. Returns its new index.
    ///
    /// # Errors
    /// If there is no such key, another key is at that time, or `seconds` is not from 0 to 1e6.
    pub fn retime(&mut self, index: usize, seconds: f64) -> Result<usize> {
        ensure!(index < self.keys.len(), "there is no key {index} among {}", self.keys.len());
        check(seconds)?;
        let is_taken = |(i, key): (usize, &Key)| i != index && (key.seconds - seconds).abs() < RESOLUTION;
        ensure!(!self.keys.iter().enumerate().any(is_taken), "there is a key at {seconds} s already");
        let Key { camera, rests, .. } = self.keys.remove(index);
        let index = self.insert(seconds, camera)?;
        self.keys[index].rests = rests;
        Ok(index)
    }

    /// Sets whether the motion rests at a key, if there is one of this index.
    pub fn set_rest(&mut self, index: usize, rests: bool) {
        if let Some(key) = self.keys.get_mut(index) {
            key.rests = rests;
        }
    }

    /// True if the path ends where it begins, so that it can go round and round.
    pub fn is_closed(&self) -> bool {
        self.keys.len() > 2 && self.keys[0].camera == self.keys[self.keys.len() - 1].camera
    }

    /// Seconds from the first key to the last.
    pub fn duration(&self) -> f64 {
        match (self.keys.first(), self.keys.last()) {
            (Some(first), Some(last)) => last.seconds - first.seconds,
            _ => 0.0,
        }
    }

    /// The camera at a time, in the size of the first key. Before the first key and after the last, the camera is
    /// theirs. `None` if there is no key.
    ///
    /// Positions lie on a Catmull-Rom spline whose velocity at a key is that of the parabola through the key and its
    /// neighbours in time, limited in length; the first and the last key of a closed path are one. Rotations follow
    /// the shortest arcs, intrinsics are interpolated linearly. For keys at equal intervals this is
    /// [`through`](super::path::through). Beside a key at which the motion rests, the time itself follows a cubic that
    /// stands still there.
    pub fn at(&self, seconds: f64) -> Option<Camera> {
        let size_px = self.keys.first()?.camera.size_px;
        let next = self.keys.partition_point(|key| key.seconds <= seconds);
        let (from, to) = (next.saturating_sub(1), next.min(self.keys.len() - 1));
        if from == to || self.keys[from].seconds == seconds {
            return Some(self.keys[from].camera.resized(size_px));
        }
        let [p1, p2] = [from, to].map(|i| self.keys[i].camera.position);
        let start = self.keys[from].seconds;
        let time = self.keys[to].seconds - start;
        // The neighbours with which a spline of equal intervals has these velocities.
        let outer = [p2 - 2.0 * time * self.velocity(from), p1 + 2.0 * time * self.velocity(to)];
        let ends = [from, to].map(|i| self.keys[i].camera.resized(size_px));
        // Hermite's cubic of slope 0 where the motion rests and 1 elsewhere: the time as it is if it rests nowhere.
        let t = (seconds - start) / time;
        let [slope, last_slope] = [from, to].map(|i| if self.keys[i].rests { 0.0 } else { 1.0 });
        let bent = t * t * (3.0 - 2.0 * t) + slope * t * (1.0 - t) * (1.0 - t) - last_slope * t * t * (1.0 - t);
        let t = if slope == 1.0 && last_slope == 1.0 { t } else { bent };
        Some(between(outer, [&ends[0], &ends[1]], t))
    }

    /// The velocity at a key of a path with two keys or more, in world units per second.
    fn velocity(&self, index: usize) -> DVec3 {
        let step = |from: usize| {
            let (a, b) = (&self.keys[from], &self.keys[from + 1]);
            (b.camera.position - a.camera.position, b.seconds - a.seconds)
        };
        let last = self.keys.len() - 1;
        let is_end = index == 0 || index == last;
        // At the ends of the path, as if the key were doubled.
        if is_end && !self.is_closed() {
            let (way, time) = step(index.min(last - 1));
            return way / (2.0 * time);
        }
        let [before, after] = if is_end { [last - 1, 0] } else { [index - 1, index] };
        let ((before, time_before), (after, time_after)) = (step(before), step(after));
        let share = time_after / (time_before + time_after);
        let parabola = before / time_before * share + after / time_after * (1.0 - share);
        // A fast segment must not make a slow neighbour overshoot. A velocity up to three times the mean speed of a
        // segment does not turn back in it (Fritsch and Carlson 1980); the other limit is the velocity at equal
        // intervals.
        let even = ((before + after) / 2.0).length();
        let limit = |way: DVec3, time: f64| even.max(3.0 * way.length()) / time;
        parabola.clamp_length_max(limit(before, time_before).min(limit(after, time_after)))
    }

    /// The cameras of a film, one every `1 / fps` seconds from the first key to the last. None if `fps` is not positive
    /// and finite.
    pub fn frames(&self, fps: f64) -> impl ExactSizeIterator<Item = Camera> + '_ {
        // A duration that rounding makes slightly shorter than a whole number of frames still gets its last frame.
        let steps = (self.duration() * fps + 1e-6) as usize;
        let is_any = fps > 0.0 && fps.is_finite() && !self.keys.is_empty();
        let count = if is_any { steps + 1 } else { 0 };
        let frame = move |i| self.at(self.keys[0].seconds + i as f64 / fps).expect("a path with frames has keys");
        (0..count).map(frame)
    }
}

pub(super) fn check(seconds: f64) -> Result<()> {
    ensure!((0.0..=MAX_SECONDS).contains(&seconds), "a key at {seconds:?} s is not from 0 to {MAX_SECONDS:e} seconds");
    Ok(())
}

#[cfg(test)]
mod tests {
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
}
