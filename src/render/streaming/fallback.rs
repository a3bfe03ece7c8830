//! Which pages hold the parents of which, and the least limits of errors under which every node that is drawn is in
//! device memory.
//!
//! A node is drawn in the place of its children where its error is within the limit of its block. So that no child is
//! drawn whose page is missing, the limit of the block is at least the largest error among the parents of the missing
//! pages: its *floor*. A floor holds for all blocks below, too. Limits then still do not fall from the root to the
//! leaves, as the cut needs it: on every way to the root exactly one node is drawn, whichever pages are missing.

use std::collections::HashMap;

use rayon::prelude::*;

use crate::lod::FINEST;
use crate::pagefile::{NO_PAGE, PageLod};

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
    /// By block: one that holds the parents of its coarsest nodes; [`NONE`] for the last.
    up: Vec<u32>,
    /// By page: the largest error of a parent, as a code.
    coarsest: Vec<u16>,
}

/// What is wanted of the blocks of a hierarchy.
pub struct Wishes {
    /// By block: what its children's errors are worth, added to their codes; [`NOTHING`] if none is wanted.
    more: Vec<i32>,
    /// By block: the lowest limit for which its children are wanted.
    limits: Vec<u16>,
    /// The blocks that are wanted.
    blocks: Vec<u32>,
}

/// Less than any wish.
const NOTHING: i32 = i32::MIN;

/// Pages or blocks that a thread takes at least: fewer are not worth a thread.
const SHARE: usize = 1 << 14;

/// No block.
const NONE: u32 = u32::MAX;

impl Family {
    pub fn of(levels: &[PageLod]) -> Self {
        let mut known = HashMap::new();
        let mut own = vec![NONE; levels.len()];
        // From the root, so that the parents of a block come before it.
        for (page, PageLod { low, high, reference_width, .. }) in levels.iter().enumerate().rev() {
            let place = (low.map(f32::to_bits), high.map(f32::to_bits), reference_width.to_bits());
            let next = known.len() as u32;
            own[page] = *known.entry(place).or_insert(next);
        }
        let block_above = |level: &PageLod| if level.parent == NO_PAGE { NONE } else { own[level.parent as usize] };
        let above: Vec<u32> = levels.iter().map(block_above).collect();
        let mut edges: Vec<_> = own.iter().copied().zip(above.iter().copied()).collect();
        edges.retain(|(own, above)| own != above && *above != NONE);
        edges.sort_unstable();
        edges.dedup();
        let mut children = vec![Vec::new(); known.len()];
        for (page, block) in above.iter().enumerate().filter(|(_, block)| **block != NONE) {
            children[*block as usize].push(page as u32);
        }
        let coarsest = levels.iter().map(|level| level.parent_errors[level.parent_errors.len() - 1]).collect();
        let mut up = vec![NONE; children.len()];
        edges.iter().for_each(|(own, above)| up[*own as usize] = *above);
        Self { own, above, edges, children, up, coarsest }
    }

    /// No wishes.
    pub fn wishes(&self) -> Wishes {
        let blocks = self.children.len();
        Wishes { more: vec![NOTHING; blocks], limits: vec![u16::MAX; blocks], blocks: Vec::new() }
    }

    /// Wants the nodes of a page whose parents are above a limit, and all pages that have to be there for them: those
    /// with parents above it in the same block, in view or not, and in the blocks above. `priority` is what the errors
    /// of the coarsest parents of the page are worth.
    pub fn wish(&self, wishes: &mut Wishes, page: u32, priority: u32, limit: u16) {
        let more = priority as i32 - i32::from(self.coarsest[page as usize]);
        let mut block = self.above[page as usize];
        while block != NONE {
            let (known, lowest) = (&mut wishes.more[block as usize], &mut wishes.limits[block as usize]);
            if *known >= more && *lowest <= limit {
                return;
            }
            if *known == NOTHING {
                wishes.blocks.push(block);
            }
            (*known, *lowest) = (more.max(*known), limit.min(*lowest));
            block = self.up[block as usize];
        }
    }

    /// The wanted pages and what they are worth.
    pub fn wanted(&self, wishes: &Wishes) -> impl Iterator<Item = (u32, i32)> {
        wishes.blocks.iter().flat_map(move |block| {
            let limit = wishes.limits[*block as usize];
            let wanted =
                self.children[*block as usize].iter().filter(move |page| self.coarsest[**page as usize] > limit);
            wanted.filter_map(move |page| Some((*page, self.worth(wishes, *page)?)))
        })
    }

    /// What a page is worth, if its block is wanted.
    pub fn worth(&self, wishes: &Wishes, page: u32) -> Option<i32> {
        let more = *wishes.more.get(self.above[page as usize] as usize)?;
        (more != NOTHING).then(|| i32::from(self.coarsest[page as usize]) + more)
    }

    /// The floor of every block.
    pub fn floors(&self, is_here: impl Fn(u32) -> bool + Sync) -> Vec<u16> {
        let floor = |children: &Vec<u32>| {
            let missing = children.iter().filter(|page| !is_here(**page));
            missing.map(|page| self.coarsest[*page as usize]).max().unwrap_or(FINEST)
        };
        let mut floors: Vec<u16> = self.children.par_iter().with_min_len(SHARE).map(floor).collect();
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

    /// Writes for every page the floors of its block and of that of its parents, codes in the lower and in the upper
    /// half.
    ///
    /// # Panics
    /// If `words` has not a word for every page.
    pub fn words(&self, floors: &[u16], words: &mut [u32]) {
        assert_eq!(words.len(), self.own.len(), "every page has its word");
        let floor = |block: u32| floors.get(block as usize).copied().unwrap_or(FINEST);
        let blocks = self.own.par_iter().zip(&self.above);
        words.par_iter_mut().zip(blocks).with_min_len(SHARE).for_each(|(word, (own, above))| {
            *word = u32::from(floor(*own)) | u32::from(floor(*above)) << 16;
        });
    }
}
