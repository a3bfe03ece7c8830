//! The missing-barrier check: reports a command that uses what an earlier one wrote without a barrier between them.
//!
//! Reflection tells which shader reads and writes a resource, so the check needs no annotations. It works on whole
//! resources, not on ranges, and within one command buffer: the timeline semaphore orders submissions.

use std::collections::HashMap;

use ash::vk;
use bitflags::bitflags;

/// Drawn triangles are blended with the image, so drawing reads it too.
const DRAWN: vk::AccessFlags2 = vk::AccessFlags2::from_raw(
    vk::AccessFlags2::COLOR_ATTACHMENT_READ.as_raw() | vk::AccessFlags2::COLOR_ATTACHMENT_WRITE.as_raw(),
);

bitflags! {
    /// The accesses before or after a barrier, named by use.
    #[derive(Clone, Copy, Debug, PartialEq, Eq)]
    pub struct Access: u32 {
        const SHADER_READ = 1;
        const SHADER_WRITE = 1 << 1;
        /// The workgroup counts of an indirect dispatch.
        const INDIRECT = 1 << 2;
        const COPY_READ = 1 << 3;
        /// The target of a copy or a fill.
        const COPY_WRITE = 1 << 4;
        const HOST_READ = 1 << 5;
        /// Triangles over an image.
        const DRAW = 1 << 6;
        /// The accesses of a shader to a buffer that it updates.
        const SHADER = Self::SHADER_READ.bits() | Self::SHADER_WRITE.bits();
    }
}

impl Access {
    const VULKAN: [(Self, vk::PipelineStageFlags2, vk::AccessFlags2); 7] = [
        (Self::SHADER_READ, vk::PipelineStageFlags2::COMPUTE_SHADER, vk::AccessFlags2::SHADER_READ),
        (Self::SHADER_WRITE, vk::PipelineStageFlags2::COMPUTE_SHADER, vk::AccessFlags2::SHADER_WRITE),
        (Self::INDIRECT, vk::PipelineStageFlags2::DRAW_INDIRECT, vk::AccessFlags2::INDIRECT_COMMAND_READ),
        (Self::COPY_READ, vk::PipelineStageFlags2::ALL_TRANSFER, vk::AccessFlags2::TRANSFER_READ),
        (Self::COPY_WRITE, vk::PipelineStageFlags2::ALL_TRANSFER, vk::AccessFlags2::TRANSFER_WRITE),
        (Self::HOST_READ, vk::PipelineStageFlags2::HOST, vk::AccessFlags2::HOST_READ),
        (Self::DRAW, vk::PipelineStageFlags2::COLOR_ATTACHMENT_OUTPUT, DRAWN),
    ];

    /// All accesses that happen in the pipeline stages of these.
    fn whole_stages(self) -> Self {
        let stages = self.stages();
        Self::VULKAN.iter().filter(|(_, stage, _)| stages.contains(*stage)).fold(Self::empty(), |all, (a, ..)| all | *a)
    }

    pub(super) fn stages(self) -> vk::PipelineStageFlags2 {
        let mine = Self::VULKAN.iter().filter(|(access, ..)| self.contains(*access));
        mine.fold(vk::PipelineStageFlags2::NONE, |all, (_, stage, _)| all | *stage)
    }

    pub(super) fn accesses(self) -> vk::AccessFlags2 {
        let mine = Self::VULKAN.iter().filter(|(access, ..)| self.contains(*access));
        mine.fold(vk::AccessFlags2::NONE, |all, (.., flags)| all | *flags)
    }
}

/// The accesses to each resource by the commands recorded so far.
#[derive(Default)]
pub(super) struct Hazards {
    resources: HashMap<u64, History>,
}

#[derive(Default)]
struct History {
    /// The newest write: the access, the command, and the later accesses that a barrier made it visible to.
    write: Option<(Access, String, Access)>,
    /// The reads since that write: the access, the command, and the later accesses that a barrier put after it.
    reads: Vec<(Access, String, Access)>,
}

impl Hazards {
    pub fn barrier(&mut self, from: Access, to: Access) {
        for history in self.resources.values_mut() {
            if let Some((access, _, visible)) = &mut history.write
                && from.contains(*access)
            {
                *visible |= to;
            }
            for (access, _, behind) in &mut history.reads {
                // A read needs no memory dependency, only that the writer's stage waits.
                if from.whole_stages().contains(*access) {
                    *behind |= to.whole_stages();
                }
            }
        }
    }

    /// Records that `command` reads `resource`. Returns a message if it may read old content.
    pub fn read(&mut self, resource: u64, name: &str, command: &str, access: Access) -> Option<String> {
        let history = self.resources.entry(resource).or_default();
        history.reads.push((access, command.to_owned(), Access::empty()));
        match &history.write {
            Some((_, writer, visible)) if !visible.contains(access) => Some(missing_barrier(name, writer, command)),
            _ => None,
        }
    }

    /// Records that `command` writes `resource`. Returns a message if an earlier access may not be finished.
    pub fn write(&mut self, resource: u64, name: &str, command: &str, access: Access) -> Option<String> {
        let history = self.resources.entry(resource).or_default();
        let unfinished_write = history.write.as_ref().filter(|(_, _, visible)| !visible.contains(access));
        // A command may read the resource that it updates.
        let unfinished_read =
            history.reads.iter().find(|(_, who, behind)| who != command && !behind.intersects(access));
        let message =
            unfinished_write.or(unfinished_read).map(|(_, earlier, _)| missing_barrier(name, earlier, command));
        *history = History { write: Some((access, command.to_owned(), Access::empty())), reads: Vec::new() };
        message
    }
}

fn missing_barrier(resource: &str, earlier: &str, later: &str) -> String {
    format!("no barrier on `{resource}` between {earlier} and {later}")
}
