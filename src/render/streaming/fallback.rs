//! The hierarchy of pages, and the fallback limits: the smallest error limits with which every drawn node is resident.
//!
//! A node is drawn in place of its children if its error is within the error limit of its group. No child of a missing
//! page may be drawn, so the limit of a group is at least the largest parent error of its missing child pages: its
//! *fallback limit*. A fallback limit holds for all groups below, too. Limits then still do not decrease from the root
//! to the leaves, as the selection requires: on every path to the root exactly one node is drawn, whichever pages are
//! missing.
//!
//! A frame changes few pages, so only limits that depend on changed pages are computed anew.

use std::cmp::Reverse;
use std::collections::{BinaryHeap, HashMap};
use std::ops::Range;
use std::sync::Arc;

use crate::lod::FINEST;
use crate::pagefile::{NO_PAGE, PageLod};

/// The groups of a scene (pages whose nodes share one box and one reference width) and their parents.
pub struct PageHierarchy {
    /// The group of each page.
    groups: Vec<u32>,
    /// For each page, the group with the parents of its nodes; [`NONE`] for the root.
    parent_groups: Vec<u32>,
    /// The pages of each group.
    pages: Lists,
    /// For each group, the pages whose nodes have their parents in it.
    child_pages: Lists,
    /// For each group, the group with the parents of its coarsest nodes; [`NONE`] for the root.
    ancestors: Vec<u32>,
    /// For each page, the largest error of a parent, as a code.
    parent_errors: Vec<u16>,
}

/// A list of pages for each group.
struct Lists {
    /// Where the list of each group begins, and the end of the last one.
    begins: Vec<u32>,
    pages: Vec<u32>,
}

impl Lists {
    /// The pages of each of `groups` groups in ascending order; `group_of` has the group of each page, or [`NONE`].
    fn new(group_of: &[u32], groups: usize) -> Self {
        let listed = || (0_u32..).zip(group_of).filter(|(_, group)| **group != NONE);
        let mut begins = vec![0; groups + 1];
        listed().for_each(|(_, group)| begins[*group as usize + 1] += 1);
        (0..groups).for_each(|group| begins[group + 1] += begins[group]);
        let (mut ends, mut pages) = (begins.clone(), vec![0; begins[groups] as usize]);
        for (page, group) in listed() {
            pages[ends[*group as usize] as usize] = page;
            ends[*group as usize] += 1;
        }
        Self { begins, pages }
    }

    fn of(&self, group: u32) -> &[u32] {
        let [begin, end] = [0, 1].map(|next| self.begins[group as usize + next] as usize);
        &self.pages[begin..end]
    }
}

/// The requests of one frame, by group.
pub struct Requests {
    /// For each group, the priority of a child page minus its parent error; [`NO_REQUEST`] without a request.
    offsets: Vec<i32>,
    /// For each group, the smallest error limit for which its children are requested.
    error_limits: Vec<u16>,
    /// The groups with a request.
    groups: Vec<u32>,
}

/// Less than the offset of any request.
const NO_REQUEST: i32 = i32::MIN;

/// No group.
const NONE: u32 = u32::MAX;

impl PageHierarchy {
    /// The hierarchy of a table of levels. `scene_of` is the scene of a page: pages of different scenes have no common
    /// group.
    pub fn new(levels: &[PageLod], scene_of: impl Fn(usize) -> usize) -> Self {
        let mut group_of_box = HashMap::new();
        let mut groups = vec![NONE; levels.len()];
        // From the root, so that a group has a higher number than the group of its parents.
        for (page, PageLod { low, high, reference_width, .. }) in levels.iter().enumerate().rev() {
            let key = (low.map(f32::to_bits), high.map(f32::to_bits), reference_width.to_bits(), scene_of(page));
            let next = group_of_box.len() as u32;
            groups[page] = *group_of_box.entry(key).or_insert(next);
        }
        let parent_group = |level: &PageLod| if level.parent == NO_PAGE { NONE } else { groups[level.parent as usize] };
        let parent_groups: Vec<u32> = levels.iter().map(parent_group).collect();
        let count = group_of_box.len();
        let mut ancestors = vec![NONE; count];
        for (group, parent) in groups.iter().zip(&parent_groups).filter(|(group, parent)| group != parent) {
            let ancestor = &mut ancestors[*group as usize];
            if *parent != NONE && (*ancestor == NONE || *parent > *ancestor) {
                *ancestor = *parent;
            }
        }
        let parent_errors = levels.iter().map(|level| level.parent_errors[level.parent_errors.len() - 1]).collect();
        let (pages, child_pages) = (Lists::new(&groups, count), Lists::new(&parent_groups, count));
        Self { groups, parent_groups, pages, child_pages, ancestors, parent_errors }
    }

