//! Recording a command buffer: dispatches, copies, barriers, timed scopes.

use std::any::Any;
use std::ops::Range;
use std::sync::Arc;
use std::sync::atomic::Ordering;

use anyhow::Result;
use ash::vk;
use gpu_allocator::MemoryLocation;

use super::buffer::{Buffer, Storage};
use super::device::{Device, Shared};
use super::dispatch_size::DispatchSize;
use super::element::Element;
use super::hazards::{Access, Hazards};
use super::id::next_id;
use super::image::Texture;
use super::resource::Resource;
use super::shader::{Binding, BindingKind, Bindings, Shader};
use super::stage::Stage;
use super::submission::{Capture, InFlight, Readback, Slot, Submission};
use super::timings::Scope;

/// The scopes that get timestamps. Each timestamp costs some GPU time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Timestamps {
    /// Every scope.
    All,
    /// Scopes that are not inside another scope.
    Outermost,
}

/// A command buffer being recorded. It keeps every resource that it uses alive until the GPU has finished with it.
pub struct Commands {
    pub(super) recording: u64,
    pub(super) device: Device,
    pub(super) slot: Option<Slot>,
    kept: Vec<Arc<dyn Any + Send + Sync>>,
    /// Images whose first use is in these commands.
    pub(super) fresh: Vec<Arc<Texture>>,
    hazards: Option<Hazards>,
    barriers: usize,
    overlooked_barrier: Option<usize>,
    pub(super) timestamps: Timestamps,
    pub(super) scopes: Vec<Scope>,
    pub(super) queries: u32,
    pub(super) depth: usize,
    /// Buffers written since the outermost scope began, when captures are wanted.
    pub(super) written: Option<Vec<Arc<Storage>>>,
    pub(super) captures: Vec<Capture>,
    /// The first failure inside a call that returns no error; `submit` returns it.
    pub(super) failure: Option<anyhow::Error>,
    pub(super) has_readbacks: bool,
}

impl Commands {
    /// Begins a recording.
    ///
    /// # Errors
    /// Vulkan cannot allocate a command buffer or its query pool.
    pub fn new(device: &Device) -> Result<Self> {
        let slot = Slot::take(&device.0)?;
        Ok(Self {
            recording: next_id(),
            device: device.clone(),
            slot: Some(slot),
            kept: Vec::new(),
            fresh: Vec::new(),
            hazards: device.0.checked.then(Hazards::default),
            barriers: 0,
            overlooked_barrier: None,
            timestamps: Timestamps::All,
            scopes: Vec::new(),
            queries: 0,
            depth: 0,
            written: None,
            captures: Vec::new(),
            failure: None,
            has_readbacks: false,
        })
    }

    pub fn set_timestamps(&mut self, timestamps: Timestamps) {
        self.timestamps = timestamps;
    }

    /// Hides barrier `number` (from 0) from the missing-barrier check, to test the check.
    pub fn overlook_barrier(&mut self, number: usize) {
        self.overlooked_barrier = Some(number);
    }

    /// From now on copies every buffer that a scope wrote, at the end of that scope.
    pub fn capture_scopes(&mut self) {
        self.written = Some(Vec::new());
    }

    /// Runs `stage` over `size`; an empty size records nothing.
    ///
    /// # Panics
    /// If the stage or a resource belongs to another device.
    pub fn dispatch<S: Shader>(
        &mut self,
        stage: &Stage<S>,
        bindings: S::Bindings<'_>,
        push: S::Push,
        size: DispatchSize,
    ) {
        let [x, y] = size.groups(S::WORKGROUP[0]);
        if x > 0 {
            self.bind(stage, &bindings, &push);
            // SAFETY: clauses 2 and 4; the counts are within every device's limits by FOLD.
            unsafe { self.device.0.raw.cmd_dispatch(self.raw(), x, y, 1) };
        }
    }

    /// Runs `stage` with the workgroup counts (three words) at byte `offset` of `counts`.
    ///
    /// The counts must have been written by a shader of this crate, folded like [`DispatchSize::groups`]: the GPU reads
    /// them, so nothing can check that they are within the device's limits.
    ///
    /// # Panics
    /// If the counts are not whole words inside the buffer, or something belongs to another device.
    pub fn dispatch_indirect<S: Shader, T: Element>(
        &mut self,
        stage: &Stage<S>,
        bindings: S::Bindings<'_>,
        push: S::Push,
        counts: &Buffer<T>,
        offset: usize,
    ) {
        let last = counts.bytes().checked_sub(12);
        assert!(offset.is_multiple_of(4) && last >= Some(offset as u64), "the counts lie in their buffer");
        self.bind(stage, &bindings, &push);
        self.reads(counts.resource(), S::NAME, Access::INDIRECT);
        self.keep(counts.resource());
        // SAFETY: clauses 2 and 4; the counts are written by our shaders, folded like `DispatchSize::groups`.
        unsafe { self.device.0.raw.cmd_dispatch_indirect(self.raw(), counts.storage.raw, offset as u64) };
    }

