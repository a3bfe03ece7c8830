//! The hierarchy of pages, and the fallback limits: the smallest error limits with which every drawn node is resident.
//!
//! A node is drawn in place of its children if its error is within the error limit of its group. No child of a missing
//! page may be drawn, so the limit of a group is at least the largest parent error of its missing child pages: its
//! *fallback limit*. A fallback limit holds for all groups below, too. Limits then still do not decrease from the root
//! to the leaves, as the selection requires: on every path to the root exactly one node is drawn, whichever pages are
//! missing.

use std::collections::HashMap;

use rayon::prelude::*;

use crate::lod::FINEST;
use crate::pagefile::{NO_PAGE, PageLod};

/// The groups of a scene (pages whose nodes share one box and one reference width) and their parents.
pub struct PageHierarchy {
    /// The group of each page.
    groups: Vec<u32>,
    /// For each page, the group with the parents of its nodes; [`NONE`] for the root.
    parent_groups: Vec<u32>,
    /// Pairs of a group and a group with parents of its nodes, from the root to the leaves.
    edges: Vec<(u32, u32)>,
    /// For each group, the pages whose nodes have their parents in it.
    child_pages: Vec<Vec<u32>>,
    /// For each group, the group with the parents of its coarsest nodes; [`NONE`] for the root.
    ancestors: Vec<u32>,
    /// For each page, the largest error of a parent, as a code.
    parent_errors: Vec<u16>,
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

/// Pages or groups per thread at least: smaller pieces cost more than they save.
const MIN_PER_THREAD: usize = 1 << 14;

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
        let mut edges: Vec<_> = groups.iter().copied().zip(parent_groups.iter().copied()).collect();
        edges.retain(|(group, parent)| group != parent && *parent != NONE);
        edges.sort_unstable();
        edges.dedup();
        let mut child_pages = vec![Vec::new(); group_of_box.len()];
        for (page, parent) in parent_groups.iter().enumerate().filter(|(_, parent)| **parent != NONE) {
            child_pages[*parent as usize].push(page as u32);
        }
        let parent_errors = levels.iter().map(|level| level.parent_errors[level.parent_errors.len() - 1]).collect();
        let mut ancestors = vec![NONE; child_pages.len()];
        edges.iter().for_each(|(group, parent)| ancestors[*group as usize] = *parent);
        Self { groups, parent_groups, edges, child_pages, ancestors, parent_errors }
    }

    /// An empty set of requests.
    pub fn requests(&self) -> Requests {
        let groups = self.child_pages.len();
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
            let children = self.child_pages[*group as usize].iter();
            let above = children.filter(move |page| self.parent_errors[**page as usize] > error_limit);
            above.filter_map(move |page| Some((*page, self.priority(requests, *page)?)))
        })
    }

    /// The priority of a page; `None` without a request for its group.
    pub fn priority(&self, requests: &Requests, page: u32) -> Option<i32> {
        let offset = *requests.offsets.get(self.parent_groups[page as usize] as usize)?;
        (offset != NO_REQUEST).then(|| i32::from(self.parent_errors[page as usize]) + offset)
    }

    /// The fallback limit of every group, as a code.
    pub fn fallback_limits(&self, is_resident: impl Fn(u32) -> bool + Sync) -> Vec<u16> {
        let fallback_limit = |children: &Vec<u32>| {
            let missing = children.iter().filter(|page| !is_resident(**page));
            missing.map(|page| self.parent_errors[*page as usize]).max().unwrap_or(FINEST)
        };
        let groups = self.child_pages.par_iter().with_min_len(MIN_PER_THREAD);
        let mut limits: Vec<u16> = groups.map(fallback_limit).collect();
        // One pass suffices if parents precede their children, as in files of smalto.
        let mut has_changed = true;
        while has_changed {
            has_changed = false;
            for (group, parent) in &self.edges {
                let above = limits[*parent as usize];
                has_changed |= limits[*group as usize] < above;
                limits[*group as usize] = limits[*group as usize].max(above);
            }
        }
        limits
    }

    /// Packs the fallback limits of all pages as the shaders read them: the limit of the page's group in the lower half
    /// of a word, that of its parents' group in the upper half.
    ///
    /// # Panics
    /// If `words` does not have one word per page.
    pub fn pack_limits(&self, fallback_limits: &[u16], words: &mut [u32]) {
        assert_eq!(words.len(), self.groups.len(), "every page has its word");
        let limit = |group: u32| fallback_limits.get(group as usize).copied().unwrap_or(FINEST);
        let groups = self.groups.par_iter().zip(&self.parent_groups);
        words.par_iter_mut().zip(groups).with_min_len(MIN_PER_THREAD).for_each(|(word, (group, parent))| {
            *word = u32::from(limit(*group)) | u32::from(limit(*parent)) << 16;
        });
    }
}
