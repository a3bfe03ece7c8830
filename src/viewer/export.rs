//! Pictures and films to files, by the same code as `smalto render`.

use std::path::PathBuf;

use anyhow::{Context, Result};

use super::jobs::{News, Side};
use super::pictures::{Kept, Plan};
use super::state::Viewer;
use crate::camera::Camera;
use crate::gpu::Device;
use crate::rules::Background;

/// What is written next.
pub struct Export {
    /// Width and height; none for the window's.
    pub size: Option<[u32; 2]>,
    pub picture: String,
    /// The folder of a film's frames.
    pub folder: String,
    /// The fraction done, while frames are written.
    pub progress: Option<f64>,
}

impl Default for Export {
    fn default() -> Self {
        Self { size: None, picture: "view.png".to_owned(), folder: "film".to_owned(), progress: None }
    }
}

/// Draws each camera into its file; takes over what `before` has of the plan already.
fn write_all(
    device: &Device,
    (plan, before): (Plan, Option<Kept>),
    shots: &[(Camera, PathBuf)],
    background: Background,
    progress: &dyn Fn(f64),
) -> Result<()> {
    let (first, _) = shots.first().context("there is nothing to write")?;
    let mut drawn = plan.build(device, before, first, background, 0)?;
    for (done, (camera, file)) in shots.iter().enumerate() {
        drawn.still.render(camera, background)?;
        drawn.still.pixels()?.write(file, false)?;
        progress((done + 1) as f64 / shots.len() as f64);
    }
    Ok(())
}

impl Viewer {
    /// Writes the view as a picture.
    pub fn write_picture(&mut self, device: &Device, before: Option<Kept>) {
        let camera = self.view();
        let camera = self.export.size.map_or_else(|| camera.clone(), |size| camera.resized(size));
        let file = PathBuf::from(&self.export.picture);
        let story = format!("{} written, {}x{}", file.display(), camera.size_px[0], camera.size_px[1]);
        self.write((device, before), vec![(camera, file)], story);
    }

    /// Writes the frames of the path.
    pub fn write_film(&mut self, device: &Device, before: Option<Kept>) {
        let size = self.export.size.unwrap_or(self.size);
        let folder = PathBuf::from(&self.export.folder);
        if let Err(problem) = std::fs::create_dir_all(&folder) {
            return self.messages.error(format!("cannot make the folder {}: {problem}", folder.display()));
        }
        let frames = self.film.timeline.frames(self.film.fps).enumerate();
        let shot = |(i, camera): (usize, Camera)| (camera.resized(size), folder.join(format!("{i:05}.png")));
        let shots: Vec<_> = frames.map(shot).collect();
        let story = format!("{} frames written to {}", shots.len(), folder.display());
        self.write((device, before), shots, story);
    }

    fn write(&mut self, (device, before): (&Device, Option<Kept>), shots: Vec<(Camera, PathBuf)>, story: String) {
        let plan = match self.plan(Side::First) {
            Ok(Some(plan)) if !shots.is_empty() => plan,
            Ok(_) => return self.messages.note("there is nothing to write yet"),
            Err(problem) => return self.messages.error(format!("{problem:#}")),
        };
        let (device, background) = (device.clone(), self.background);
        self.export.progress = Some(0.0);
        self.jobs.start(
            move |reporter| {
                let progress = |fraction| reporter.tell(News::Writing(fraction));
                write_all(&device, (plan, before), &shots, background, &progress).map(|()| story)
            },
            News::Written,
        );
    }
}
