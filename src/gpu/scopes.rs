//! Scopes of a recording: debug labels, timestamps, the marker for a lost device, and captures.

use std::ffi::CString;

use ash::vk;

use super::commands::{Commands, Timestamps};
use super::hazards::Access;
use super::resource::Resource;
use super::submission::{Capture, MAX_SCOPES, SPARE_QUERY};
use super::timings::Scope;

impl Commands {
    /// Runs `record` inside a scope: a debug label, two timestamps and a row in
    /// [`Results::timings`](super::Results::timings).
    pub fn scope<R>(&mut self, name: &'static str, record: impl FnOnce(&mut Self) -> R) -> R {
        let raw = self.raw();
        let label = CString::new(name).expect("scope names contain no zero byte");
        if let Some(debug) = &self.device.0.debug {
            // SAFETY: clause 1, the command buffer is being recorded.
            unsafe { debug.cmd_begin_debug_utils_label(raw, &vk::DebugUtilsLabelEXT::default().label_name(&label)) };
        }
        self.mark(name);
        let first_query = self.timestamp();
        self.depth += 1;
        let result = record(self);
        self.depth -= 1;
        let last_query = self.timestamp();
        if let (Some(first_query), Some(last_query)) = (first_query, last_query) {
            self.scopes.push(Scope { name, depth: self.depth, first_query, last_query });
        }
        self.capture(name);
        if let Some(debug) = &self.device.0.debug {
            // SAFETY: as above; the label was begun above.
            unsafe { debug.cmd_end_debug_utils_label(raw) };
        }
        result
    }

    /// Writes the stage marker, which tells the last stage begun after the device is lost.
    fn mark(&mut self, name: &'static str) {
        let raw = self.raw();
        let slot = self.slot.as_mut().expect("a recording has a slot until it is submitted");
        if let Some((marker, value)) = slot.next_mark(name) {
            // An execution dependency only: a memory dependency would hide a missing barrier from the validation layer.
            let order = vk::MemoryBarrier2::default()
                .src_stage_mask(vk::PipelineStageFlags2::COMPUTE_SHADER)
                .dst_stage_mask(vk::PipelineStageFlags2::ALL_TRANSFER);
            // SAFETY: clause 2, the slot lives until the submission is done; its own word of the marker buffer.
            unsafe {
                let info = vk::DependencyInfo::default().memory_barriers(std::slice::from_ref(&order));
                self.device.0.raw.cmd_pipeline_barrier2(raw, &info);
                self.device.0.raw.cmd_fill_buffer(raw, marker, u64::from(value) * 4, 4, 1);
            }
        }
    }

    fn timestamp(&mut self) -> Option<u32> {
        let limits = &self.device.0.capabilities.limits;
        let wanted = self.timestamps == Timestamps::All || self.depth == 0;
        if !wanted || limits.timestamp_bits == 0 || self.queries >= 2 * MAX_SCOPES {
            return None;
        }
        let (query, slot) = (self.queries, self.slot.as_ref().expect("a recording has a slot until it is submitted"));
        self.queries += 1;
        // SAFETY: clause 2; the query was reset when the slot was taken.
        unsafe {
            let stage = vk::PipelineStageFlags2::ALL_COMMANDS;
            self.device.0.raw.cmd_write_timestamp2(slot.buffer, stage, slot.queries, query);
            if self.device.0.capabilities.has_late_timestamps {
                self.device.0.raw.cmd_write_timestamp2(slot.buffer, stage, slot.queries, SPARE_QUERY);
                self.device.0.raw.cmd_reset_query_pool(slot.buffer, slot.queries, SPARE_QUERY, 1);
            }
        }
        Some(query)
    }

    /// Copies the buffers that the scope wrote, if captures are on.
    fn capture(&mut self, scope: &'static str) {
        let Some(written) = &mut self.written else { return };
        let written = std::mem::take(written);
        if written.is_empty() {
            return;
        }
        self.barrier(Access::SHADER_WRITE | Access::COPY_WRITE, Access::COPY_READ | Access::SHADER | Access::INDIRECT);
        for storage in written {
            let copy = match self.readback_storage(storage.bytes) {
                Ok(copy) => copy,
                Err(error) => {
                    self.failure.get_or_insert(error);
                    continue;
                }
            };
            self.reads(Resource::Buffer(&storage), "capture", Access::COPY_READ);
            self.copy_buffer(&storage, &copy, vk::BufferCopy { src_offset: 0, dst_offset: 0, size: storage.bytes });
            self.captures.push(Capture { scope, copy, source: storage });
        }
        self.barrier(Access::COPY_READ, Access::SHADER_WRITE | Access::COPY_WRITE);
    }
}
