//! The file of a camera path: a `cameras.json` in which each camera has its time (docs/side-files.md), or a
//! `camera_path.json` of nerfstudio.

use std::path::Path;

use anyhow::{Context, Result, bail, ensure};
use serde_json::{Map, Value};

use super::cameras_json::{self, Entry, Moment, without_byte_order_mark, write_entries};
use super::timeline::{Key, RESOLUTION, Timeline, check};
use super::{NamedCamera, nerfstudio_path};
use crate::files::read_whole;

/// The error for a file that is no camera path.
const NO_PATH: &str = "is no camera path: expected a cameras.json, with or without `seconds` of each camera, or a \
                       camera_path.json of nerfstudio";

impl Timeline {
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

    /// Reads a file written by [`Timeline::write`], any `cameras.json`, or a `camera_path.json` of nerfstudio. A camera
    /// without a time comes a second after the one before it.
    ///
    /// # Errors
    /// One sentence without the file's name if it is not such a file, or two of its cameras are at the same time.
    pub fn read(path: &Path) -> Result<Self> {
        Ok(Self::read_film(path)?.0)
    }

    /// As [`Timeline::read`], with the frames per second, if the file states them.
    ///
    /// # Errors
    /// Those of [`Timeline::read`].
    pub fn read_film(path: &Path) -> Result<(Self, Option<f64>)> {
        let text = read_whole(path)?;
        let text = without_byte_order_mark(&text);
        match text.iter().find(|byte| !byte.is_ascii_whitespace()) {
            Some(b'[') => Ok((Self::parse(text)?, None)),
            Some(b'{') => {
                let file: Map<String, Value> = serde_json::from_slice(text).context("is not JSON")?;
                ensure!(nerfstudio_path::is_path(&file), "{NO_PATH}");
                let (timeline, fps) = nerfstudio_path::parse(file)?;
                Ok((timeline, Some(fps)))
            }
            _ => bail!(NO_PATH),
        }
    }

    /// The cameras of the keys, with their numbers as names.
    pub(super) fn named(self) -> Vec<NamedCamera> {
        let named = |(i, key): (usize, Key)| NamedCamera::new(i.to_string(), key.camera);
        self.keys.into_iter().enumerate().map(named).collect()
    }

    fn parse(text: &[u8]) -> Result<Self> {
        let mut next = 0.0;
        let key = |(i, (named, moment)): (usize, (NamedCamera, Moment))| {
            let seconds = moment.seconds.unwrap_or(next);
            check(seconds).with_context(|| format!("camera {i}"))?;
            if let Some(lens) = &named.camera.lens {
                bail!("camera {i} has a lens ({}), and cameras of paths are pinholes", lens.model());
            }
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

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;
    use crate::camera::Camera;
    use crate::camera::path::orbit;

    fn cameras() -> Vec<Camera> {
        orbit(DVec3::new(1.0, 2.0, 3.0), 2.0, true, [64, 48], 3)
    }

    fn times(timeline: &Timeline) -> Vec<f64> {
        timeline.keys().iter().map(|key| key.seconds).collect()
    }

    #[test]
    fn keys_have_no_lens() {
        let camera = |lens: &str| crate::camera::to_json(&cameras()[0]).replace("\"fx\"", &format!("{lens}\"fx\""));
        assert!(Timeline::parse(format!("[{}]", camera("")).as_bytes()).is_ok());
        let bent = camera(r#""lens": {"model": "FISHEYE"}, "#);
        let problem = Timeline::parse(format!("[{bent}]").as_bytes()).unwrap_err();
        assert_eq!(problem.to_string(), "camera 0 has a lens (FISHEYE), and cameras of paths are pinholes");
    }

    #[test]
    fn timelines_are_camera_files_and_camera_files_timelines() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("path.json");
        let mut timeline = Timeline::default();
        for (seconds, camera) in [0.1, 1.0 / 3.0, 2.5].into_iter().zip(cameras()) {
            timeline.insert(seconds, camera).unwrap();
        }
        timeline.set_rest(1, true);
        timeline.write(&path).unwrap();
        assert_eq!(Timeline::read(&path).unwrap(), timeline);
        let plain = crate::camera::read(&path).unwrap().cameras;
        assert_eq!(plain.iter().map(|named| &named.camera).collect::<Vec<_>>(), cameras().iter().collect::<Vec<_>>());
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
        for (second, expected) in
            [(1.0, None), (2.0, Some("cameras 0 and 1 are both at 2 s")), (-1.0, Some("camera 1:"))]
        {
            std::fs::write(&path, text(second)).unwrap();
            match (Timeline::read(&path), expected) {
                (Ok(timeline), None) => assert_eq!(times(&timeline), [1.0, 2.0]),
                (Err(problem), Some(expected)) => assert!(format!("{problem:#}").contains(expected), "{problem:#}"),
                (read, _) => panic!("{second}: {read:?}"),
            }
        }
    }
}
