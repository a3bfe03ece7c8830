//! The limit on a device's memory: how it is set and asked.

use std::sync::Arc;

use anyhow::Result;
use ash::vk;
use gpu_allocator::vulkan::{Allocator, AllocatorCreateDesc};
use gpu_allocator::{AllocationSizes, AllocatorDebugSettings};

use super::capabilities::{DeviceKind, Feature};
use super::device::{Allocators, Device, Shared};
use super::memory_budget::{DRIVER, Ledger, MemoryUse, SPARE};
use crate::host_memory::OutOfMemory;

impl Shared {
    /// Allocators with the blocks of the ledger. Where all memory is the device's, the host has none of its own.
    pub(super) fn make_allocators(&self) -> Result<Allocators> {
        let make = || {
            Allocator::new(&AllocatorCreateDesc {
                instance: self.instance.raw.clone(),
                device: self.raw.clone(),
                physical_device: self.capabilities.raw,
                debug_settings: AllocatorDebugSettings::default(),
                buffer_device_address: false,
                allocation_sizes: AllocationSizes::new(self.ledger.block, self.ledger.block),
            })
        };
        let is_discrete = self.capabilities.kind == DeviceKind::Discrete;
        Ok(Allocators { device: make()?, host: is_discrete.then(make).transpose()? })
    }

    /// What the driver says of the largest heap of the device: the bytes that this process may take, and takes.
    pub(super) fn told(&self) -> Option<(u64, u64)> {
        self.capabilities.has(Feature::MemoryBudget).then(|| {
            let mut budget = vk::PhysicalDeviceMemoryBudgetPropertiesEXT::default();
            let mut properties = vk::PhysicalDeviceMemoryProperties2::default().push_next(&mut budget);
            let (raw, device) = (&self.instance.raw, self.capabilities.raw);
            // SAFETY: clause 1.
            unsafe { raw.get_physical_device_memory_properties2(device, &mut properties) };
            let heaps = properties.memory_properties;
            let local = (0..heaps.memory_heap_count as usize)
                .filter(|&i| heaps.memory_heaps[i].flags.contains(vk::MemoryHeapFlags::DEVICE_LOCAL))
                .max_by_key(|&i| heaps.memory_heaps[i].size)
                .unwrap_or(0);
            (budget.heap_budget[local], budget.heap_usage[local])
        })
    }
}

impl Device {
    /// Limits what this program takes of the device's memory to `asked` bytes; without a number, to what the driver
    /// says is free, less a part for others, if it tells.
    ///
    /// # Errors
    /// If the driver itself already took more, or the allocator cannot be made.
    ///
    /// # Panics
    /// If a buffer, stage or recording of the device exists already.
    pub fn with_memory_limit(mut self, asked: Option<u64>) -> Result<Self> {
        let shared = Arc::get_mut(&mut self.0).expect("a device gets its limit before anything uses it");
        let told = shared.told();
        let own = told.map_or(0, |(_, used)| used);
        let limit = match (asked, told) {
            (Some(asked), _) => {
                let least = own + DRIVER;
                if asked <= least {
                    let reason = format!("the limit of device memory is {asked}");
                    let name = "driver and what it may take later".to_owned();
                    return Err(OutOfMemory { name, bytes: Some(least), reason }.into());
                }
                let free = told.map_or(shared.capabilities.memory_bytes, |(budget, used)| budget.saturating_sub(used));
                Some((asked - least).min(free))
            }
            (None, Some((budget, used))) => Some(budget.saturating_sub(used) / SPARE * (SPARE - 1)),
            (None, None) => None,
        };
        shared.ledger = Ledger::new(limit, asked);
        let made = shared.make_allocators()?;
        *shared.allocator.get_mut().expect("no holder of the allocator panics") = Some(made);
        Ok(self)
    }

    /// The state of the ledger.
    pub fn memory(&self) -> MemoryUse {
        let ledger = &self.0.ledger;
        let report = self.0.allocator().as_ref().expect("the allocator lives until drop").device.generate_report();
        MemoryUse {
            asked: ledger.asked,
            limit: ledger.limit,
            used: report.total_capacity_bytes,
            peak: ledger.peak(),
            told: self.0.told().map(|(_, used)| ledger.note_told(used)),
        }
    }

    /// Bytes that can still be allocated in large pieces, as far as the ledger knows: without a limit, all memory of
    /// the device that is not taken.
    pub fn free_bytes(&self) -> u64 {
        let MemoryUse { limit, used, .. } = self.memory();
        // A block may still be opened for small resources.
        let blocks = if limit.is_some() { 2 * self.0.ledger.block } else { 0 };
        limit.unwrap_or(self.capabilities().memory_bytes).saturating_sub(used + blocks)
    }
}
