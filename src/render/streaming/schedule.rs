//! The load schedule: which pages to load and which to evict for them. It takes milliseconds, so it is computed on a
//! worker thread while frames are drawn.

use std::cmp::Reverse;
use std::collections::HashSet;

use super::fallback::PageHierarchy;

/// The requests of one frame, and the residency of the pages at that time.
pub struct ResidencySnapshot {
    /// Requested pages of the frame that cannot be drawn yet: page; priority, error limit in the upper half.
    pub requested: Vec<[u32; 2]>,
    /// For each page, the stamp of the last frame that used it (upper half) and its priority then, if read back.
    pub last_used: Option<Vec<u32>>,
    /// The stamp of the next frame.
    pub stamp: u16,
    /// For each page.
    pub is_resident: Vec<bool>,
    /// Pages that are read or wait for their insertion.
    pub loading: HashSet<u32>,
    /// Pages whose read failed.
    pub unreadable: HashSet<u32>,
    /// Pages that are pinned, or being evicted already.
    pub not_evictable: HashSet<u32>,
    /// Slots that are free and not reserved for loading pages.
    pub free_slots: usize,
    /// Largest number of loads to schedule.
    pub max_loads: usize,
}

/// The loads and evictions that follow from a snapshot.
pub struct LoadSchedule {
    /// Pages to load, in order of decreasing priority.
    pub load: Vec<u32>,
    /// Pages to evict for them.
    pub evict: Vec<u32>,
    /// True if nothing needs to be loaded: no requested page has a higher priority than the resident pages.
    pub has_converged: bool,
}

/// Frames after which an unused page may be evicted for any requested page.
const RECENT_FRAMES: u16 = 4;
/// Hysteresis, in steps of error codes: a page is evicted only for pages with a priority higher by more than this, an
/// eighth of a power of two.
const HYSTERESIS: i32 = 64;

impl LoadSchedule {
    pub fn of(hierarchy: &PageHierarchy, snapshot: &ResidencySnapshot) -> Self {
        let mut missing = missing_pages(hierarchy, snapshot);
        let is_idle = missing.is_empty() && snapshot.loading.is_empty();
        missing.truncate(snapshot.max_loads);
        let (mut evict, mut has_converged, free) = (Vec::new(), is_idle, snapshot.free_slots);
        if missing.len() > free {
            if let Some(last_used) = &snapshot.last_used {
                evict = evictions(hierarchy, snapshot, last_used, &missing[free..]);
                has_converged |= evict.is_empty() && free == 0;
            }
            // Without `last_used`, the next frame reads it back.
            missing.truncate(free + evict.len());
        }
        Self { load: missing.into_iter().map(|(page, _)| page).collect(), evict, has_converged }
    }
}

/// The missing pages that the requests need, with their priorities, in decreasing order.
fn missing_pages(hierarchy: &PageHierarchy, snapshot: &ResidencySnapshot) -> Vec<(u32, i32)> {
    let mut requests = hierarchy.requests();
    for [page, word] in &snapshot.requested {
        hierarchy.request(&mut requests, *page, word & 0xffff, (word >> 16) as u16);
    }
    let ResidencySnapshot { is_resident, loading, unreadable, .. } = snapshot;
    let is_new = |page: &u32| !is_resident[*page as usize] && !loading.contains(page) && !unreadable.contains(page);
    let mut missing: Vec<_> = hierarchy.requested_pages(&requests).filter(|(page, _)| is_new(page)).collect();
    missing.sort_unstable_by_key(|(page, priority)| (Reverse(*priority), *page));
    missing
}