    /// An empty set of requests.
    pub fn requests(&self) -> Requests {
        let groups = self.ancestors.len();
        Requests { offsets: vec![NO_REQUEST; groups], error_limits: vec![u16::MAX; groups], groups: Vec::new() }
    }

    /// Requests the nodes of a page whose parents are above an error limit, and all pages that these nodes depend on:
    /// pages of the same group with parents above the limit, in view or not, and the same of all groups above.
    /// `priority`: of the coarsest parents of the page.
    pub fn request(&self, requests: &mut Requests, page: u32, priority: u32, error_limit: u16) {
        let offset = priority as i32 - i32::from(self.parent_errors[page as usize]);
        let mut group = self.parent_groups[page as usize];
        while group != NONE {
            let largest = &mut requests.offsets[group as usize];
            let smallest = &mut requests.error_limits[group as usize];
            if *largest >= offset && *smallest <= error_limit {
                return;
            }
            if *largest == NO_REQUEST {
                requests.groups.push(group);
            }
            (*largest, *smallest) = (offset.max(*largest), error_limit.min(*smallest));
            group = self.ancestors[group as usize];
        }
    }

    /// The requested pages with their priorities.
    pub fn requested_pages(&self, requests: &Requests) -> impl Iterator<Item = (u32, i32)> {
        requests.groups.iter().flat_map(move |group| {
            let error_limit = requests.error_limits[*group as usize];
            let children = self.child_pages.of(*group).iter();
            let above = children.filter(move |page| self.parent_errors[**page as usize] > error_limit);
            above.filter_map(move |page| Some((*page, self.priority(requests, *page)?)))
        })
    }

    /// The priority of a page; `None` without a request for its group.
    pub fn priority(&self, requests: &Requests, page: u32) -> Option<i32> {
        let offset = *requests.offsets.get(self.parent_groups[page as usize] as usize)?;
        (offset != NO_REQUEST).then(|| i32::from(self.parent_errors[page as usize]) + offset)
    }
}

/// The fallback limits of all groups for the resident pages, and the limits that frames use, which may decrease to them
/// gradually.
pub struct FallbackLimits {
    hierarchy: Arc<PageHierarchy>,
    is_resident: Vec<bool>,
    /// The fallback limit of each group, as a code.
    targets: Vec<u16>,
    /// The limit in use of each group.
    shown: Vec<u16>,
    /// The groups whose limit in use may be above its target, and for each group, true if it is among them.
    fading: Vec<u32>,
    is_in_fading: Vec<bool>,
    /// The limits in use as the shaders read them, for each page: the limit of its group in the lower half, that of its
    /// parents' group in the upper half.
    words: Vec<u32>,
    /// For each block of [`BLOCK`] words, true if it has changed since [`Self::mark_uploaded`].
    changed_blocks: Vec<bool>,
}

/// Words that are uploaded together.
const BLOCK: usize = if cfg!(test) { 8 } else { 1024 };

impl FallbackLimits {
    /// The limits while all pages are resident, which are 0.
    pub fn new(hierarchy: Arc<PageHierarchy>) -> Self {
        let (groups, pages) = (hierarchy.ancestors.len(), hierarchy.groups.len());
        Self {
            is_resident: vec![true; pages],
            targets: vec![FINEST; groups],
            shown: vec![FINEST; groups],
            fading: Vec::new(),
            is_in_fading: vec![false; groups],
            words: vec![u32::from(FINEST) | u32::from(FINEST) << 16; pages],
            changed_blocks: vec![true; pages.div_ceil(BLOCK)],
            hierarchy,
        }
    }

