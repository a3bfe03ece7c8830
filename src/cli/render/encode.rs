//! Encodes pictures and writes them to files, on all cores.

use std::ops::AddAssign;
use std::time::{Duration, Instant};

use anyhow::{Context, Result};

use super::Args;
use super::bands::{Bands, Parts};
use super::buffer_pool::{PooledFrame, Rgb8};
use super::outputs::{Output, Shot};
use super::records::Content;
use crate::files;
use crate::pixels::{Alpha, Pixels};
use crate::render::{Band, Frame, HostFrame, depths};

const MISSING: &str = "the pixels were not brought in this form";

/// A view of the plan and those of its files that are not complete yet.
#[derive(Clone)]
pub(super) struct Task<'p> {
    /// Its place in the plan.
    pub number: usize,
    pub shot: &'p Shot,
    pub picture: Vec<&'p Output>,
    pub depths: Vec<&'p Output>,
    /// It is a frame of a video.
    pub is_of_video: bool,
    /// The rows that are drawn, if not all are.
    pub band: Option<Band>,
}

/// The pixels of a view.
pub(super) enum Source {
    Host(PooledFrame),
    /// What was read after a wait. The memory is not used, but its owner waits for it.
    Read {
        picture: Option<Pixels>,
        depths: Option<Pixels>,
        certificate: Option<Pixels>,
        unused: PooledFrame,
    },
}

/// A view that is drawn, to be written.
pub(super) struct Job<'p> {
    pub task: Task<'p>,
    /// The frame of the picture, then that of the depths, as far as they were drawn.
    pub frames: Vec<Frame>,
    pub source: Source,
}

/// A view whose files are written.
pub(super) struct Written<'p> {
    pub task: Task<'p>,
    pub frames: Vec<Frame>,
    /// What the files hold, those of the picture first; none if it is not recorded. A file that somebody has taken away
    /// since is not known.
    pub contents: Vec<Option<Content>>,
    /// Largest bound of the certificate.
    pub certified: Option<f32>,
    /// The frame of a video, in 8 bits.
    pub rgb8: Option<Rgb8>,
    pub times: Times,
}

/// The time of a thread.
#[derive(Clone, Copy, Default)]
pub(super) struct Times {
    /// Encoding and the conversions before it.
    pub encoding: Duration,
    pub writing: Duration,
}

impl AddAssign for Times {
    fn add_assign(&mut self, other: Self) {
        self.encoding += other.encoding;
        self.writing += other.writing;
    }
}

impl<'p> Job<'p> {
    /// Writes all files of the view, and looks at them for the record of the run if that `is_recorded`. `None` if it is
    /// a band of a view of which others are missing.
    pub fn run(self, args: &Args, bands: &Bands, is_recorded: bool) -> Result<Option<Written<'p>>> {
        let Self { task, mut frames, source } = self;
        let (started, writing_before) = (Instant::now(), files::time_in_writes());
        let mut certified = None;
        let rgb8;
        match (source, task.band) {
            (Source::Host(mut frame), Some(band)) => {
                let picture = (task.number, task.shot.camera.size_px[1]);
                let complete = bands.add(picture, band, frames, &mut frame.host);
                drop(frame);
                let Some(mut complete) = complete else { return Ok(None) };
                rgb8 = None;
                task.write_parts(args, &mut complete.parts)?;
                frames = std::mem::take(&mut complete.frames);
            }
            (Source::Host(mut frame), None) => {
                task.write_host(args, &mut frame.host)?;
                rgb8 = task.is_of_video.then_some(Rgb8::Pooled(frame));
            }
            (Source::Read { picture, depths, certificate, unused: _unused }, _) => {
                rgb8 = picture.as_ref().filter(|_| task.is_of_video).map(|pixels| Rgb8::Owned(pixels.to_rgb8()));
                task.write_read(args, picture.as_ref(), depths.as_ref())?;
                if let (Some(file), Some(certificate)) = (&task.shot.certificate, certificate) {
                    certificate.write(file, Alpha::Opaque)?;
                    certified = Some(certificate.largest());
                }
            }
        }
        let written = task.picture.iter().chain(&task.depths).filter(|_| is_recorded);
        let contents = written.map(|output| Content::of(&output.path).ok()).collect();
        let writing = files::time_in_writes() - writing_before;
        let times = Times { encoding: started.elapsed().saturating_sub(writing), writing };
        Ok(Some(Written { task, frames, contents, certified, rgb8, times }))
    }
}

impl Task<'_> {
    /// True if nothing is left to draw or write.
    pub fn is_done(&self) -> bool {
        self.picture.is_empty() && self.depths.is_empty() && !self.is_of_video
    }

    fn write_host(&self, args: &Args, host: &mut HostFrame) -> Result<()> {
        let mut floats = None;
        for output in &self.picture {
            if let Some(integers) = output.integers(args.background) {
                let bytes = host.integers(integers).context(MISSING)?;
                integers.write(&output.path, self.shot.camera.size_px, &[bytes], args.compression)?;
            } else {
                if floats.is_none() {
                    floats = host.picture();
                }
                output.write_picture(floats.as_ref().context(MISSING)?, args)?;
            }
        }
        self.write_depths(args, host.depths().as_ref())
    }

    fn write_parts(&self, args: &Args, parts: &mut Parts) -> Result<()> {
        let size = self.shot.camera.size_px;
        let floats = parts.picture(size);
        for output in &self.picture {
            if let Some(integers) = output.integers(args.background) {
                let bytes = parts.integers(integers).context(MISSING)?;
                integers.write(&output.path, size, &bytes, args.compression)?;
            } else {
                output.write_picture(floats.as_ref().context(MISSING)?, args)?;
            }
        }
        self.write_depths(args, parts.depths(size).as_ref())
    }

    fn write_read(&self, args: &Args, picture: Option<&Pixels>, inspected: Option<&Pixels>) -> Result<()> {
        if let Some(pixels) = picture {
            self.picture.iter().try_for_each(|output| output.write_picture(pixels, args))?;
        }
        self.write_depths(args, inspected)
    }

    fn write_depths(&self, args: &Args, inspected: Option<&Pixels>) -> Result<()> {
        let Some(pixels) = inspected else { return Ok(()) };
        let depths = depths(pixels);
        self.depths.iter().try_for_each(|output| output.write_depths(&depths, args))
    }
}