    /// Orders the commands before and after it: accesses `from` are finished and visible to later accesses `to`.
    pub fn barrier(&mut self, from: Access, to: Access) {
        if let Some(hazards) = &mut self.hazards
            && self.overlooked_barrier != Some(self.barriers)
        {
            hazards.barrier(from, to);
        }
        self.barriers += 1;
        let barrier = vk::MemoryBarrier2::default()
            .src_stage_mask(from.stages())
            .src_access_mask(from.accesses())
            .dst_stage_mask(to.stages())
            .dst_access_mask(to.accesses());
        self.pipeline_barrier(&vk::DependencyInfo::default().memory_barriers(&[barrier]));
    }

    /// Fills the whole buffer with one word.
    pub fn fill<T: Element>(&mut self, buffer: &Buffer<T>, word: u32) {
        self.writes(buffer.resource(), "fill", Access::COPY_WRITE);
        self.keep(buffer.resource());
        // SAFETY: clause 2; the whole buffer.
        unsafe { self.device.0.raw.cmd_fill_buffer(self.raw(), buffer.storage.raw, 0, vk::WHOLE_SIZE, word) };
    }

    /// Writes `len` elements of `buffer`, beginning with element `offset`. `make` writes them to a staging buffer.
    ///
    /// # Errors
    /// The staging buffer cannot be allocated.
    ///
    /// # Panics
    /// If the elements are not inside the buffer.
    pub fn upload<T: Element>(
        &mut self,
        buffer: &Buffer<T>,
        offset: usize,
        len: usize,
        make: impl FnOnce(&mut [T]),
    ) -> Result<()> {
        self.upload_together(&[(buffer, offset..offset + len)], |mut memory| make(memory.remove(0)))
    }

    /// Copies what `make` writes to the elements of a range of each of several buffers. `make` gets memory for each.
    ///
    /// # Errors
    /// The host memory for the copies cannot be allocated.
    ///
    /// # Panics
    /// If a range ends outside of its buffer.
    pub fn upload_together<T: Element>(
        &mut self,
        places: &[(&Buffer<T>, Range<usize>)],
        make: impl FnOnce(Vec<&mut [T]>),
    ) -> Result<()> {
        let usage = vk::BufferUsageFlags::TRANSFER_SRC;
        let mut staging = Vec::new();
        for (buffer, range) in places {
            let is_inside = range.start <= range.end && range.end <= buffer.len();
            assert!(is_inside, "an upload to `{}` ends inside it", buffer.name());
            let bytes = (range.len().max(1) * size_of::<T>()) as u64;
            // Cached host memory, although the device reads it: many threads write it.
            staging.push(Storage::new(&self.device.0, "upload", bytes, usage, MemoryLocation::GpuToCpu)?);
        }
        let memory = staging.iter_mut().zip(places);
        make(memory.map(|(s, (_, range))| &mut bytemuck::cast_slice_mut(s.mapped_mut())[..range.len()]).collect());
        for (staging, (buffer, range)) in staging.into_iter().zip(places).filter(|(_, (_, range))| !range.is_empty()) {
            self.writes(buffer.resource(), "upload", Access::COPY_WRITE);
            let [dst_offset, size] = [range.start, range.len()].map(|len| (len * size_of::<T>()) as u64);
            self.copy_buffer(&Arc::new(staging), &buffer.storage, vk::BufferCopy { src_offset: 0, dst_offset, size });
        }
        Ok(())
    }

    /// Copies some ranges of `values`, which are as many as the elements of a buffer, to their places in it.
    ///
    /// # Errors
    /// The host memory for the copies cannot be allocated.
    ///
    /// # Panics
    /// If there is another number of values, or a range ends outside of them.
    pub fn upload_ranges<T: Element>(
        &mut self,
        buffer: &Buffer<T>,
        values: &[T],
        ranges: &[Range<usize>],
    ) -> Result<()> {
        assert_eq!(values.len(), buffer.len(), "every element of `{}` has a value", buffer.name());
        let size = |elements: usize| (elements * size_of::<T>()) as u64;
        let (usage, all) = (vk::BufferUsageFlags::TRANSFER_SRC, ranges.iter().map(Range::len).sum::<usize>());
        if all == 0 {
            return Ok(());
        }
        let mut staging = Storage::new(&self.device.0, "upload", size(all), usage, MemoryLocation::GpuToCpu)?;
        let (memory, mut copied) = (bytemuck::cast_slice_mut::<u8, T>(staging.mapped_mut()), 0);
        let mut regions = Vec::new();
        for range in ranges.iter().filter(|range| !range.is_empty()) {
            memory[copied..copied + range.len()].copy_from_slice(&values[range.clone()]);
            let [src_offset, dst_offset, size] = [copied, range.start, range.len()].map(size);
            regions.push(vk::BufferCopy { src_offset, dst_offset, size });
            copied += range.len();
        }
        self.writes(buffer.resource(), "upload", Access::COPY_WRITE);
        self.copy_regions(&Arc::new(staging), &buffer.storage, &regions);
        Ok(())
    }

