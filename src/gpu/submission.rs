//! A submitted command buffer: the wait for it and its results.

use std::any::Any;
use std::marker::PhantomData;
use std::sync::Arc;

use anyhow::Result;
use ash::vk::{self, Handle as _};
use bytemuck::Pod;
use gpu_allocator::MemoryLocation;

use super::buffer::Storage;
use super::device::Shared;
use super::element::Scalar;
use super::error::{DeviceLost, describe};
use super::timings::{Scope, Timing, timings};

/// The number of timed scopes in a command buffer. Further scopes are not timed.
pub(super) const MAX_SCOPES: u32 = 64;

/// A query that is never read. Some drivers need it to be written after each other one.
pub(super) const SPARE_QUERY: u32 = 2 * MAX_SCOPES;

const QUERIES: u32 = SPARE_QUERY + 1;

/// A command pool with its one command buffer, queries and stage markers; used by one submission at a time.
#[derive(Default)]
pub(super) struct Slot {
    pool: vk::CommandPool,
    pub buffer: vk::CommandBuffer,
    pub queries: vk::QueryPool,
    /// One word per scope, set when the scope begins. None outside checked mode, and in idle slots: the device keeps
    /// idle slots, and a buffer keeps the device.
    marker: Option<Storage>,
    marked: Vec<&'static str>,
}

impl Slot {
    /// Takes an idle slot or makes a new one, and begins its command buffer.
    pub fn take(device: &Arc<Shared>) -> Result<Self> {
        let idle = device.slots.lock().expect("no holder of the slots panics").pop();
        let mut slot = idle.unwrap_or_default();
        match slot.begin(device) {
            Ok(()) => Ok(slot),
            Err(error) => {
                slot.give_back(device);
                Err(error)
            }
        }
    }

    /// Creates the objects that the slot lacks, and begins its command buffer.
    fn begin(&mut self, device: &Arc<Shared>) -> Result<()> {
        let raw = &device.raw;
        let pool = vk::CommandPoolCreateInfo::default().queue_family_index(device.capabilities.queue_family);
        let queries = vk::QueryPoolCreateInfo::default().query_type(vk::QueryType::TIMESTAMP).query_count(QUERIES);
        self.marked.clear();
        if device.checked {
            let (bytes, usage) = (u64::from(MAX_SCOPES) * 4, vk::BufferUsageFlags::TRANSFER_DST);
            let mut marker = Storage::new(device, "stage markers", bytes, usage, MemoryLocation::GpuToCpu)?;
            marker.mapped_mut().fill(0);
            self.marker = Some(marker);
        }
        // SAFETY: clauses 1, 2 and 3: the slot owns the pools until the device destroys it, and is in no submission.
        unsafe {
            if self.pool.is_null() {
                self.pool = raw.create_command_pool(&pool, None).map_err(|e| describe("vkCreateCommandPool", e))?;
            }
            if self.buffer.is_null() {
                let info = vk::CommandBufferAllocateInfo::default().command_pool(self.pool).command_buffer_count(1);
                let buffers = raw.allocate_command_buffers(&info);
                self.buffer = buffers.map_err(|e| describe("vkAllocateCommandBuffers", e))?[0];
            }
            if self.queries.is_null() {
                self.queries = raw.create_query_pool(&queries, None).map_err(|e| describe("vkCreateQueryPool", e))?;
            }
            raw.reset_command_pool(self.pool, vk::CommandPoolResetFlags::empty())
                .map_err(|e| describe("vkResetCommandPool", e))?;
            raw.reset_query_pool(self.queries, 0, QUERIES);
            let info = vk::CommandBufferBeginInfo::default().flags(vk::CommandBufferUsageFlags::ONE_TIME_SUBMIT);
            raw.begin_command_buffer(self.buffer, &info).map_err(|e| describe("vkBeginCommandBuffer", e))
        }
    }

    /// The buffer and the index of the word that mark the scope `name` as begun. None outside checked mode.
    pub fn next_mark(&mut self, name: &'static str) -> Option<(vk::Buffer, u32)> {
        let marker = self.marker.as_ref()?;
        let index = self.marked.len() as u32;
        (index < MAX_SCOPES).then(|| {
            self.marked.push(name);
            (marker.raw, index)
        })
    }

    /// The last scope that the GPU began.
    fn last_scope(&self) -> Option<&'static str> {
        let words: &[u32] = bytemuck::cast_slice(self.marker.as_ref()?.mapped());
        self.marked.iter().zip(words).rfind(|(_, word)| **word != 0).map(|(name, _)| *name)
    }

    /// Returns the slot to the device's pool. No submission uses it.
    pub fn give_back(mut self, device: &Shared) {
        self.marker = None;
        device.slots.lock().expect("no holder of the slots panics").push(self);
    }

    /// # Safety
    /// No submission uses the slot, and `device` made it.
    pub unsafe fn destroy(self, device: &ash::Device) {
        // SAFETY: the caller's promise.
        unsafe {
            device.destroy_query_pool(self.queries, None);
            device.destroy_command_pool(self.pool, None);
        }
    }
}

