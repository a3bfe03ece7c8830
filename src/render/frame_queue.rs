//! The queue of frames in flight: while one is drawn, the pixels of the frames before it are copied to the host, into
//! memory that is used again.

use anyhow::{Result, bail, ensure};

use super::band::Band;
use super::capacity::MAX_ATTEMPTS;
use super::inspect::{Inspection, Inspector};
use super::pack::Packer;
use super::path::Path;
use super::recorded::{Frame, Recorded};
use super::renderer::Renderer;
use crate::camera::Camera;
use crate::gpu::{Access, Commands, Device, Handle, InFlight, Results, Staging, Timing};
use crate::pixels::{Integers, Pixels};
use crate::rules::Background;

/// The form of pixels on the host.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Form {
    /// Four floats per pixel.
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

/// The outputs of a view.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct FrameOutputs {
    /// The forms of the picture; empty if there is no picture.
    pub picture: Vec<Form>,
    /// The input of [`depths`](super::inspect::depths).
    pub depths: bool,
    /// True if the pixels stay in device memory, which [`HostFrame::handles`] hands over to other APIs.
    pub is_exported: bool,
}

impl FrameOutputs {
    /// The bytes of host memory for a view of this size.
    pub fn bytes(&self, size: [u32; 2]) -> u64 {
        self.planes().map(|form| 4 * form.words(size) as u64).sum()
    }

    fn planes(&self) -> impl Iterator<Item = Form> {
        self.picture.iter().copied().chain(self.depths.then_some(Form::Floats))
    }
}

/// Memory for the pixels of one view: of the host, or for exported pixels of the device, which only
/// [`HostFrame::handles`] reads.
#[derive(Default)]
pub struct HostFrame {
    size: [u32; 2],
    outputs: FrameOutputs,
    /// The pixels of the forms of the picture, then of the depths.
    planes: Vec<Staging<u32>>,
    /// It is for bands of any height that fit.
    is_for_bands: bool,
}

impl HostFrame {
    /// Memory for bands in this form, of all heights whose words fit into `plane`.
    pub(super) fn for_bands(form: Form, plane: Staging<u32>) -> Self {
        let outputs = FrameOutputs { picture: vec![form], ..FrameOutputs::default() };
        Self { size: [0, 0], outputs, planes: vec![plane], is_for_bands: true }
    }

    /// Allocates the memory of a view, unless it has the size and the outputs of the last one.
    fn fit(&mut self, device: &Device, outputs: &FrameOutputs, size: [u32; 2]) -> Result<()> {
        if self.is_for_bands {
            let fits = |(form, plane): (Form, &Staging<u32>)| form.words(size) <= plane.len();
            let are_fitting = self.outputs == *outputs && outputs.planes().zip(&self.planes).all(fits);
            ensure!(are_fitting, "the band does not fit into its memory");
            self.size = size;
        } else if self.size != size || self.outputs != *outputs {
            // Frees the old memory before the new is allocated.
            self.planes.clear();
            let new = if outputs.is_exported { Staging::exportable } else { Staging::new };
            let plane = |form: Form| new(device, "host frame", form.words(size));
            let planes = outputs.planes().map(plane).collect::<Result<_>>()?;
            *self = Self { size, outputs: outputs.clone(), planes, is_for_bands: false };
        }
        Ok(())
    }

    /// The bytes of the picture as integers, if these are an output.
    pub fn integers(&mut self, integers: Integers) -> Option<&[u8]> {
        let bytes = integers.bytes(self.size) as usize;
        let plane = self.outputs.picture.iter().position(|form| *form == Form::Integers(integers))?;
        Some(&bytemuck::cast_slice(self.planes[plane].map())[..bytes])
    }

    /// The picture, if its floats are an output.
    pub fn picture(&mut self) -> Option<Pixels> {
        let size = self.size;
        Some(Pixels { size, rgba: self.floats()?.to_vec() })
    }

    /// Red, green, blue and alpha of the picture, row by row, if its floats are an output.
    pub fn floats(&mut self) -> Option<&[[f32; 4]]> {
        let plane = self.outputs.picture.iter().position(|form| *form == Form::Floats)?;
        Some(bytemuck::cast_slice(self.planes[plane].map()))
    }

    /// The input of [`depths`](super::inspect::depths), if it is an output.
    pub fn depths(&mut self) -> Option<Pixels> {
        let plane = self.outputs.depths.then(|| self.planes.last_mut()).flatten()?;
        Some(Pixels { size: self.size, rgba: bytemuck::cast_slice(plane.map()).to_vec() })
    }

    /// Handles of the memory of the forms of the picture, then of the depths, if the pixels stay in device memory.
    ///
    /// # Errors
    /// If the pixels are in host memory.
    pub fn handles(&self) -> Result<Vec<Handle>> {
        self.planes.iter().map(Staging::export).collect()
    }

    /// Width and height in pixels.
    pub fn size(&self) -> [u32; 2] {
        self.size
    }
}

/// Draws frames one after another, several of which are in flight.
pub struct FrameQueue {
    device: Device,
    renderer: Renderer,
    packers: Vec<Packer>,
    depths: Option<Inspector>,
}

