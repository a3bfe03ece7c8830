//! The memory budget of a device: a limit that no allocation exceeds, and the current use.

use std::sync::atomic::{AtomicU64, Ordering};

use gpu_allocator::AllocatorReport;

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