/// The parts of a recording that are needed until the GPU is done.
pub(super) struct Submission {
    /// Identifies the recording.
    pub recording: u64,
    pub device: Arc<Shared>,
    pub slot: Slot,
    #[expect(dead_code, reason = "held until the GPU is done")]
    pub kept: Vec<Arc<dyn Any + Send + Sync>>,
    pub scopes: Vec<Scope>,
    pub queries: u32,
    pub barriers: usize,
    pub captures: Vec<Capture>,
}

/// A copy of a buffer, taken at the end of a scope that wrote it.
pub struct Capture {
    pub(super) scope: &'static str,
    pub(super) source: Arc<Storage>,
    pub(super) copy: Arc<Storage>,
}

impl Capture {
    pub fn scope(&self) -> &'static str {
        self.scope
    }

    /// The buffer's name.
    pub fn buffer(&self) -> &str {
        &self.source.name
    }

    /// The kind of the buffer's numbers, and how many of them make an element.
    pub fn element(&self) -> (Scalar, usize) {
        (self.source.scalar, self.source.columns)
    }

    pub fn bytes(&self) -> &[u8] {
        self.copy.mapped()
    }
}

/// Commands on the GPU. Dropping it waits for them.
pub struct InFlight {
    submission: Option<Submission>,
    value: u64,
}

impl InFlight {
    /// Submits. The GPU begins after everything submitted before and after `wait`, and signals `signal` at the end.
    ///
    /// The wait for the timeline is the barrier between submissions: it makes all writes of earlier ones visible to all
    /// commands of this one. So the first frame sees how a workspace was filled, and a frame may use the buffers of the
    /// frame before again, without barriers of their own.
    pub(super) fn start(
        submission: Submission,
        wait: Option<vk::Semaphore>,
        signal: Option<vk::Semaphore>,
    ) -> Result<Self> {
        let device = submission.device.clone();
        let mut queue = device.queue.lock().expect("no holder of the queue panics");
        let (before, value) = (queue.submitted, queue.submitted + 1);
        let at = |semaphore, value| {
            let stages = vk::PipelineStageFlags2::ALL_COMMANDS;
            vk::SemaphoreSubmitInfo::default().semaphore(semaphore).value(value).stage_mask(stages)
        };
        // Binary semaphores have no value.
        let others = |semaphore: Option<vk::Semaphore>| semaphore.into_iter().map(|s| at(s, 0));
        let wait: Vec<_> = others(wait).chain([at(device.timeline, before)]).collect();
        let signal: Vec<_> = others(signal).chain([at(device.timeline, value)]).collect();
        let buffer = [vk::CommandBufferSubmitInfo::default().command_buffer(submission.slot.buffer)];
        let info = vk::SubmitInfo2::default()
            .wait_semaphore_infos(&wait)
            .signal_semaphore_infos(&signal)
            .command_buffer_infos(&buffer);
        // SAFETY: clauses 2 and 3, the queue is locked and the submission keeps what the commands use.
        let submitted = unsafe {
            let ended = device.raw.end_command_buffer(submission.slot.buffer);
            ended.map_err(|e| describe("vkEndCommandBuffer", e)).and_then(|()| {
                let submitted = device.raw.queue_submit2(queue.raw, &[info], vk::Fence::null());
                submitted.map_err(|e| describe("vkQueueSubmit2", e))
            })
        };
        if let Err(error) = submitted {
            submission.slot.give_back(&device);
            return Err(error);
        }
        queue.submitted = value;
        drop(queue);
        Ok(Self { submission: Some(submission), value })
    }

    /// True if the GPU has finished the commands, or is lost.
    pub fn is_done(&self) -> bool {
        let device = &self.submission.as_ref().expect("commands are waited for once").device;
        completed(device).is_ok_and(|value| value >= self.value)
    }

    /// Waits until the GPU is done.
    ///
    /// # Errors
    /// [`DeviceLost`] names the last stage that began, in checked mode.
    pub fn wait(mut self) -> Result<Results> {
        let submission = self.submission.take().expect("commands are waited for once");
        let waited = wait_for(&submission.device, self.value).and_then(|()| submission.ticks());
        let Submission { device, slot, scopes, captures, recording, barriers, .. } = submission;
        let last_scope = slot.last_scope();
        slot.give_back(&device);
        match waited {
            Ok(ticks) => {
                let limits = &device.capabilities.limits;
                let timings = timings(&scopes, &ticks, limits.timestamp_bits, limits.timestamp_ns);
                Ok(Results { recording, timings, last_scope, barriers, captures })
            }
            Err(vk::Result::ERROR_DEVICE_LOST) => Err(lost(&device, last_scope)),
            Err(other) => Err(describe("vkWaitSemaphores", other)),
        }
    }
}

