//! Which pages hold the parents of which, and the least limits of errors under which every node that is drawn is in
//! device memory.
//!
//! A node is drawn in the place of its children where its error is within the limit of its block. So that no child is
//! drawn whose page is missing, the limit of the block is at least the largest error among the parents of the missing
//! pages: its *floor*. A floor holds for all blocks below, too. Limits then still do not fall from the root to the
//! leaves, as the cut needs it: on every way to the root exactly one node is drawn, whichever pages are missing.

use std::collections::HashMap;

use crate::levels::FINEST;
use crate::storage::{Level, NO_PAGE};

/// The blocks of a hierarchy: pages that are judged from the same place.
pub struct Family {
    /// By page: its block.
    own: Vec<u32>,
    /// By page: the block of the parents of its nodes; [`NONE`] for the last.
    above: Vec<u32>,
    /// A block, and one that holds parents of its nodes; the coarsest first.
    edges: Vec<(u32, u32)>,
    /// By block: the pages whose nodes have their parents in it.
    children: Vec<Vec<u32>>,
    /// By page: the largest error of a parent, as a code.
    coarsest: Vec<u16>,
}

/// No block.
const NONE: u32 = u32::MAX;

impl Family {
    pub fn of(levels: &[Level]) -> Self {
        let mut known = HashMap::new();
        let mut own = vec![NONE; levels.len()];
        // From the root, so that the parents of a block come before it.
        for (page, Level { low, high, detail, .. }) in levels.iter().enumerate().rev() {
            let place = (low.map(f32::to_bits), high.map(f32::to_bits), detail.to_bits());
            let next = known.len() as u32;
            own[page] = *known.entry(place).or_insert(next);
        }
        let block_above = |level: &Level| if level.parent == NO_PAGE { NONE } else { own[level.parent as usize] };
        let above: Vec<u32> = levels.iter().map(block_above).collect();
        let mut edges: Vec<_> = own.iter().copied().zip(above.iter().copied()).collect();
        edges.retain(|(own, above)| own != above && *above != NONE);
        edges.sort_unstable();
        edges.dedup();
        let mut children = vec![Vec::new(); known.len()];
        for (page, block) in above.iter().enumerate().filter(|(_, block)| **block != NONE) {
            children[*block as usize].push(page as u32);
        }
        let coarsest = levels.iter().map(|level| level.parents[level.parents.len() - 1]).collect();
        Self { own, above, edges, children, coarsest }
    }

    /// The block with the parents of a page, and the largest error of these, as a code; none for the last page.
    pub fn parents(&self, page: u32) -> Option<(usize, u16)> {
        let block = self.above[page as usize] as usize;
        (block < self.children.len()).then_some((block, self.coarsest[page as usize]))
    }

    /// The pages that have to be there so that the floor of a block is at most `limit`.
    pub fn needed(&self, block: usize, limit: u16, mut each: impl FnMut(u32, u16)) {
        let mut next = Some(block);
        while let Some(block) = next {
            for page in &self.children[block] {
                let coarsest = self.coarsest[*page as usize];
                if coarsest > limit {
                    each(*page, coarsest);
                }
            }
            next = self.above(block);
        }
    }

    /// The block with the parents of the coarsest nodes of a block.
    pub fn above(&self, block: usize) -> Option<usize> {
        let place = self.edges.partition_point(|(own, _)| (*own as usize) < block);
        self.edges.get(place).filter(|(own, _)| *own as usize == block).map(|(_, above)| *above as usize)
    }

    /// The floor of every block.
    pub fn floors(&self, is_here: impl Fn(u32) -> bool) -> Vec<u16> {
        let floor = |children: &Vec<u32>| {
            let missing = children.iter().filter(|page| !is_here(**page));
            missing.map(|page| self.coarsest[*page as usize]).max().unwrap_or(FINEST)
        };
        let mut floors: Vec<u16> = self.children.iter().map(floor).collect();
        // Once, if parents come first, as smalto writes them.
        let mut is_changed = true;
        while is_changed {
            is_changed = false;
            for (own, above) in &self.edges {
                let floor = floors[*above as usize];
                is_changed |= floors[*own as usize] < floor;
                floors[*own as usize] = floors[*own as usize].max(floor);
            }
        }
        floors
    }

    /// For every page the floors of its block and of that of its parents, codes in the lower and in the upper half.
    pub fn words(&self, floors: &[u16]) -> Vec<u32> {
        let floor = |block: u32| floors.get(block as usize).copied().unwrap_or(FINEST);
        let words = self.own.iter().zip(&self.above);
        words.map(|(own, above)| u32::from(floor(*own)) | u32::from(floor(*above)) << 16).collect()
    }
}