    /// Copies a buffer to another one on the device.
    ///
    /// # Panics
    /// If they have different lengths.
    pub fn copy<T: Element>(&mut self, from: &Buffer<T>, to: &Buffer<T>) {
        assert_eq!(from.len(), to.len(), "`{}` is as long as `{}`", to.name(), from.name());
        self.reads(from.resource(), "copy", Access::COPY_READ);
        self.writes(to.resource(), "copy", Access::COPY_WRITE);
        let region = vk::BufferCopy { src_offset: 0, dst_offset: 0, size: from.bytes() };
        self.copy_buffer(&from.storage, &to.storage, region);
    }

    /// Copies a buffer to the host. [`Results::view`](super::Results::view) gives its content after the wait.
    ///
    /// # Errors
    /// The memory of the copy cannot be allocated.
    pub fn read<T: Element>(&mut self, buffer: &Buffer<T>) -> Result<Readback<T>> {
        self.reads(buffer.resource(), "read back", Access::COPY_READ);
        let staging = self.readback_storage((buffer.len().max(1) * size_of::<T>()) as u64)?;
        let region = vk::BufferCopy { src_offset: 0, dst_offset: 0, size: staging.bytes };
        self.copy_buffer(&buffer.storage, &staging, region);
        Ok(Readback::new(staging, buffer.len(), self.recording))
    }

    /// Ends the recording and submits it. The GPU runs it after everything submitted before.
    ///
    /// # Errors
    /// A capture could not be allocated, or Vulkan refuses the submission.
    pub fn submit(self) -> Result<InFlight> {
        self.submit_between(None, None)
    }

    /// Like [`Commands::submit`], but begins after `wait` is signalled, and signals `signal` at the end.
    pub(super) fn submit_between(
        mut self,
        wait: Option<vk::Semaphore>,
        signal: Option<vk::Semaphore>,
    ) -> Result<InFlight> {
        if let Some(failure) = self.failure.take() {
            return Err(failure);
        }
        if self.has_readbacks {
            self.barrier(Access::COPY_WRITE, Access::HOST_READ);
        }
        let slot = self.slot.take().expect("a recording has a slot until it is submitted");
        let (kept, scopes) = (std::mem::take(&mut self.kept), std::mem::take(&mut self.scopes));
        let captures = std::mem::take(&mut self.captures);
        let (recording, device, queries) = (self.recording, self.device.0.clone(), self.queries);
        let barriers = self.barriers;
        InFlight::start(Submission { recording, device, slot, kept, scopes, queries, barriers, captures }, wait, signal)
    }

    /// Keeps `thing` alive until the commands are done.
    pub(super) fn keep_alive(&mut self, thing: Arc<dyn Any + Send + Sync>) {
        self.kept.push(thing);
    }

    pub(super) fn pipeline_barrier(&self, info: &vk::DependencyInfo<'_>) {
        // SAFETY: clause 1; barriers in a recording outside of any render pass.
        unsafe { self.device.0.raw.cmd_pipeline_barrier2(self.raw(), info) };
    }

