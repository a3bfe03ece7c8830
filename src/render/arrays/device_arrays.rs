//! Arrays of Gaussians in device memory, and the scenes that are packed from them.

use std::ops::Range;

use anyhow::Result;

use super::examination::{Examination, HEAD, HostNeeded, MEANS};
use crate::gpu::{Access, Buffer, Commands, Device, DispatchSize, Feature, Handle, Stage, Staging};
use crate::host_memory::OutOfMemory;
use crate::options::{Options, Storage};
use crate::packing::Layout;
use crate::render::constants::stored;
use crate::render::scene::{GpuScene, Upload};
use crate::render::shaders::Examined;
use crate::render::shaders::arrays::{
    EXAMINED_GAUSSIANS, Examine, ExamineBindings, ExamineConstants, ExaminePush, Pack, PackBindings, PackConstants,
    PackPush,
};
use crate::scene::sh_coefficients;

/// Arrays of Gaussians in device memory, which another API writes: means, quaternions, scales, opacities and spherical
/// harmonics, as in [`Arrays`](crate::scene::Arrays), one after another.
pub struct DeviceArrays {
    device: Device,
    words: Buffer<u32>,
    count: usize,
    sh_degree: u32,
    examine: Stage<Examine>,
    findings: Buffer<Examined>,
    /// The first rows of the arrays on the host.
    head: Staging<u32>,
    /// The stage of the layout that was packed last.
    pack: Option<Stage<Pack>>,
}

impl DeviceArrays {
    /// Memory for arrays of `count` Gaussians, whose content is undefined.
    ///
    /// # Errors
    /// If the device has no 64-bit floats, or memory runs out.
    pub fn new(device: &Device, count: usize, sh_degree: u32) -> Result<Self> {
        Self::with(device, count, sh_degree, Buffer::new)
    }

    /// As [`new`](Self::new), in memory that other APIs open.
    ///
    /// # Errors
    /// As for [`new`](Self::new); if the device exports no memory, or a limit of memory is set.
    pub fn exportable(device: &Device, count: usize, sh_degree: u32) -> Result<Self> {
        Self::with(device, count, sh_degree, Buffer::exportable)
    }

    fn with(
        device: &Device,
        count: usize,
        sh_degree: u32,
        make: impl Fn(&Device, &str, usize) -> Result<Buffer<u32>>,
    ) -> Result<Self> {
        let capabilities = device.capabilities();
        anyhow::ensure!(capabilities.has(Feature::DoubleFloats), "{} has no 64-bit floats", capabilities.name);
        let [.., last] = parts(count, sh_degree);
        let constants = ExamineConstants { coefficients: sh_coefficients(sh_degree) as u32 };
        let head = head(count, sh_degree).iter().map(|(_, _, len)| len).sum();
        Ok(Self {
            device: device.clone(),
            words: make(device, "arrays", last.end)?,
            count,
            sh_degree,
            examine: Stage::new(device, &constants)?,
            findings: Buffer::new(device, "findings", count.div_ceil(EXAMINED_GAUSSIANS as usize))?,
            head: Staging::new(device, "head of the arrays", head)?,
            pack: None,
        })
    }

    /// A handle with which another API opens the memory.
    ///
    /// # Errors
    /// If it is not exportable, or the driver makes no handle.
    pub fn export(&self) -> Result<Handle> {
        self.words.export()
    }

    /// The words of the means, quaternions, scales, opacities and spherical harmonics in the memory.
    pub fn parts(&self) -> [Range<usize>; 5] {
        parts(self.count, self.sh_degree)
    }

    /// The memory.
    pub fn words(&self) -> &Buffer<u32> {
        &self.words
    }

