//! Frames drawn one after another without waiting for each: while one is drawn, the pixels of those before it are
//! brought to the host, into memory that is used again and again.

use anyhow::{Result, bail};

use super::inspect::{Inspection, Inspector};
use super::pack::Packer;
use super::path::Path;
use super::recorded::{Frame, Recorded};
use super::renderer::Renderer;
use super::self_test::MAX_ATTEMPTS;
use crate::camera::Camera;
use crate::gpu::{Access, Commands, Device, Handle, InFlight, Results, Staging, Timing};
use crate::pixels::{Integers, Pixels};
use crate::rules::Background;

/// The form in which pixels are brought to the host.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Form {
    /// Four floats a pixel.
    Floats,
    Integers(Integers),
}

impl Form {
    fn words(self, size: [u32; 2]) -> usize {
        match self {
            Self::Floats => size[0] as usize * size[1] as usize * 4,
            Self::Integers(integers) => integers.words(size),
        }
    }
}

/// What is wanted of a view.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Wanted {
    /// The forms of the picture; none if it is not wanted.
    pub picture: Vec<Form>,
    /// The input of [`depths`](super::inspect::depths).
    pub depths: bool,
    /// The pixels stay in device memory, which [`HostFrame::handles`] hands over to other APIs.
    pub is_exported: bool,
}

impl Wanted {
    /// Bytes of host memory for a view of this size.
    pub fn bytes(&self, size: [u32; 2]) -> u64 {
        self.planes().map(|form| 4 * form.words(size) as u64).sum()
    }

    fn planes(&self) -> impl Iterator<Item = Form> {
        self.picture.iter().copied().chain(self.depths.then_some(Form::Floats))
    }
}

/// Memory for the pixels of one view: the host's, or if that is wanted the device's, which only [`HostFrame::handles`]
/// reads.
#[derive(Default)]
pub struct HostFrame {
    size: [u32; 2],
    wanted: Wanted,
    /// Of the forms of the picture, then of the depths.
    planes: Vec<Staging<u32>>,
}

impl HostFrame {
    /// Makes room for a view, if the memory is that of another.
    fn fit(&mut self, device: &Device, wanted: &Wanted, size: [u32; 2]) -> Result<()> {
        if self.size != size || self.wanted != *wanted {
            // The old memory is free before the new is taken.
            self.planes.clear();
            let new = if wanted.is_exported { Staging::exportable } else { Staging::new };
            let plane = |form: Form| new(device, "host frame", form.words(size));
            *self = Self { size, wanted: wanted.clone(), planes: wanted.planes().map(plane).collect::<Result<_>>()? };
        }
        Ok(())
    }

    /// The bytes of the picture as integers, if they were wanted.
    pub fn integers(&mut self, integers: Integers) -> Option<&[u8]> {
        let bytes = integers.bytes(self.size) as usize;
        let plane = self.wanted.picture.iter().position(|form| *form == Form::Integers(integers))?;
        Some(&bytemuck::cast_slice(self.planes[plane].map())[..bytes])
    }

    /// The picture, if its floats were wanted.
    pub fn picture(&mut self) -> Option<Pixels> {
        let size = self.size;
        Some(Pixels { size, rgba: self.floats()?.to_vec() })
    }

    /// Red, green, blue and alpha of the picture, row by row, if its floats were wanted.
    pub fn floats(&mut self) -> Option<&[[f32; 4]]> {
        let plane = self.wanted.picture.iter().position(|form| *form == Form::Floats)?;
        Some(bytemuck::cast_slice(self.planes[plane].map()))
    }

    /// The input of [`depths`](super::inspect::depths), if it was wanted.
    pub fn depths(&mut self) -> Option<Pixels> {
        let plane = self.wanted.depths.then(|| self.planes.last_mut()).flatten()?;
        Some(Pixels { size: self.size, rgba: bytemuck::cast_slice(plane.map()).to_vec() })
    }

    /// Handles of the memory of the forms of the picture, then of the depths, if the pixels stay in device memory.
    ///
    /// # Errors
    /// If the pixels are brought to the host.
    pub fn handles(&self) -> Result<Vec<Handle>> {
        self.planes.iter().map(Staging::export).collect()
    }

    /// Width and height in pixels.
    pub fn size(&self) -> [u32; 2] {
        self.size
    }
}

/// Draws frames one after another.
pub struct Stream {
    device: Device,
    renderer: Renderer,
    packers: Vec<Packer>,
    depths: Option<Inspector>,
}

/// A view on the GPU.
pub struct Streamed {
    camera: Camera,
    background: Background,
    host: HostFrame,
    /// One or two submissions.
    commands: Vec<InFlight>,
    /// Of the picture and of the depths, as far as they are wanted, with the number of their submission.
    recorded: Vec<(Path, Recorded, usize)>,
}

/// A finished view.
pub struct Finished {
    /// The frame of the picture, then that of the depths, as far as they were wanted.
    pub frames: Vec<Frame>,
    pub host: HostFrame,
}

impl Stream {
    pub fn new(device: &Device, renderer: Renderer) -> Self {
        Self { device: device.clone(), renderer, packers: Vec::new(), depths: None }
    }

    pub fn renderer(&mut self) -> &mut Renderer {
        &mut self.renderer
    }

