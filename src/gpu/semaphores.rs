//! Binary semaphores for windows. Submissions are ordered by a timeline semaphore instead.

use std::sync::{Arc, Mutex};

use anyhow::Result;
use ash::vk;

use super::device::Shared;
use super::error::describe;

/// A pool of semaphores for acquiring images. Each is reused when the submission that waited for it is done.
pub(super) struct Semaphores {
    idle: Mutex<Vec<vk::Semaphore>>,
    device: Arc<Shared>,
}

pub(super) struct Ready {
    pub raw: vk::Semaphore,
    owner: Arc<Semaphores>,
}

impl Semaphores {
    pub fn new(device: &Arc<Shared>) -> Self {
        Self { device: device.clone(), idle: Mutex::default() }
    }

    pub fn take(self: &Arc<Self>) -> Result<Ready> {
        let idle = self.idle.lock().expect("no holder of the semaphores panics").pop();
        Ok(Ready { raw: idle.map_or_else(|| semaphore(&self.device), Ok)?, owner: self.clone() })
    }
}

impl Drop for Ready {
    fn drop(&mut self) {
        self.owner.idle.lock().expect("no holder of the semaphores panics").push(self.raw);
    }
}

pub(super) fn semaphore(device: &Shared) -> Result<vk::Semaphore> {
    // SAFETY: clause 1, the caller owns it.
    unsafe { device.raw.create_semaphore(&vk::SemaphoreCreateInfo::default(), None) }
        .map_err(|e| describe("vkCreateSemaphore", e))
}

impl Drop for Semaphores {
    fn drop(&mut self) {
        for semaphore in self.idle.get_mut().expect("no holder of the semaphores panics").drain(..) {
            // SAFETY: clause 2, the submissions that waited for it are done.
            unsafe { self.device.raw.destroy_semaphore(semaphore, None) };
        }
    }
}
