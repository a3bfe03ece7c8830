//! Actions that write pictures and the frames of a path, with the same code as `smalto render`.

use std::path::{Path, PathBuf};

use anyhow::{Context, Error, Result};
use rayon::prelude::*;

use crate::camera::Camera;
use crate::files::{make_folder, write_checked};
use crate::gpu::Device;
use crate::pixels::{Alpha, Pixels, Video, has_ffmpeg, is_video, write_rgba8};
use crate::render::{Inspection, depths};
use crate::rules::Background;
use crate::scene::Cancelled;
use crate::viewer::jobs::Cancel;
use crate::viewer::model::{Drawn, JobEvent, Plan, Reusable, Side, Viewer};

/// Memory for pictures that are encoded in parallel.
const PARALLEL_BYTES: u64 = 1 << 30;

/// The destination of pictures.
enum Output {
    /// A file for each.
    Files(Vec<PathBuf>),
    /// One OpenEXR file with colours, coverage and depth.
    Layers(PathBuf),
    /// One video with this number of frames a second.
    Video(PathBuf, f64),
}

/// Pictures to draw, and their destination.
struct Shots {
    cameras: Vec<Camera>,
    output: Output,
    background: Background,
}

impl Shots {
    /// Draws all pictures. The build may reuse parts of the picture in the window. `progress` receives the fraction
    /// that is written, and returns true to cancel the rest.
    fn write(
        &self,
        device: &Device,
        (plan, reusable): (Plan, Option<Reusable>),
        progress: &dyn Fn(f64) -> bool,
    ) -> Result<()> {
        let first = self.cameras.first().context("there is nothing to write")?;
        let mut drawn = plan.build(device, reusable, first, self.background, None)?;
        match &self.output {
            Output::Files(files) => self.draw(&mut drawn, progress, |begin, pictures| {
                pictures
                    .par_iter()
                    .zip(&files[begin..])
                    .try_for_each(|(pixels, file)| pixels.write(file, Alpha::Opaque))
            }),
            Output::Layers(file) => {
                drawn.renderer.render(first, self.background)?;
                let picture = drawn.renderer.pixels()?;
                drawn.renderer.set_inspection(Inspection::of_depths())?;
                drawn.renderer.render(first, self.background)?;
                let depth = depths(&drawn.renderer.pixels()?).expected;
                picture.write_with_depth(&depth, file)?;
                progress(1.0);
                Ok(())
            }
            // ffmpeg itself writes the temporary file.
            Output::Video(file, fps) => {
                let ending = format!(".{}", file.extension().unwrap_or_default().to_string_lossy());
                write_checked(
                    file,
                    &ending,
                    |_| Ok(()),
                    |part| {
                        let mut video = Video::start(part, first.size_px, &fps.to_string())?;
                        self.draw(&mut drawn, progress, |_, pictures| {
                            let frames: Vec<_> = pictures.par_iter().map(Pixels::to_rgb8).collect();
                            frames.iter().try_for_each(|frame| video.add(frame))
                        })?;
                        video.finish()
                    },
                )
            }
        }
    }

    /// Draws all pictures, and passes them to `take` in batches, with the number of the first.
    fn draw(
        &self,
        drawn: &mut Drawn,
        progress: &dyn Fn(f64) -> bool,
        mut take: impl FnMut(usize, &[Pixels]) -> Result<()>,
    ) -> Result<()> {
        let bytes = |camera: &Camera| 16 * camera.size_px.map(u64::from).iter().product::<u64>();
        let largest = self.cameras.iter().map(bytes).max().unwrap_or(0).max(1);
        let fit = (PARALLEL_BYTES / largest).clamp(1, rayon::current_num_threads() as u64) as usize;
        let count = self.cameras.len();
        let mut done = 0;
        for cameras in self.cameras.chunks(fit) {
            let mut draw = |camera: &Camera| {
                drawn.renderer.render(camera, self.background)?;
                drawn.renderer.pixels()
            };
            let pictures: Vec<Pixels> = cameras.iter().map(&mut draw).collect::<Result<_>>()?;
            take(done, &pictures)?;
            done += cameras.len();
            if progress(done as f64 / count as f64) && done < count {
                return Err(Error::from(Cancelled).context(format!("after {done} of {count} pictures")));
            }
        }
        Ok(())
    }
}

/// Most frames of a film: an hour of 30 a second.
const MAX_FRAMES: usize = 108_000;

impl Viewer {
    /// Says that there is nothing to write, or that it is not written any more.
    pub fn write_nothing(&mut self, why: impl Into<String>) {
        let why = why.into();
        self.export.failure = Some(why.clone());
        self.messages.note(why);
    }