    /// Examines the arrays for a renderer with these options. Waits for the device. What wrote the arrays must have
    /// finished.
    ///
    /// # Errors
    /// If memory runs out or the device is lost.
    pub fn examine(&mut self, options: &Options, upload: Upload) -> Result<Result<Examination, HostNeeded>> {
        let options = &upload.culling(options);
        if [options.sh_storage, options.shape_storage].contains(&Storage::U8) {
            return Ok(Err(HostNeeded::Bytes));
        }
        if self.count == 0 {
            return Ok(Err(HostNeeded::Empty));
        }
        let mut commands = Commands::new(&self.device)?;
        commands.scope("examine", |cmd| self.record_examine(cmd));
        commands.barrier(Access::SHADER_WRITE, Access::COPY_READ);
        let findings = commands.read(&self.findings)?;
        let parts = head(self.count, self.sh_degree);
        commands.download_parts(&self.words, &self.head, &parts);
        let results = commands.submit()?.wait()?;
        let mut rest: &[u32] = self.head.map();
        let head =
            parts.map(|(_, _, len)| bytemuck::cast_slice(rest.split_off(..len).expect("the head has all parts")));
        Ok(Examination::of(results.view(&findings), (self.count, self.sh_degree), head, options))
    }

    /// Records the examination.
    #[doc(hidden)]
    pub fn record_examine(&self, cmd: &mut Commands) {
        let bindings = ExamineBindings { words: &self.words, findings: &self.findings };
        let groups = DispatchSize::Groups(self.findings.len() as u64);
        cmd.dispatch(&self.examine, bindings, ExaminePush { gaussians: self.count as u32 }, groups);
    }

    /// The scene of the arrays, which were examined and not written since then. It has the planes of `spare` if they
    /// [fit](Examination::fits). Waits for the device.
    ///
    /// # Errors
    /// If the device is lost.
    pub fn pack(
        &mut self,
        examination: &Examination,
        spare: Option<GpuScene>,
        upload: Upload,
    ) -> Result<Result<GpuScene, HostNeeded>> {
        let made = GpuScene::unfilled(&self.device, self.count, examination.input(), spare, upload.reserve_bytes);
        let scene = match made {
            Err(error) if error.is::<OutOfMemory>() => return Ok(Err(HostNeeded::Memory)),
            made => made?,
        };
        self.prepare_pack(scene.layout())?;
        let mut commands = Commands::new(&self.device)?;
        scene.upload_grids(&mut commands)?;
        commands.scope("pack", |cmd| self.record_pack(cmd, &scene));
        commands.submit()?.wait()?;
        Ok(Ok(scene))
    }

    /// Makes the stage for scenes of this layout.
    fn prepare_pack(&mut self, layout: &Layout) -> Result<()> {
        let constants = PackConstants {
            coefficients: sh_coefficients(self.sh_degree) as u32,
            sh_degree: layout.sh_degree,
            sh_storage: stored(layout.sh),
            shape_storage: stored(layout.shape),
            ..PackConstants::default()
        };
        self.pack = Some(Stage::new(&self.device, &constants)?);
        Ok(())
    }

    /// Records the packing into a scene of the layout that was packed last.
    #[doc(hidden)]
    pub fn record_pack(&self, cmd: &mut Commands, scene: &GpuScene) {
        let bindings = PackBindings {
            words: &self.words,
            bounds: &scene.bounds,
            shapes: scene.shape_planes(),
            sh: scene.sh_planes(),
        };
        let push = PackPush {
            gaussians: self.count as u32,
            alpha_min: scene.alpha_min,
            scale_base: scene.layout().scale_base(),
        };
        let stage = self.pack.as_ref().expect("the stage was prepared");
        cmd.dispatch(stage, bindings, push, DispatchSize::Invocations(self.count as u64));
    }
}

/// The words of the arrays of `count` Gaussians.
fn parts(count: usize, sh_degree: u32) -> [Range<usize>; 5] {
    let mut end = 0;
    [3, 4, 3, 1, 3 * sh_coefficients(sh_degree)].map(|words| {
        let start = end;
        end += words * count;
        start..end
    })
}

/// The first rows of each array: first word there, first word on the host, number of words.
fn head(count: usize, sh_degree: u32) -> [(usize, usize, usize); 5] {
    let rows = [MEANS, HEAD, HEAD, HEAD, HEAD];
    let (parts, mut end) = (parts(count, sh_degree), 0);
    std::array::from_fn(|i| {
        let (words, start) = (parts[i].len() / count.max(1) * rows[i].min(count), end);
        end += words;
        (parts[i].start, start, words)
    })
}
