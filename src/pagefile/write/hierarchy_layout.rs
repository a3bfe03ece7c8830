//! Layout of a hierarchy in a page file: the pages of each group, and of its subtrees.
//!
//! Group input and every simplification step but the last have pages of their own. The output of the last step is a
//! part of the input of the group above. The input of groups of the leaf level is the Gaussians of the scene.

use std::ops::Range;

use crate::pagefile::PAGE;

/// Pages of the input nodes of a group.
pub const GROUP_PAGES: usize = 4;
/// Input nodes of a group.
const GROUP_NODES: usize = GROUP_PAGES * PAGE;
/// Simplification steps of a group, each of which halves the number of nodes.
pub const HALVINGS: usize = 3;
/// Groups whose outputs are the input of one group.
pub const CHILD_GROUPS: usize = 1 << HALVINGS;
// The last step of a full group that has pages of its own fills a page.
const _: () = assert!(GROUP_NODES >> (HALVINGS - 1) >= PAGE);

/// All groups of one level of the hierarchy.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HierarchyLevel {
    /// Input nodes of all groups: the Gaussians of the scene, or the outputs of the level below.
    pub nodes: usize,
    /// The first page of the level behind the pages of the scene.
    pub first_page: usize,
    /// True if the input nodes are the Gaussians of the scene.
    pub is_leaf: bool,
}

impl HierarchyLevel {
    /// Number of groups.
    pub fn groups(&self) -> usize {
        self.nodes.div_ceil(GROUP_NODES)
    }

    /// Numbers of nodes of a group: of its input, and after each step.
    pub fn node_counts(&self, group: usize) -> [usize; HALVINGS + 1] {
        let mut nodes = GROUP_NODES.min(self.nodes - group * GROUP_NODES);
        std::array::from_fn(|step| {
            nodes = if step == 0 { nodes } else { nodes.div_ceil(2) };
            nodes
        })
    }

    /// The first pages of a group's input and of each step but the last, and one past the last page.
    pub fn page_starts(&self, group: usize) -> [usize; HALVINGS + 1] {
        let step_pages = GROUP_PAGES - 2 * GROUP_PAGES / CHILD_GROUPS;
        let begin = match self.is_leaf {
            true => self.first_page + group * step_pages,
            false => self.first_page + group * (GROUP_PAGES + step_pages),
        };
        let pages = self.node_counts(group).map(|nodes| nodes.div_ceil(PAGE));
        // The input of the leaf level is in the pages of the scene.
        let mut next = if self.is_leaf { begin } else { begin + pages[0] };
        std::array::from_fn(|step| match step {
            0 if self.is_leaf => group * GROUP_PAGES,
            0 => begin,
            _ => {
                let first = next;
                next += pages[step];
                first
            }
        })
    }

    /// The level above.
    pub fn above(&self) -> Self {
        let last = self.groups() - 1;
        let nodes = last * (GROUP_NODES / CHILD_GROUPS) + self.node_counts(last)[HALVINGS];
        Self { nodes, first_page: self.page_starts(last)[HALVINGS], is_leaf: false }
    }
}

/// The levels of the hierarchy of `count` Gaussians, from the leaves up. Empty if they fit into one page.
pub fn hierarchy_levels(count: usize) -> Vec<HierarchyLevel> {
    let mut levels: Vec<HierarchyLevel> = Vec::new();
    let mut next = HierarchyLevel { nodes: count, first_page: count.div_ceil(PAGE), is_leaf: true };
    while next.nodes > PAGE || levels.last().is_some_and(|below| below.groups() > 1) {
        levels.push(next);
        next = next.above();
    }
    levels
}

/// Number of pages of nodes that stand for several Gaussians.
pub fn inner_pages(count: usize) -> usize {
    // The output of the last group has a page of its own.
    let end = |level: &HierarchyLevel| level.above().first_page + 1;
    hierarchy_levels(count).last().map_or(0, |level| end(level) - count.div_ceil(PAGE))
}

/// The level of detail of each page of a file, 0 for the Gaussians of the scene.
pub fn levels_of_pages(count: usize) -> Vec<u16> {
    let mut levels = vec![0; count.div_ceil(PAGE) + inner_pages(count)];
    let hierarchy = hierarchy_levels(count);
    for (of_groups, first) in hierarchy.iter().zip((0..).step_by(HALVINGS)) {
        for pages in (0..of_groups.groups()).map(|group| of_groups.page_starts(group)) {
            // The input of the leaf level is in the pages of the scene, which are set already.
            for step in usize::from(of_groups.is_leaf)..HALVINGS {
                levels[pages[step]..pages[step + 1]].fill(first + step as u16);
            }
        }
    }
    if let Some(last) = levels.last_mut() {
        *last = (hierarchy.len() * HALVINGS) as u16;
    }
    levels
}