/// Chooses pages to evict for some of the missing pages. Resident pages are ranked by the priority they would have if
/// they were missing, which avoids thrashing.
fn evictions(
    hierarchy: &PageHierarchy,
    snapshot: &ResidencySnapshot,
    last_used: &[u32],
    missing: &[(u32, i32)],
) -> Vec<u32> {
    let age = |word: u32| snapshot.stamp.wrapping_sub((word >> 16) as u16);
    let mut requests = hierarchy.requests();
    for (word, page) in last_used.iter().zip(0..).filter(|(word, _)| **word != 0 && age(**word) < RECENT_FRAMES) {
        hierarchy.request(&mut requests, page, word & 0xffff, 0);
    }
    let rank = |page: u32| (hierarchy.priority(&requests, page), Reverse(age(last_used[page as usize])), page);
    let resident = snapshot.is_resident.iter().zip(0..).filter(|(is_resident, _)| **is_resident).map(|(_, page)| page);
    let mut resident: Vec<_> = resident.filter(|page| !snapshot.not_evictable.contains(page)).map(rank).collect();
    if missing.len() < resident.len() {
        resident.select_nth_unstable(missing.len());
        resident.truncate(missing.len());
    }
    resident.sort_unstable();
    let is_lower = |own: Option<i32>, other: i32| own.is_none_or(|own| own + HYSTERESIS < other);
    let evicted = resident.iter().zip(missing).take_while(|((own, ..), (_, other))| is_lower(*own, *other));
    evicted.map(|((.., page), _)| *page).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pagefile::{NO_PAGE, PARTS, PageLod, SAMPLES};

    /// A page of the group at `x`, whose nodes have parents with errors up to `parent_error` in page `parent`.
    fn level(x: f32, parent: u32, parent_error: u16) -> PageLod {
        PageLod {
            low: [x; 3],
            high: [x; 3],
            reference_width: 0.0,
            parent,
            level: 0,
            highest_opacity: 1.0,
            least_error: 0,
            errors: [0; PARTS],
            parent_errors: [parent_error; PARTS],
            squared_errors: [0; PARTS],
            samples: [0; SAMPLES],
            checksum: 0,
        }
    }

    /// Four pages with parents in a fifth.
    fn hierarchy() -> PageHierarchy {
        let levels = [100, 300, 900, 1600].map(|parent_error| level(1.0, 4, parent_error));
        PageHierarchy::new(&[&levels[..], &[level(0.0, NO_PAGE, 0)]].concat(), |_| 0)
    }

    fn snapshot(is_resident: [bool; 5]) -> ResidencySnapshot {
        ResidencySnapshot {
            requested: Vec::new(),
            last_used: None,
            stamp: 9,
            is_resident: is_resident.to_vec(),
            loading: HashSet::new(),
            unreadable: HashSet::new(),
            not_evictable: HashSet::from([4]),
            free_slots: 0,
            max_loads: 9,
        }
    }

    #[test]
    fn pages_are_loaded_by_priority_into_free_slots() {
        let schedule = |free_slots, max_loads| {
            let requested = vec![[0, 5000]];
            let loading = HashSet::from([1]);
            let snapshot = ResidencySnapshot { requested, free_slots, max_loads, loading, ..snapshot([false; 5]) };
            LoadSchedule::of(&hierarchy(), &snapshot)
        };
        let LoadSchedule { load, evict, has_converged } = schedule(9, 9);
        // The requested page needs all pages of its group with errors above the limit.
        assert_eq!((load, evict, has_converged), (vec![3, 2, 0], vec![], false));
        assert_eq!(schedule(9, 2).load, [3, 2]);
        let full = schedule(1, 9);
        assert_eq!((full.load, full.has_converged), (vec![3], false), "candidates for eviction are not known yet");
        let unreadable = HashSet::from([0, 1, 2, 3]);
        let nothing = LoadSchedule::of(&hierarchy(), &ResidencySnapshot { unreadable, ..snapshot([false; 5]) });
        assert!(nothing.load.is_empty() && nothing.has_converged);
    }

    #[test]
    fn pages_of_lower_priority_are_evicted() {
        let schedule = |last_used: [u32; 5], priority: u32| {
            let snapshot = ResidencySnapshot {
                requested: vec![[0, priority]],
                last_used: Some(last_used.to_vec()),
                ..snapshot([false, true, true, true, true])
            };
            LoadSchedule::of(&hierarchy(), &snapshot)
        };
        // No recent frame used a page: any page but the pinned one may be evicted.
        let LoadSchedule { load, evict, .. } = schedule([0; 5], 5000);
        assert_eq!((load, evict), (vec![0], vec![1]));
        // The last frame used them with priority 4000 or 6000: pages with larger errors have higher priorities.
        let used = |priority: u32| [0, priority | 8 << 16, priority | 8 << 16, priority | 8 << 16, 0];
        let LoadSchedule { load, evict, has_converged } = schedule(used(4000), 8000);
        assert_eq!((load, evict, has_converged), (vec![0], vec![1], false));
        let LoadSchedule { load, evict, has_converged } = schedule(used(6000), 100);
        assert!(load.is_empty() && evict.is_empty() && has_converged);
    }
}