impl Submission {
    fn ticks(&self) -> Result<Vec<u64>, vk::Result> {
        let mut ticks = vec![0; self.queries as usize];
        if !ticks.is_empty() {
            let flags = vk::QueryResultFlags::TYPE_64 | vk::QueryResultFlags::WAIT;
            // SAFETY: clause 2, the submission is done and wrote these queries.
            unsafe { self.device.raw.get_query_pool_results(self.slot.queries, 0, &mut ticks, flags)? };
        }
        Ok(ticks)
    }
}

/// The timeline value that the GPU has reached.
pub(super) fn completed(device: &Shared) -> Result<u64, vk::Result> {
    // SAFETY: clause 1.
    unsafe { device.raw.get_semaphore_counter_value(device.timeline) }
}

/// Waits for a timeline value. After an error too, the GPU has finished the commands or is lost.
fn wait_for(device: &Shared, value: u64) -> Result<(), vk::Result> {
    let (semaphores, values) = ([device.timeline], [value]);
    let info = vk::SemaphoreWaitInfo::default().semaphores(&semaphores).values(&values);
    // SAFETY: clauses 1 and 3.
    unsafe {
        device.raw.wait_semaphores(&info, u64::MAX).inspect_err(|_| {
            let _queue = device.queue.lock().expect("no holder of the queue panics");
            let _ = device.raw.device_wait_idle();
        })
    }
}

/// The error for a lost device, with its last stage and the driver's description.
fn lost(device: &Shared, last_scope: Option<&str>) -> anyhow::Error {
    let place = match last_scope {
        Some(scope) => format!("in stage {scope}"),
        None => "in an unknown stage; SMALTO_VALIDATION=1 marks the stages".to_owned(),
    };
    let fault = device.fault.as_ref().and_then(|fault| {
        let mut counts = vk::DeviceFaultCountsEXT::default();
        let mut info = vk::DeviceFaultInfoEXT::default();
        // SAFETY: clause 1; the device is lost, and without buffers only the description is written.
        let result = unsafe {
            let get = fault.fp().get_device_fault_info_ext;
            let counted = get(device.raw.handle(), &mut counts, std::ptr::null_mut());
            counts = vk::DeviceFaultCountsEXT::default();
            if counted == vk::Result::SUCCESS { get(device.raw.handle(), &mut counts, &mut info) } else { counted }
        };
        let described = matches!(result, vk::Result::SUCCESS | vk::Result::INCOMPLETE);
        let text = info.description_as_c_str().ok().filter(|_| described)?;
        Some(text.to_string_lossy().into_owned())
    });
    let fault = fault.map_or_else(String::new, |text| format!(": {text}"));
    DeviceLost(format!("the GPU was lost {place}{fault}")).into()
}

impl Drop for InFlight {
    fn drop(&mut self) {
        if let Some(submission) = self.submission.take() {
            let _ = wait_for(&submission.device, self.value);
            let Submission { device, slot, .. } = submission;
            slot.give_back(&device);
        }
    }
}

/// The results of a finished command buffer.
pub struct Results {
    recording: u64,
    timings: Vec<Timing>,
    last_scope: Option<&'static str>,
    barriers: usize,
    captures: Vec<Capture>,
}

impl Results {
    /// The timed scopes, in the order in which they ended.
    pub fn timings(&self) -> &[Timing] {
        &self.timings
    }

    /// The last scope that the GPU began; none outside checked mode.
    pub fn last_scope(&self) -> Option<&'static str> {
        self.last_scope
    }

    /// The number of barriers among the commands.
    pub fn barriers(&self) -> usize {
        self.barriers
    }

    /// The captures, in the order of the frame.
    pub fn captures(&self) -> &[Capture] {
        &self.captures
    }

    /// The elements that a [`Readback`] of these commands brought.
    ///
    /// # Panics
    /// If the readback belongs to other commands.
    pub fn view<'a, T: Pod>(&self, readback: &'a Readback<T>) -> &'a [T] {
        assert_eq!(self.recording, readback.recording, "a readback is opened with the results of its own commands");
        &bytemuck::cast_slice(readback.storage.mapped())[..readback.len]
    }
}

/// A copy of `len` elements on its way to the host. [`Results::view`] gives access to it.
pub struct Readback<T> {
    storage: Arc<Storage>,
    len: usize,
    /// The recording it belongs to.
    recording: u64,
    _element: PhantomData<T>,
}

impl<T> Readback<T> {
    pub(super) fn new(storage: Arc<Storage>, len: usize, recording: u64) -> Self {
        Self { storage, len, recording, _element: PhantomData }
    }
}