    /// Sets the resident pages. Limits in use that must rise do so at once; those that may decrease do in
    /// [`Self::fade`].
    ///
    /// # Panics
    /// If `is_resident` does not have one value per page.
    pub fn set_resident(&mut self, is_resident: &[bool]) {
        /// Pages that are compared at once.
        const COMPARED: usize = 256;
        assert_eq!(is_resident.len(), self.is_resident.len(), "every page is resident or not");
        let mut stale = BinaryHeap::new();
        let parts = self.is_resident.chunks(COMPARED).zip(is_resident.chunks(COMPARED)).enumerate();
        for (part, (before, now)) in parts.filter(|(_, (before, now))| before != now) {
            let differing = (0..now.len()).filter(|k| before[*k] != now[*k]).map(|k| part * COMPARED + k);
            let groups = differing.map(|page| self.hierarchy.parent_groups[page]).filter(|group| *group != NONE);
            stale.extend(groups.map(Reverse));
        }
        self.is_resident.copy_from_slice(is_resident);
        // Groups from the root: in files of smalto, each is computed once.
        while let Some(Reverse(group)) = stale.pop() {
            while stale.peek() == Some(&Reverse(group)) {
                stale.pop();
            }
            let target = self.target_of(group);
            if target == self.targets[group as usize] {
                continue;
            }
            self.targets[group as usize] = target;
            if self.shown[group as usize] < target {
                self.show(group, target);
            } else if !std::mem::replace(&mut self.is_in_fading[group as usize], true) {
                self.fading.push(group);
            }
            let children = self.hierarchy.child_pages.of(group).iter();
            let children = children.map(|page| self.hierarchy.groups[*page as usize]).filter(|child| *child != group);
            stale.extend(children.map(Reverse));
        }
    }

    /// The fallback limit of a group, from its child pages and the limits of the groups above.
    fn target_of(&self, group: u32) -> u16 {
        let PageHierarchy { parent_groups, pages, child_pages, parent_errors, .. } = &*self.hierarchy;
        let missing = child_pages.of(group).iter().filter(|page| !self.is_resident[**page as usize]);
        let above = pages.of(group).iter().map(|page| parent_groups[*page as usize]);
        let above = above.filter(|parent| *parent != NONE && *parent != group);
        let limits = missing.map(|page| parent_errors[*page as usize]);
        limits.chain(above.map(|parent| self.targets[parent as usize])).max().unwrap_or(FINEST)
    }

    fn show(&mut self, group: u32, limit: u16) {
        self.shown[group as usize] = limit;
        let own = self.hierarchy.pages.of(group).iter().map(|page| (*page as usize, 0));
        let children = self.hierarchy.child_pages.of(group).iter().map(|page| (*page as usize, 16));
        for (page, shift) in own.chain(children) {
            self.words[page] = self.words[page] & !(0xffff << shift) | u32::from(limit) << shift;
            self.changed_blocks[page / BLOCK] = true;
        }
    }

    /// Lowers all limits in use by `step` codes, at most to their targets.
    pub fn fade(&mut self, step: u16) {
        let mut fading = std::mem::take(&mut self.fading);
        fading.retain(|group| {
            let [shown, target] = [&self.shown, &self.targets].map(|limits| limits[*group as usize]);
            let lower = shown.saturating_sub(step).max(target);
            if lower != shown {
                self.show(*group, lower);
            }
            self.is_in_fading[*group as usize] = lower > target;
            lower > target
        });
        self.fading = fading;
    }

    /// True if a limit in use may decrease.
    pub fn is_fading(&self) -> bool {
        !self.fading.is_empty()
    }

    /// The limits in use as the shaders read them, one word per page.
    pub fn words(&self) -> &[u32] {
        &self.words
    }

    /// Says that the ranges of [`Self::changed`] are uploaded.
    pub fn mark_uploaded(&mut self) {
        self.changed_blocks.fill(false);
    }

