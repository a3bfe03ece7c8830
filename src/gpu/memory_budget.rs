//! The memory budget of a device: a limit that no allocation exceeds, and what is allocated.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use anyhow::Result;
use ash::vk;
use gpu_allocator::vulkan::{Allocator, AllocatorCreateDesc};
use gpu_allocator::{AllocationSizes, AllocatorDebugSettings, AllocatorReport};

use super::capabilities::{DeviceKind, Feature};
use super::device::{Allocators, Device, Shared};
use crate::host_memory::OutOfMemory;

/// Bytes of the blocks that small resources share. Larger resources have memory of their own.
pub(crate) const BLOCK: u64 = 64 << 20;
/// Bytes of these blocks under a limit that a user set.
pub(crate) const SMALL_BLOCK: u64 = 4 << 20;
/// Bytes of a limit that are reserved for allocations of the driver after the device is opened: pipelines, command
/// buffers, queries.
pub(crate) const DRIVER: u64 = 24 << 20;
/// Without a limit by the user, one part in this many of the free memory is left to other programs.
pub(crate) const SPARE: u64 = 50;

/// The limit and the largest sum of all allocations so far.
#[derive(Debug, Default)]
pub(crate) struct MemoryBudget {
    /// For the blocks of the allocator; `None` if the driver does not report free memory and the user set no limit.
    pub limit: Option<u64>,
    /// The limit that the user set.
    pub user_limit: Option<u64>,
    /// The bytes of a block that small resources share.
    pub block: u64,
    peak: AtomicU64,
    /// The highest usage that the driver reported after an allocation.
    driver_used: AtomicU64,
}

/// The use of device memory, in bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MemoryUse {
    /// The limit that the user set.
    pub user_limit: Option<u64>,
    /// Limit of all resources of this program on the device: the user's limit without the memory that the driver took
    /// when the device was opened, and may take later.
    pub limit: Option<u64>,
    /// Current use of these resources, with the gaps in shared blocks. On devices without memory of their own, it
    /// includes memory that they share with the host.
    pub used: u64,
    /// The highest use at any time.
    pub peak: u64,
    /// Use of this process as the driver reports it: the highest at any time under a limit of the user, else the
    /// current one.
    pub driver_used: Option<u64>,
}

impl MemoryBudget {
    pub fn new(limit: Option<u64>, user_limit: Option<u64>) -> Self {
        let block = if user_limit.is_some() { SMALL_BLOCK } else { BLOCK };
        Self { limit, user_limit, block, peak: AtomicU64::default(), driver_used: AtomicU64::default() }
    }

    /// The bytes by which an allocation of `size` bytes would exceed the limit; 0 if it fits.
    pub fn excess(&self, report: impl FnOnce() -> AllocatorReport, size: u64) -> u64 {
        let Some(limit) = self.limit else { return 0 };
        let report = report();
        // A shared block that is at most half full has room for a much smaller resource.
        let has_room = size <= self.block / 8
            && report.blocks.iter().any(|shared| {
                let taken: u64 = report.allocations[shared.allocations.clone()].iter().map(|a| a.size).sum();
                shared.size == self.block && taken <= self.block / 2
            });
        let more = if size > self.block { size } else { self.block };
        if has_room { 0 } else { (report.total_capacity_bytes + more).saturating_sub(limit) }
    }

    /// Records the sum of all blocks after an allocation.
    pub fn record(&self, bytes: u64) {
        self.peak.fetch_max(bytes, Ordering::Relaxed);
    }

    /// Records the usage that the driver reports; returns the highest so far.
    pub fn record_driver_used(&self, bytes: u64) -> u64 {
        self.driver_used.fetch_max(bytes, Ordering::Relaxed).max(bytes)
    }

    pub fn peak(&self) -> u64 {
        self.peak.load(Ordering::Relaxed)
    }
}

impl Shared {
    /// Allocators with the blocks of the budget. On devices that share the memory of the host, it has no allocator.
    pub(super) fn make_allocators(&self) -> Result<Allocators> {
        let make = || {
            Allocator::new(&AllocatorCreateDesc {
                instance: self.instance.raw.clone(),
                device: self.raw.clone(),
                physical_device: self.capabilities.raw,
                debug_settings: AllocatorDebugSettings::default(),
                buffer_device_address: false,
                allocation_sizes: AllocationSizes::new(self.budget.block, self.budget.block),
            })
        };
        let is_discrete = self.capabilities.kind == DeviceKind::Discrete;
        Ok(Allocators { device: make()?, host: is_discrete.then(make).transpose()? })
    }

    /// The budget and the usage of this process in the largest heap of the device, bytes, as the driver reports them.
    pub(super) fn driver_budget(&self) -> Option<(u64, u64)> {
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
    /// Limits the device memory of this program to `user_limit` bytes; without a number, to the free memory that the
    /// driver reports, less a part for other programs.
    ///
    /// # Errors
    /// If the driver itself already took more, or the allocator cannot be made.
    ///
    /// # Panics
    /// If a buffer, stage or recording of the device exists already.
    pub fn with_memory_limit(mut self, user_limit: Option<u64>) -> Result<Self> {
        let shared = Arc::get_mut(&mut self.0).expect("a device gets its limit before anything uses it");
        let driver = shared.driver_budget();
        let own = driver.map_or(0, |(_, used)| used);
        let limit = match (user_limit, driver) {
            (Some(user_limit), _) => {
                let least = own + DRIVER;
                if user_limit <= least {
                    let reason = format!("the limit of device memory is {user_limit}");
                    let name = "driver and what it may take later".to_owned();
                    return Err(OutOfMemory { name, bytes: Some(least), reason }.into());
                }
                let free =
                    driver.map_or(shared.capabilities.memory_bytes, |(budget, used)| budget.saturating_sub(used));
                Some((user_limit - least).min(free))
            }
            (None, Some((budget, used))) => Some(budget.saturating_sub(used) / SPARE * (SPARE - 1)),
            (None, None) => None,
        };
        shared.budget = MemoryBudget::new(limit, user_limit);
        let made = shared.make_allocators()?;
        *shared.allocator.get_mut().expect("no holder of the allocator panics") = Some(made);
        Ok(self)
    }

    /// The use of the memory of the device.
    pub fn memory(&self) -> MemoryUse {
        let budget = &self.0.budget;
        let report = self.0.allocator().as_ref().expect("the allocator lives until drop").device.generate_report();
        MemoryUse {
            user_limit: budget.user_limit,
            limit: budget.limit,
            used: report.total_capacity_bytes,
            peak: budget.peak(),
            driver_used: self.0.driver_budget().map(|(_, used)| budget.record_driver_used(used)),
        }
    }

    /// Bytes that can still be allocated in large pieces under the limit; without a limit, all unused memory of the
    /// device.
    pub fn free_bytes(&self) -> u64 {
        let MemoryUse { limit, used, .. } = self.memory();
        // A block may still be opened for small resources.
        let blocks = if limit.is_some() { 2 * self.0.budget.block } else { 0 };
        limit.unwrap_or(self.capabilities().memory_bytes).saturating_sub(used + blocks)
    }
}