/// A subtree of the hierarchy: the pages of each level of detail, 0 for the Gaussians of the scene.
pub type Subtree = Vec<Vec<Range<usize>>>;

/// Splits the hierarchy into the fewest subtrees, at most `most` if its groups are small enough. All have the same
/// number of levels, and the coarsest has a 32nd of the Gaussians or less. They are in the order of the pages, so that
/// neighbours are near each other. Group outputs belong to no subtree, because the group above merges them.
pub fn subtrees(count: usize, most: usize) -> Vec<Subtree> {
    let hierarchy = hierarchy_levels(count);
    if hierarchy.is_empty() {
        return vec![vec![std::iter::once(0..count.div_ceil(PAGE)).collect()]];
    }
    let is_fit = |(number, level): &(usize, &HierarchyLevel)| *number > 0 && level.groups() <= most;
    let last = hierarchy.len() - 1;
    let root = hierarchy.iter().enumerate().find(is_fit).map_or(last, |(number, _)| number);
    let subtree = |index: usize| {
        let mut levels = Vec::new();
        for (number, level) in hierarchy[..=root].iter().enumerate() {
            let groups = CHILD_GROUPS.pow((root - number) as u32);
            let groups = index * groups..level.groups().min((index + 1) * groups);
            let pages: Vec<_> = groups.map(|group| level.page_starts(group)).collect();
            let range = |step: usize, pages: &[usize; HALVINGS + 1]| match step {
                // The input of the leaf level is in the pages of the scene.
                0 if level.is_leaf => pages[0]..(pages[0] + GROUP_PAGES).min(count.div_ceil(PAGE)),
                _ => pages[step]..pages[step + 1],
            };
            levels.extend((0..HALVINGS).map(|step| pages.iter().map(|pages| range(step, pages)).collect()));
        }
        levels
    };
    (0..hierarchy[root].groups()).map(subtree).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pages_of_the_levels_are_contiguous() {
        assert_eq!([1, 1024, 1025].map(inner_pages), [0, 0, 1 + 1 + 1]);
        for count in [1025, 5000, 8192, 8193, 70_000, 1_000_000] {
            let hierarchy = hierarchy_levels(count);
            let mut end = count.div_ceil(PAGE);
            for level in &hierarchy {
                assert_eq!(level.first_page, end, "{count}");
                for group in 0..level.groups() {
                    let (pages, nodes) = (level.page_starts(group), level.node_counts(group));
                    let begin = if level.is_leaf { 1 } else { 0 };
                    assert_eq!(pages[begin], end, "{count}");
                    for step in begin..HALVINGS {
                        assert_eq!(pages[step + 1] - pages[step], nodes[step].div_ceil(PAGE), "{count}");
                    }
                    end = pages[HALVINGS];
                }
            }
            assert_eq!(end + 1, count.div_ceil(PAGE) + inner_pages(count), "{count}");
            let (last, levels) = (hierarchy.last().unwrap(), levels_of_pages(count));
            let highest = (hierarchy.len() * HALVINGS) as u16;
            assert_eq!((levels.len(), levels[0], *levels.last().unwrap()), (end + 1, 0, highest), "{count}");
            assert!((0..=highest).all(|level| levels.contains(&level)), "{count}");
            assert!(last.groups() == 1 && last.above().nodes <= PAGE);
        }
    }

    /// Every page but those of the outputs of the coarsest groups is in one subtree, at its level.
    #[test]
    fn subtrees_hold_the_pages_of_a_scene_once() {
        for (count, most, expected, coarsest) in [
            (700, 9, 1, 0),
            (1025, 9, 1, 2),
            (4096, 9, 1, 2),
            (70_000, 9, 3, 5),
            (262_145, 9, 9, 5),
            (294_913, 9, 2, 8),
            (294_913, 1, 1, 11),
        ] {
            let levels = levels_of_pages(count);
            let subtrees = subtrees(count, most);
            assert_eq!(subtrees.len(), expected, "{count}");
            let mut seen = vec![0; levels.len()];
            for subtree in &subtrees {
                assert_eq!(subtree.len(), coarsest + 1, "{count}");
                for (level, pages) in subtree.iter().enumerate() {
                    for page in pages.iter().cloned().flatten() {
                        assert_eq!(levels[page], level as u16, "page {page} of {count}");
                        seen[page] += 1;
                    }
                }
            }
            let is_once = seen.iter().zip(&levels).all(|(seen, level)| *seen == i32::from(*level <= coarsest as u16));
            assert!(is_once, "{count}");
        }
    }
}