    /// The ranges of words that changed since [`Self::mark_uploaded`]; at first all.
    pub fn changed(&self) -> Vec<Range<usize>> {
        let blocks: Vec<usize> = (0..self.changed_blocks.len()).filter(|block| self.changed_blocks[*block]).collect();
        let runs = blocks.chunk_by(|block, next| block + 1 == *next);
        runs.map(|run| run[0] * BLOCK..((run[run.len() - 1] + 1) * BLOCK).min(self.words.len())).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pagefile::write::Settings;
    use crate::procedural::cactus;
    use crate::render::lod::fixtures::{with_levels, with_source_levels};

    /// The fallback limit of the group of a page: the largest parent error of the missing pages whose parents are in
    /// this group or one above it.
    fn limit_of(levels: &[PageLod], second_scene: usize, is_resident: &[bool], page: usize) -> u16 {
        let bounds = |page: usize| {
            let PageLod { low, high, reference_width, .. } = levels[page];
            (low, high, reference_width, page < second_scene)
        };
        let (mut above, mut known) = (vec![bounds(page)], 0);
        while known < above.len() {
            let of_group = levels.iter().enumerate().filter(|(page, _)| bounds(*page) == above[known]);
            let parents: Vec<_> =
                of_group.filter(|(_, level)| level.parent != NO_PAGE).map(|(_, l)| l.parent).collect();
            for parent in parents.into_iter().map(|parent| bounds(parent as usize)) {
                if !above.contains(&parent) {
                    above.push(parent);
                }
            }
            known += 1;
        }
        let has_parents_above =
            |child: &usize| levels[*child].parent != NO_PAGE && above.contains(&bounds(levels[*child].parent as usize));
        let missing = (0..levels.len()).filter(|child| !is_resident[*child]).filter(has_parents_above);
        missing.filter_map(|child| levels[child].parent_errors.last().copied()).max().unwrap_or(FINEST)
    }

    fn below(state: &mut u64, count: u64) -> u64 {
        *state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (*state >> 33) % count
    }

    #[test]
    fn limits_follow_changed_pages() {
        let made = with_levels(cactus::cactus(30_000).unwrap(), Settings::LOSSLESS);
        let of_source = with_source_levels(cactus::cactus(30_000).unwrap(), 3000, Settings::LOSSLESS);
        let first = made.levels().unwrap();
        let joined = of_source.levels().unwrap().iter().map(|level| PageLod {
            parent: if level.parent == NO_PAGE { NO_PAGE } else { level.parent + first.len() as u32 },
            ..*level
        });
        let levels: Vec<PageLod> = first.iter().copied().chain(joined).collect();
        let levels = levels.as_slice();
        let scene_of = |page: usize| usize::from(page >= first.len());
        let mut limits = FallbackLimits::new(Arc::new(PageHierarchy::new(levels, scene_of)));
        let (mut is_resident, mut state, mut uploaded) = (vec![true; levels.len()], 7, limits.words().to_vec());
        for change in 0..40 {
            for _ in 0..1 << (change % 6) {
                let page = below(&mut state, levels.len() as u64) as usize;
                is_resident[page] = !is_resident[page];
            }
            let before = uploaded.clone();
            limits.set_resident(&is_resident);
            let steps = if change % 2 == 0 { [u16::MAX, 0] } else { [300, u16::MAX] };
            for step in steps {
                limits.fade(step);
                for range in limits.changed() {
                    uploaded[range.clone()].copy_from_slice(&limits.words()[range]);
                }
                limits.mark_uploaded();
                assert_eq!(uploaded, limits.words(), "all changed words are uploaded");
                for (page, level) in levels.iter().enumerate() {
                    let target = limit_of(levels, first.len(), &is_resident, page);
                    let used = uploaded[page] & 0xffff;
                    let faded = ((before[page] & 0xffff) as u16).saturating_sub(step).max(target);
                    assert_eq!(used, u32::from(if step == 0 { target } else { faded }), "change {change}, page {page}");
                    let of_parents =
                        if level.parent == NO_PAGE { FINEST.into() } else { uploaded[level.parent as usize] & 0xffff };
                    assert_eq!(uploaded[page] >> 16, of_parents, "change {change}, page {page}");
                }
                let target = |page: usize| u32::from(limit_of(levels, first.len(), &is_resident, page));
                let is_above = uploaded.iter().enumerate().any(|(page, word)| word & 0xffff > target(page));
                assert_eq!(limits.is_fading(), step == 300 && is_above, "change {change}");
            }
        }
        is_resident.fill(true);
        limits.set_resident(&is_resident);
        limits.fade(u16::MAX);
        assert!(limits.words().iter().all(|word| *word == 0) && !limits.is_fading(), "nothing is missing");
    }
}
