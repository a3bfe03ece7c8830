//! The ledger of device memory: a limit that no allocation passes, and what is allocated.

use std::sync::atomic::{AtomicU64, Ordering};

use gpu_allocator::AllocatorReport;

/// The bytes of the blocks that small resources share. Larger resources have memory of their own.
pub(crate) const BLOCK: u64 = 64 << 20;
/// The same under a limit that a user set.
pub(crate) const SMALL_BLOCK: u64 = 4 << 20;
/// Bytes below a limit that are left for what the driver itself takes after the device is opened: pipelines, command
/// buffers, queries.
pub(crate) const DRIVER: u64 = 24 << 20;
/// Without a limit by the user, this part of what the driver says is free stays free for others.
pub(crate) const SPARE: u64 = 50;

/// The limit and the largest sum of all allocations so far.
#[derive(Debug, Default)]
pub(crate) struct Ledger {
    /// For the blocks of the allocator; `None` where the driver does not tell what is free and the user set none.
    pub limit: Option<u64>,
    /// What the user set.
    pub asked: Option<u64>,
    /// The bytes of a block that small resources share.
    pub block: u64,
    peak: AtomicU64,
    /// The most that the driver said after an allocation.
    told: AtomicU64,
}

/// The state of the ledger, in bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MemoryUse {
    /// The limit that the user set.
    pub asked: Option<u64>,
    /// What the resources of this program may take on the device together: the limit, less what the driver took when it
    /// was opened and what it may take later.
    pub limit: Option<u64>,
    /// What they take now, with the gaps in shared blocks. Where the device has no memory of its own, memory that it
    /// shares with the host counts, too.
    pub used: u64,
    /// The most that they took at any time.
    pub peak: u64,
    /// What the driver says that this process takes on the device: the most at any time under a limit that was set,
    /// else now.
    pub told: Option<u64>,
}

impl Ledger {
    pub fn new(limit: Option<u64>, asked: Option<u64>) -> Self {
        let block = if asked.is_some() { SMALL_BLOCK } else { BLOCK };
        Self { limit, asked, block, peak: AtomicU64::default(), told: AtomicU64::default() }
    }

    /// The bytes by which an allocation of `size` bytes would pass the limit; 0 if it fits.
    pub fn excess(&self, report: impl FnOnce() -> AllocatorReport, size: u64) -> u64 {
        let Some(limit) = self.limit else { return 0 };
        let report = report();
        // A shared block that is at most half full has room for what is much smaller.
        let has_room = size <= self.block / 8
            && report.blocks.iter().any(|shared| {
                let taken: u64 = report.allocations[shared.allocations.clone()].iter().map(|a| a.size).sum();
                shared.size == self.block && taken <= self.block / 2
            });
        let more = if size > self.block { size } else { self.block };
        if has_room { 0 } else { (report.total_capacity_bytes + more).saturating_sub(limit) }
    }

    /// Notes the sum of all blocks after an allocation.
    pub fn note(&self, bytes: u64) {
        self.peak.fetch_max(bytes, Ordering::Relaxed);
    }

    /// Notes what the driver says; returns the most that it said so far.
    pub fn note_told(&self, bytes: u64) -> u64 {
        self.told.fetch_max(bytes, Ordering::Relaxed).max(bytes)
    }

    pub fn peak(&self) -> u64 {
        self.peak.load(Ordering::Relaxed)
    }
}