    /// Submits a view to the GPU without waiting for it. Its pixels go to `host`.
    ///
    /// # Errors
    /// If memory runs out or the device is lost.
    pub fn start(
        &mut self,
        camera: &Camera,
        background: Background,
        wanted: &Wanted,
        mut host: HostFrame,
    ) -> Result<Streamed> {
        host.fit(&self.device, wanted, camera.size_px)?;
        self.prepare(wanted, camera.size_px)?;
        let mut cmd = Commands::new(&self.device)?;
        let (mut recorded, mut commands) = (Vec::new(), Vec::new());
        if !wanted.picture.is_empty() {
            let frame = self.renderer.record(&mut cmd, camera, background)?;
            recorded.push((self.renderer.path(), frame, 0));
            self.bring(&mut cmd, &host);
        }
        if wanted.depths {
            if !recorded.is_empty() {
                // Where depths do not fit at once, they are drawn while they are recorded. The copy of the picture must
                // come first.
                commands.push(std::mem::replace(&mut cmd, Commands::new(&self.device)?).submit()?);
            }
            let frame = self.renderer.record_inspected(&mut cmd, camera, background, self.depths.as_ref())?;
            recorded.push((self.renderer.path(), frame, commands.len()));
            cmd.download_pixels(self.renderer.image(), host.planes.last().expect("depths have a plane"));
        }
        let camera = camera.clone();
        commands.push(cmd.submit()?);
        Ok(Streamed { camera, background, host, commands, recorded })
    }

    /// Makes the stages and buffers that the view needs.
    fn prepare(&mut self, wanted: &Wanted, size: [u32; 2]) -> Result<()> {
        for form in &wanted.picture {
            let Form::Integers(integers) = *form else { continue };
            let known = self.packers.iter().position(|packer| packer.integers() == integers);
            if known.is_none() {
                self.packers.push(Packer::new(&self.device, integers)?);
            }
            let packer = known.unwrap_or(self.packers.len() - 1);
            self.packers[packer].fit(&self.device, size)?;
        }
        if wanted.depths && self.depths.is_none() {
            self.depths = Some(self.renderer.inspector(Inspection::of_depths())?);
        }
        Ok(())
    }

    /// Records the way of the picture to the host, in every form that is wanted.
    fn bring(&self, cmd: &mut Commands, host: &HostFrame) {
        let image = self.renderer.image();
        for (form, plane) in host.wanted.picture.iter().zip(&host.planes) {
            match form {
                Form::Floats => cmd.download_pixels(image, plane),
                Form::Integers(integers) => {
                    let packer = self.packers.iter().find(|packer| packer.integers() == *integers);
                    let packer = packer.expect("packers are prepared");
                    cmd.barrier(Access::SHADER_WRITE, Access::SHADER_READ);
                    let packed = cmd.scope("pack", |cmd| packer.record(cmd, image));
                    cmd.barrier(Access::SHADER_WRITE, Access::COPY_READ);
                    cmd.download(packed, plane, integers.words(image.size()));
                }
            }
        }
    }

    /// Waits for a view. If a frame of it did not fit its buffers, it is drawn again with larger ones.
    ///
    /// # Errors
    /// If memory runs out or the device is lost.
    pub fn finish(&mut self, mut view: Streamed) -> Result<Finished> {
        for attempts in 1..=MAX_ATTEMPTS {
            let Streamed { camera, background, host, commands, recorded } = view;
            let results: Vec<Results> = commands.into_iter().map(InFlight::wait).collect::<Result<_>>()?;
            if let Some(frames) = self.judge(&results, &recorded, attempts)? {
                return Ok(Finished { frames, host });
            }
            let wanted = host.wanted.clone();
            view = self.start(&camera, background, &wanted, host)?;
        }
        bail!("the frame did not fit its buffers in {MAX_ATTEMPTS} attempts, although they grew to what it counted")
    }

    /// The reports of the frames, if all are complete.
    fn judge(
        &mut self,
        results: &[Results],
        recorded: &[(Path, Recorded, usize)],
        attempts: u32,
    ) -> Result<Option<Vec<Frame>>> {
        // The picture is judged last: what it says of the fast path holds for the next attempt.
        let judged = recorded.iter().rev().map(|(_, frame, of)| self.renderer.judge(&results[*of], frame));
        let totals: Option<Vec<_>> = judged.collect::<Result<Vec<_>>>()?.into_iter().rev().collect();
        let all: Vec<Timing> = results.iter().flat_map(Results::timings).cloned().collect();
        let mut timings = all.as_slice();
        let frame = |(totals, (path, recorded, of)): (_, &(Path, Recorded, usize))| Frame {
            totals,
            timings: recorded.timings(&take_frame(&mut timings)),
            attempts,
            path: *path,
            parts: recorded.parts(),
            detail: self.renderer.detail(&results[*of], recorded),
        };
        Ok(totals.map(|totals| totals.into_iter().zip(recorded).map(frame).collect()))
    }
}

/// Takes the timings of the next frame: up to the scope that holds all its stages, and what follows until the next
/// frame begins.
fn take_frame(timings: &mut &[Timing]) -> Vec<Timing> {
    let end = timings.iter().position(|timing| timing.depth == 0).map_or(timings.len(), |last| last + 1);
    let more = timings[end..].iter().take_while(|timing| timing.name == "pack").count();
    let (own, rest) = timings.split_at(end + more);
    *timings = rest;
    own.to_vec()
}
