//! A camera path of timed keys, and the smooth motion through them.

use std::path::Path;

use anyhow::{Context, Result, ensure};
use glam::DVec3;
use serde_json::Value;

use super::cameras_json::{self, Entry, Moment, write_entries};
use super::path::between;
use super::{Camera, NamedCamera};
use crate::files::read_whole;

/// Largest time of a key.
const MAX_SECONDS: f64 = 1e6;

/// Seconds; closer times count as equal.
const RESOLUTION: f64 = 1e-6;

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
    keys: Vec<Key>,
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

    /// Writes the keys as a `cameras.json` in which each camera has a member `seconds`, and `rests` where it does.
    ///
    /// # Errors
    /// If there is no key, or the file cannot be written.
    pub fn write(&self, path: &Path) -> Result<()> {
        write_entries(path, self.entries())
    }

    fn entries(&self) -> impl ExactSizeIterator<Item = Entry> + '_ {
        self.keys.iter().enumerate().map(|(i, Key { seconds, camera, rests })| {
            let moment = Moment { seconds: Some(*seconds), rests: *rests };
            Entry::of(i, &format!("key {i}"), camera, moment)
        })
    }

    /// The keys as the array of a `cameras.json`, as [`Timeline::write`] writes it.
    pub fn to_value(&self) -> Value {
        serde_json::to_value(self.entries().collect::<Vec<_>>()).expect("numbers and names can be written as JSON")
    }

    /// The path of an array that [`Timeline::to_value`] made.
    ///
    /// # Errors
    /// Those of [`Timeline::read`].
    pub fn of_value(value: &Value) -> Result<Self> {
        match value.as_array() {
            Some(keys) if keys.is_empty() => Ok(Self::default()),
            _ => Self::parse(&serde_json::to_vec(value)?),
        }
    }

    /// Reads a file written by [`Timeline::write`], or any `cameras.json`. A camera without a time comes a second after
    /// the one before it.
    ///
    /// # Errors
    /// One sentence without the file's name if it is not such a file, or two of its cameras are at the same time.
    pub fn read(path: &Path) -> Result<Self> {
        Self::parse(&read_whole(path)?)
    }

    fn parse(text: &[u8]) -> Result<Self> {
        let mut next = 0.0;
        let key = |(i, (named, moment)): (usize, (NamedCamera, Moment))| {
            let seconds = moment.seconds.unwrap_or(next);
            check(seconds).with_context(|| format!("camera {i}"))?;
            next = seconds + 1.0;
            Ok((i, Key { seconds, camera: named.camera, rests: moment.rests }))
        };
        let keys = cameras_json::parse(text)?.into_iter().enumerate().map(key);
        let mut keys = keys.collect::<Result<Vec<_>>>()?;
        keys.sort_by(|(_, a), (_, b)| a.seconds.total_cmp(&b.seconds));
        for ((i, a), (j, b)) in keys.iter().zip(&keys[1..]) {
            ensure!(b.seconds - a.seconds >= RESOLUTION, "cameras {i} and {j} are both at {} s", a.seconds);
        }
        Ok(Self { keys: keys.into_iter().map(|(_, key)| key).collect() })
    }
}

fn check(seconds: f64) -> Result<()> {
    ensure!((0.0..=MAX_SECONDS).contains(&seconds), "a key at {seconds:?} s is not from 0 to {MAX_SECONDS:e} seconds");
    Ok(())
}

#[cfg(test)]
mod tests;
