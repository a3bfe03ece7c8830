//! Numbers that identify resources and recordings.

use std::sync::atomic::{AtomicU64, Ordering};

/// Returns a number that no other resource or recording of this process has.
pub(super) fn next_id() -> u64 {
    static NEXT: AtomicU64 = AtomicU64::new(0);
    NEXT.fetch_add(1, Ordering::Relaxed)
}
