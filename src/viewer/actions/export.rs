//! Actions that write pictures and the frames of a path, with the same code as `smalto render`.

use std::path::PathBuf;

use anyhow::{Context, Result};
use rayon::prelude::*;

use crate::camera::Camera;
use crate::gpu::Device;
use crate::pixels::{Pixels, write_rgba8};
use crate::rules::Background;
use crate::viewer::jobs::JobEvent;
use crate::viewer::pictures::{Plan, Reusable, Side};
use crate::viewer::state::Viewer;

/// Memory for pictures that are encoded at the same time.
const AT_ONCE_BYTES: u64 = 1 << 30;

/// Draws each camera into its file. `reusable` is what the build may take over from the picture in the window.
fn write_all(
    device: &Device,
    (plan, reusable): (Plan, Option<Reusable>),
    shots: &[(Camera, PathBuf)],
    background: Background,
    progress: &dyn Fn(f64),
) -> Result<()> {
    let (first, _) = shots.first().context("there is nothing to write")?;
    let mut drawn = plan.build(device, reusable, first, background, None)?;
    let bytes = shots.iter().map(|(camera, _)| 16 * camera.size_px.map(u64::from).iter().product::<u64>()).max();
    let fit = (AT_ONCE_BYTES / bytes.unwrap_or(0).max(1)).clamp(1, rayon::current_num_threads() as u64) as usize;
    let mut done = 0;
    for shots_at_once in shots.chunks(fit) {
        let draw = |(camera, file): &'_ (Camera, PathBuf)| {
            drawn.renderer.render(camera, background)?;
            Ok((drawn.renderer.pixels()?, file.clone()))
        };
        let pictures: Vec<(Pixels, PathBuf)> = shots_at_once.iter().map(draw).collect::<Result<_>>()?;
        pictures.par_iter().try_for_each(|(pixels, file)| pixels.write(file, false))?;
        done += shots_at_once.len();
        progress(done as f64 / shots.len() as f64);
    }
    Ok(())
}

impl Viewer {
    /// Writes the view as a picture, on another thread.
    pub fn write_picture(&mut self, device: &Device, reusable: Option<Reusable>) {
        let camera = self.view();
        let camera = self.export.size.map_or_else(|| camera.clone(), |size| camera.resized(size));
        let file = self.export.next_picture();
        let summary = format!("{} written, {}x{}", file.display(), camera.size_px[0], camera.size_px[1]);
        self.write((device, reusable), vec![(camera, file)], summary);
    }

    /// Writes what the window shows without its panels, `size` pixels row by row, on another thread.
    pub fn write_screen(&mut self, size: [u32; 2], pixels: Vec<[u8; 4]>) {
        let file = self.export.next_picture();
        if file.extension().is_none_or(|ending| !ending.eq_ignore_ascii_case("png")) {
            let what = "what the window shows in place of colours is written as .png";
            return self.messages.error(format!("{}: {what}", file.display()));
        }
        let summary = format!("{} written as shown, {}x{}", file.display(), size[0], size[1]);
        self.export.progress = Some(0.0);
        self.jobs.start(move |_| write_rgba8(&file, size, &pixels).map(|()| summary), JobEvent::Written);
    }

    /// Writes the frames of the path, on another thread.
    pub fn write_film(&mut self, device: &Device, reusable: Option<Reusable>) {
        let size = self.export.size.unwrap_or(self.size);
        let folder = PathBuf::from(&self.export.folder);
        if let Err(problem) = std::fs::create_dir_all(&folder) {
            return self.messages.error(format!("cannot make the folder {}: {problem}", folder.display()));
        }
        let frames = self.film.timeline.frames(self.film.fps).enumerate();
        let shot = |(i, camera): (usize, Camera)| (camera.resized(size), folder.join(format!("{i:05}.png")));
        let shots: Vec<_> = frames.map(shot).collect();
        let summary = format!("{} frames written to {}", shots.len(), folder.display());
        self.write((device, reusable), shots, summary);
    }

    /// Writes `shots` on another thread, which reports `summary` at the end.
    fn write(
        &mut self,
        (device, reusable): (&Device, Option<Reusable>),
        shots: Vec<(Camera, PathBuf)>,
        summary: String,
    ) {
        let plan = match self.plan(Side::First) {
            Ok(Some(plan)) if !shots.is_empty() => plan,
            Ok(_) => return self.messages.note("there is nothing to write yet"),
            Err(problem) => return self.messages.error(format!("{problem:#}")),
        };
        let (device, background) = (device.clone(), self.background);
        self.export.progress = Some(0.0);
        self.jobs.start(
            move |reporter| {
                let progress = |fraction| reporter.send(JobEvent::Writing(fraction));
                write_all(&device, (plan, reusable), &shots, background, &progress).map(|()| summary)
            },
            JobEvent::Written,
        );
    }
}