    fn bind<S: Shader>(&mut self, stage: &Stage<S>, bindings: &S::Bindings<'_>, push: &S::Push) {
        let (mut buffers, mut images) = (Vec::new(), Vec::new());
        // A resource may be bound several times.
        let mut written = Vec::new();
        let mut declared = S::BINDINGS.iter().flat_map(|b| std::iter::repeat_n(b, b.count as usize));
        bindings.each(&mut |resource| {
            let binding = declared.next().expect("generated bindings match the generated table");
            self.keep(resource);
            if binding.reads {
                self.reads(resource, S::NAME, Access::SHADER_READ);
            }
            if binding.writes && !written.contains(&resource.id()) {
                written.push(resource.id());
                self.writes(resource, S::NAME, Access::SHADER_WRITE);
            }
            match resource {
                Resource::Buffer(storage) => {
                    buffers.push(vk::DescriptorBufferInfo { buffer: storage.raw, offset: 0, range: vk::WHOLE_SIZE });
                }
                Resource::Image(texture) => {
                    let info = vk::DescriptorImageInfo::default().image_view(texture.view);
                    images.push(info.image_layout(vk::ImageLayout::GENERAL));
                }
            }
        });
        let (mut buffers_left, mut images_left) = (&buffers[..], &images[..]);
        let write = |binding: &Binding| {
            let write = vk::WriteDescriptorSet::default()
                .dst_binding(binding.number)
                .descriptor_type(binding.kind.descriptor_type());
            let count = binding.count as usize;
            match binding.kind {
                BindingKind::Buffer => write.buffer_info(buffers_left.split_off(..count).expect("one per descriptor")),
                BindingKind::Image => write.image_info(images_left.split_off(..count).expect("one per descriptor")),
            }
        };
        let writes: Vec<_> = S::BINDINGS.iter().map(write).collect();
        let (raw, pipeline, device) = (self.raw(), &stage.pipeline, &self.device.0);
        self.owns(&pipeline.device);
        // SAFETY: clauses 2 and 4; every descriptor of the layout is written.
        unsafe {
            device.raw.cmd_bind_pipeline(raw, vk::PipelineBindPoint::COMPUTE, pipeline.raw);
            if !writes.is_empty() {
                let point = vk::PipelineBindPoint::COMPUTE;
                device.push_descriptor.cmd_push_descriptor_set(raw, point, pipeline.layout, 0, &writes);
            }
            if size_of::<S::Push>() > 0 {
                let stages = vk::ShaderStageFlags::COMPUTE;
                device.raw.cmd_push_constants(raw, pipeline.layout, stages, 0, bytemuck::bytes_of(push));
            }
        }
        self.kept.push(pipeline.clone());
    }

    /// Keeps a resource alive until the commands are done.
    pub(super) fn keep(&mut self, resource: Resource) {
        self.owns(resource.device());
        match resource {
            Resource::Buffer(storage) => self.kept.push(storage.clone()),
            Resource::Image(texture) => {
                self.make_general(texture);
                self.kept.push(texture.clone());
            }
        }
    }

    /// Panics if `device` is not the device of this recording (clause 4).
    fn owns(&self, device: &Arc<Shared>) {
        assert!(Arc::ptr_eq(device, &self.device.0), "a recording, its stages and its resources are of one device");
    }

    pub(super) fn reads(&mut self, resource: Resource, command: &str, access: Access) {
        if let Some(hazards) = &mut self.hazards
            && let Some(message) = hazards.read(resource.id(), resource.name(), command, access)
        {
            self.device.0.report(message);
        }
    }

    pub(super) fn writes(&mut self, resource: Resource, command: &str, access: Access) {
        if let (Some(written), Resource::Buffer(storage)) = (&mut self.written, resource)
            && !written.iter().any(|w| w.id == storage.id)
        {
            written.push(storage.clone());
        }
        if let Some(hazards) = &mut self.hazards
            && let Some(message) = hazards.write(resource.id(), resource.name(), command, access)
        {
            self.device.0.report(message);
        }
    }

    pub(super) fn readback_storage(&mut self, bytes: u64) -> Result<Arc<Storage>> {
        self.has_readbacks = true;
        let usage = vk::BufferUsageFlags::TRANSFER_DST;
        let storage = Storage::new(&self.device.0, "read back", bytes, usage, MemoryLocation::GpuToCpu)?;
        Ok(Arc::new(storage))
    }

    pub(super) fn copy_buffer(&mut self, from: &Arc<Storage>, to: &Arc<Storage>, region: vk::BufferCopy) {
        self.copy_regions(from, to, &[region]);
    }

    pub(super) fn copy_regions(&mut self, from: &Arc<Storage>, to: &Arc<Storage>, regions: &[vk::BufferCopy]) {
        self.keep(Resource::Buffer(from));
        self.keep(Resource::Buffer(to));
        // SAFETY: clause 2; callers checked that the regions lie in both.
        unsafe { self.device.0.raw.cmd_copy_buffer(self.raw(), from.raw, to.raw, regions) };
    }

    pub(super) fn raw(&self) -> vk::CommandBuffer {
        self.slot.as_ref().expect("a recording has a slot until it is submitted").buffer
    }
}

impl Drop for Commands {
    fn drop(&mut self) {
        if let Some(slot) = self.slot.take() {
            // Never submitted: the next use is the first.
            self.fresh.iter().for_each(|texture| texture.is_general.store(false, Ordering::Relaxed));
            slot.give_back(&self.device.0);
        }
    }
}
