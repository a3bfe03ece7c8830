//! Sets the limit of a device's memory budget, and reports its use.

use std::sync::Arc;

use anyhow::Result;
use ash::vk;
use gpu_allocator::vulkan::{Allocator, AllocatorCreateDesc};
use gpu_allocator::{AllocationSizes, AllocatorDebugSettings};

use super::capabilities::{DeviceKind, Feature};
use super::device::{Allocators, Device, Shared};
use super::memory_budget::{DRIVER, MemoryBudget, MemoryUse, SPARE};
use crate::host_memory::OutOfMemory;

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
                    let reason =
                        format!("the limit of {user_limit} bytes is too low: {least} bytes are kept for the driver");
                    return Err(OutOfMemory { name: "device memory".to_owned(), bytes: None, reason }.into());
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

    /// Limits the device memory of this program to `bytes` in addition to what the driver takes, so that tests with
    /// small limits run on every device.
    ///
    /// # Errors
    /// As [`Device::with_memory_limit`].
    ///
    /// # Panics
    /// As [`Device::with_memory_limit`].
    #[doc(hidden)]
    pub fn with_small_limit(self, bytes: u64) -> Result<Self> {
        let driver = self.0.driver_budget().map_or(0, |(_, used)| used);
        self.with_memory_limit(Some(driver + bytes))
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