/// A view on the GPU.
pub struct QueuedFrame {
    camera: Camera,
    band: Option<Band>,
    background: Background,
    host: HostFrame,
    /// One or two submissions.
    commands: Vec<InFlight>,
    /// The frame of the picture, then that of the depths, if these are outputs.
    recorded: Vec<QueuedPass>,
}

/// A recorded frame of a view.
struct QueuedPass {
    path: Path,
    recorded: Recorded,
    /// The index of its submission.
    submission: usize,
}

/// A finished view.
pub struct Finished {
    /// The report of the picture, then that of the depths, if these are outputs.
    pub frames: Vec<Frame>,
    pub host: HostFrame,
}

impl FrameQueue {
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
        outputs: &FrameOutputs,
        host: HostFrame,
    ) -> Result<QueuedFrame> {
        self.start_band((camera, None), background, outputs, host)
    }

    /// Submits a band of a view, or with `None` all of it, like [`FrameQueue::start`].
    ///
    /// # Errors
    /// If memory runs out, the device is lost, or the view has no bands: [`Renderer::whole_because`].
    pub fn start_band(
        &mut self,
        (camera, band): (&Camera, Option<Band>),
        background: Background,
        outputs: &FrameOutputs,
        mut host: HostFrame,
    ) -> Result<QueuedFrame> {
        let size = band.unwrap_or(Band::whole(camera.size_px)).size(camera.size_px);
        host.fit(&self.device, outputs, size)?;
        self.prepare(outputs, size)?;
        self.renderer.set_band(band);
        let mut cmd = Commands::new(&self.device)?;
        let (mut recorded, mut commands) = (Vec::new(), Vec::new());
        if !outputs.picture.is_empty() {
            let frame = self.renderer.record(&mut cmd, camera, background)?;
            recorded.push(QueuedPass { path: self.renderer.path(), recorded: frame, submission: 0 });
            self.download_picture(&mut cmd, &host);
        }
        if outputs.depths {
            if !recorded.is_empty() {
                // Depths in slabs are drawn while they are recorded, so the copy of the picture is submitted before.
                commands.push(std::mem::replace(&mut cmd, Commands::new(&self.device)?).submit()?);
            }
            let frame = self.renderer.record_inspected(&mut cmd, camera, background, self.depths.as_ref())?;
            recorded.push(QueuedPass { path: self.renderer.path(), recorded: frame, submission: commands.len() });
            cmd.download_pixels(self.renderer.image(), host.planes.last().expect("depths have a plane"));
        }
        let camera = camera.clone();
        commands.push(cmd.submit()?);
        Ok(QueuedFrame { camera, band, background, host, commands, recorded })
    }

    /// Makes the stages and buffers that the view needs.
    fn prepare(&mut self, outputs: &FrameOutputs, size: [u32; 2]) -> Result<()> {
        for form in &outputs.picture {
            let Form::Integers(integers) = *form else { continue };
            let known = self.packers.iter().position(|packer| packer.integers() == integers);
            if known.is_none() {
                self.packers.push(Packer::new(&self.device, integers)?);
            }
            let packer = known.unwrap_or(self.packers.len() - 1);
            self.packers[packer].fit(&self.device, size)?;
        }
        if outputs.depths && self.depths.is_none() {
            self.depths = Some(self.renderer.inspector(Inspection::of_depths())?);
        }
        Ok(())
    }

    /// Records the copy of the picture to the host, in every form of the outputs.
    fn download_picture(&self, cmd: &mut Commands, host: &HostFrame) {
        let image = self.renderer.image();
        for (form, plane) in host.outputs.picture.iter().zip(&host.planes) {
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
    pub fn finish(&mut self, mut view: QueuedFrame) -> Result<Finished> {
        for attempts in 1..=MAX_ATTEMPTS {
            let QueuedFrame { camera, band, background, host, commands, recorded } = view;
            let results: Vec<Results> = commands.into_iter().map(InFlight::wait).collect::<Result<_>>()?;
            if let Some(frames) = self.judge(&results, &recorded, attempts)? {
                return Ok(Finished { frames, host });
            }
            let outputs = host.outputs.clone();
            view = self.start_band((&camera, band), background, &outputs, host)?;
        }
        bail!("the frame did not fit its buffers in {MAX_ATTEMPTS} attempts, although they grew to what it counted")
    }

    /// The reports of the frames, if all are complete.
    fn judge(&mut self, results: &[Results], passes: &[QueuedPass], attempts: u32) -> Result<Option<Vec<Frame>>> {
        // The picture is judged last: its demand on the fast path decides the next attempt.
        let judged = passes.iter().rev().map(|pass| self.renderer.judge(&results[pass.submission], &pass.recorded));
        let totals: Option<Vec<_>> = judged.collect::<Result<Vec<_>>>()?.into_iter().rev().collect();
        let all: Vec<Timing> = results.iter().flat_map(Results::timings).cloned().collect();
        let mut timings = all.as_slice();
        let mut frame = |totals, QueuedPass { path, recorded, submission }: &QueuedPass| Frame {
            totals,
            timings: recorded.take_timings(&mut timings),
            attempts,
            path: *path,
            parts: recorded.parts(),
            detail: self.renderer.detail(&results[*submission], recorded),
        };
        Ok(totals.map(|totals| totals.into_iter().zip(passes).map(|(totals, pass)| frame(totals, pass)).collect()))
    }
}