    /// Says why something cannot be written.
    pub fn fail_to_write(&mut self, why: impl Into<String>) {
        let why = why.into();
        self.export.failure = Some(why.clone());
        self.messages.error(why);
    }

    /// Starts to write the view as a picture, to this file or to the next one that is free.
    pub fn write_picture(&mut self, device: &Device, reusable: Option<Reusable>, file: Option<PathBuf>) {
        let camera = self.view.camera();
        let camera = self.export.size.map_or_else(|| camera.clone(), |size| camera.resized(size));
        let file = file.unwrap_or_else(|| self.export.next_picture());
        let summary = format!("{} written, {}x{}", file.display(), camera.size_px[0], camera.size_px[1]);
        let is_exr = file.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("exr"));
        let output = if is_exr && self.export.has_layers { Output::Layers(file) } else { Output::Files(vec![file]) };
        self.write((device, reusable), vec![camera], output, summary);
    }

    /// Starts to write the picture as shown in the window, without panels: `size` pixels row by row.
    pub fn write_screen(&mut self, size: [u32; 2], pixels: Vec<[u8; 4]>, file: Option<PathBuf>) {
        let name = file.as_ref().map_or_else(|| self.export.picture.clone(), |file| file.display().to_string());
        if Path::new(&name).extension().is_none_or(|ending| !ending.eq_ignore_ascii_case("png")) {
            let text = format!("{name}: what the window shows in place of colours is written as .png");
            return self.fail_to_write(text);
        }
        let file = file.unwrap_or_else(|| self.export.next_picture());
        let summary = format!("{} written as shown, {}x{}", file.display(), size[0], size[1]);
        self.export.progress = Some(0.0);
        self.jobs.start(move |_| write_rgba8(&file, size, &pixels).map(|()| summary), JobEvent::Written);
    }

    /// Starts to write the frames of the path: as a video or as numbered pictures in an empty folder, of this name
    /// or the next one that is free.
    pub fn write_film(&mut self, device: &Device, reusable: Option<Reusable>, file: Option<PathBuf>) {
        let size = self.export.size.unwrap_or(self.view.size);
        let count = self.film.timeline.frames(self.film.fps).len();
        if count == 0 {
            return self.write_nothing("there is no path to write: add keys to it");
        }
        if count > MAX_FRAMES {
            return self.fail_to_write(format!("this film has {count} frames: {MAX_FRAMES} are the most"));
        }
        let file = match file.map(|file| self.export.given_film(file)).transpose() {
            Ok(given) => given.unwrap_or_else(|| self.export.next_film()),
            Err(why) => return self.fail_to_write(why),
        };
        let cameras: Vec<_> = self.film.timeline.frames(self.film.fps).map(|camera| camera.resized(size)).collect();
        if is_video(&file) {
            if !has_ffmpeg() {
                let what = "a video needs ffmpeg, which is not installed: name a folder, and its frames are written";
                return self.fail_to_write(what);
            }
            let summary = format!("{} written, {count} frames", file.display());
            return self.write((device, reusable), cameras, Output::Video(file, self.film.fps), summary);
        }
        let folder = file;
        if let Err(problem) = make_folder(&folder) {
            return self.fail_to_write(format!("{problem:#}"));
        }
        let files = (0..count).map(|i| folder.join(format!("{i:05}.png"))).collect();
        let summary = format!("{count} frames written to {}", folder.display());
        self.write((device, reusable), cameras, Output::Files(files), summary);
    }

    /// Starts a job that writes pictures, and reports `summary` at the end.
    fn write(
        &mut self,
        (device, reusable): (&Device, Option<Reusable>),
        cameras: Vec<Camera>,
        output: Output,
        summary: String,
    ) {
        let plan = match self.plan(Side::First) {
            Ok(Some(plan)) => plan,
            Ok(None) => return self.write_nothing("there is nothing to write yet"),
            Err(problem) => return self.fail_to_write(format!("{problem:#}")),
        };
        let (device, background) = (device.clone(), self.view.background);
        let cancel = Cancel::default();
        self.export.progress = Some(0.0);
        self.export.cancel = cancel.clone();
        self.jobs.start(
            move |reporter| {
                let progress = |fraction| {
                    reporter.send(JobEvent::Writing(fraction));
                    cancel.is_cancelled()
                };
                Shots { cameras, output, background }.write(&device, (plan, reusable), &progress).map(|()| summary)
            },
            JobEvent::Written,
        );
    }
}
