//! The start of a run: the scene is read while the device is opened, and the phases up to the first picture are timed.

use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use anyhow::Result;
use schemars::JsonSchema;
use serde::Serialize;

use super::Args;
use super::bands::Share;
use crate::cli::drawable::Drawable;
use crate::cli::say;
use crate::gpu::Device;
use crate::threads::{self, joined};

/// The times of the phases from the command to the first picture.
pub(super) struct Start {
    begun: Instant,
    ended: Mutex<Vec<PhaseReport>>,
}

/// A phase of the start. The device is opened while the scene is read; every other phase begins when the one before it
/// ended.
#[derive(Clone, Serialize, JsonSchema)]
pub(super) struct PhaseReport {
    /// device, reading, layout (cameras, statistics of the scene), upload, pipelines, trial or first picture.
    pub name: String,
    /// Milliseconds that it took.
    pub ms: f64,
    /// Milliseconds from the begin of the program to its end.
    pub end_ms: f64,
}

impl Default for Start {
    fn default() -> Self {
        Self { begun: Instant::now(), ended: Mutex::default() }
    }
}

impl Start {
    /// Notes that a phase ends now, which began when the last one ended. Only its first end counts.
    pub fn end(&self, name: &str) {
        self.end_with(name, None);
    }

    /// Notes that a phase ends now, whose last part of this length was a phase of its own.
    pub fn end_with(&self, name: &str, last: Option<(&str, Duration)>) {
        let now = self.begun.elapsed();
        let Some((last, length)) = last else { return self.add(name, self.latest(), now) };
        self.add(name, self.latest(), now - length);
        self.add(last, now - length, now);
    }

    /// The phases in the order of their ends.
    pub fn phases(&self) -> Vec<PhaseReport> {
        let mut phases = self.ended.lock().expect("no holder of the phases panics").clone();
        phases.sort_by(|a, b| a.end_ms.total_cmp(&b.end_ms));
        phases
    }

    /// Prints the phases.
    pub fn say(&self) -> Result<()> {
        let phases = self.phases();
        let Some(last) = phases.last() else { return Ok(()) };
        say!("from the command to the end of the {}: {:.0} ms", last.name, last.end_ms)?;
        phases.iter().try_for_each(|p| say!("  {:<13} {:8.1} ms, until {:8.1} ms", p.name, p.ms, p.end_ms))
    }

    fn latest(&self) -> Duration {
        self.phases().last().map_or(Duration::ZERO, |phase| Duration::from_secs_f64(phase.end_ms / 1e3))
    }

    fn add(&self, name: &str, from: Duration, until: Duration) {
        let ms = |time: Duration| 1e3 * time.as_secs_f64();
        let mut ended = self.ended.lock().expect("no holder of the phases panics");
        if ended.iter().all(|phase| phase.name != name) {
            let (took, end_ms) = (until.saturating_sub(from), ms(until));
            ended.push(PhaseReport { name: name.to_owned(), ms: ms(took), end_ms });
        }
    }
}

/// Opens the devices and reads the scene, at the same time if that is a file. Without a device it fails at once. The
/// reference has no devices.
pub(super) fn devices_and_scene(args: &Args) -> Result<(Vec<Device>, Drawable)> {
    if let Some(scene) = Drawable::in_pages(&args.scene, false)?.filter(|_| !args.reference) {
        args.start.end("reading");
        return Ok((open(args, usize::MAX)?, scene));
    }
    if args.knobs.wants_levels() && args.scene.file_with_levels().is_some() {
        let devices = open(args, usize::MAX)?;
        let scene = Drawable::read(&args.scene, true, devices.first())?;
        args.start.end("reading");
        return Ok((devices, scene));
    }
    // Opening another device takes longer than a picture of a scene in memory.
    let most = if args.share != Share::Frame && args.is_of_one_picture() { 1 } else { usize::MAX };
    // A scene from a pipe cannot be cancelled. The device may refuse a procedural one.
    if args.reference || args.scene.path().is_none() {
        let devices = if args.reference { Vec::new() } else { open(args, most)? };
        let scene = args.scene.read_for(devices.first())?;
        args.start.end("reading");
        return Ok((devices, Drawable::of(&args.scene, scene)));
    }
    let is_cancelled = AtomicBool::new(false);
    let (devices, scene) = threads::scope(|threads| -> Result<_> {
        let reading = threads.spawn(|| {
            let scene = args.scene.read_unless(&|| is_cancelled.load(Ordering::Relaxed));
            args.start.add("reading", Duration::ZERO, args.start.begun.elapsed());
            scene
        })?;
        let devices = open(args, most);
        is_cancelled.store(devices.is_err(), Ordering::Relaxed);
        Ok((devices, joined(reading)))
    })?;
    let (devices, scene) = (devices?, scene?);
    args.scene.remark(&scene);
    Ok((devices, Drawable::of(&args.scene, scene)))
}

fn open(args: &Args, most: usize) -> Result<Vec<Device>> {
    let devices = args.device.open(most)?;
    args.start.add("device", Duration::ZERO, args.start.begun.elapsed());
    Ok(devices)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn phases_are_in_the_order_of_their_ends_and_follow_each_other() {
        let start = Start::default();
        let ms = Duration::from_millis;
        start.add("reading", ms(0), ms(30));
        start.add("device", ms(0), ms(20));
        std::thread::sleep(ms(60));
        start.end_with("pipelines", Some(("trial", ms(10))));
        start.end("first picture");
        start.end("first picture");
        let phases = start.phases();
        let names: Vec<_> = phases.iter().map(|phase| phase.name.as_str()).collect();
        assert_eq!(names, ["device", "reading", "pipelines", "trial", "first picture"]);
        for pair in phases[1..].windows(2) {
            assert!((pair[1].end_ms - pair[1].ms - pair[0].end_ms).abs() < 1e-3, "{} follows", pair[1].name);
        }
        assert!((phases[3].ms - 10.0).abs() < 1e-3);
    }
}
