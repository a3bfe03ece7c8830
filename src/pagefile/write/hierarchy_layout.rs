//! Where the blocks of a hierarchy lie in a page file: the pages of their floors and levels.

use std::ops::Range;

use crate::pagefile::PAGE;

/// Pages whose nodes are the floor of a block.
pub const FLOOR: usize = 4;
/// The same in nodes.
const FLOOR_NODES: usize = FLOOR * PAGE;
/// Times that a floor is halved; what is left then is the top of a block.
pub const HALVINGS: usize = 3;
/// Tops of blocks that are the floor of the block above.
pub const TOPS: usize = 1 << HALVINGS;
// Whole blocks have whole pages.
const _: () = assert!(FLOOR_NODES >> (HALVINGS - 1) >= PAGE);

/// The blocks of one storey.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Storey {
    /// Nodes of all floors: the Gaussians of the scene, or the tops of the blocks below.
    pub nodes: usize,
    /// The first page of the storey, without floors that are pages of the scene.
    pub first: usize,
    pub is_ground: bool,
}

impl Storey {
    pub fn blocks(&self) -> usize {
        self.nodes.div_ceil(FLOOR_NODES)
    }

    /// Nodes of the floor, of the levels above it, and of the top of a block.
    pub fn levels_of(&self, block: usize) -> [usize; HALVINGS + 1] {
        let mut nodes = FLOOR_NODES.min(self.nodes - block * FLOOR_NODES);
        std::array::from_fn(|level| {
            nodes = if level == 0 { nodes } else { nodes.div_ceil(2) };
            nodes
        })
    }

    /// The first pages of the floor and of the levels above it, and the page behind them.
    pub fn pages_of(&self, block: usize) -> [usize; HALVINGS + 1] {
        let above_floor = FLOOR - 2 * FLOOR / TOPS;
        let begin = match self.is_ground {
            true => self.first + block * above_floor,
            false => self.first + block * (FLOOR + above_floor),
        };
        let pages = self.levels_of(block).map(|nodes| nodes.div_ceil(PAGE));
        // Floors on the ground are pages of the scene.
        let mut next = if self.is_ground { begin } else { begin + pages[0] };
        std::array::from_fn(|level| match level {
            0 if self.is_ground => block * FLOOR,
            0 => begin,
            _ => {
                let first = next;
                next += pages[level];
                first
            }
        })
    }

    /// The storey above.
    pub fn above(&self) -> Self {
        let last = self.blocks() - 1;
        let nodes = last * (FLOOR_NODES / TOPS) + self.levels_of(last)[HALVINGS];
        Self { nodes, first: self.pages_of(last)[HALVINGS], is_ground: false }
    }
}

/// The storeys of a scene of `count` Gaussians. None if it fits into one page.
pub fn storeys(count: usize) -> Vec<Storey> {
    let mut storeys: Vec<Storey> = Vec::new();
    let mut next = Storey { nodes: count, first: count.div_ceil(PAGE), is_ground: true };
    while next.nodes > PAGE || storeys.last().is_some_and(|below| below.blocks() > 1) {
        storeys.push(next);
        next = next.above();
    }
    storeys
}

/// Number of pages of nodes that stand for others.
pub fn pages_of_levels(count: usize) -> usize {
    // The top of the last block has a page of its own.
    let end = |storey: &Storey| storey.above().first + 1;
    storeys(count).last().map_or(0, |storey| end(storey) - count.div_ceil(PAGE))
}

/// By page of a file with levels of detail: the level of its nodes, 0 for the Gaussians of the scene.
pub fn levels_of_pages(count: usize) -> Vec<u32> {
    let mut levels = vec![0; count.div_ceil(PAGE) + pages_of_levels(count)];
    let storeys = storeys(count);
    for (storey, floor) in storeys.iter().zip((0..).step_by(HALVINGS)) {
        for pages in (0..storey.blocks()).map(|block| storey.pages_of(block)) {
            // Floors on the ground are pages of the scene.
            for level in usize::from(storey.is_ground)..HALVINGS {
                levels[pages[level]..pages[level + 1]].fill(floor + level as u32);
            }
        }
    }
    if let Some(last) = levels.last_mut() {
        *last = (storeys.len() * HALVINGS) as u32;
    }
    levels
}

/// A part of a scene that has levels of its own: by level, 0 for the Gaussians of the scene, the pages of its nodes.
pub type LevelsOfPart = Vec<Vec<Range<usize>>>;

/// The fewest parts, at most `most` where the scene has so large blocks, that hold the scene and all have the same
/// levels; each is coarsest with a 32nd of its Gaussians or less. Their order is that of the pages: neighbours lie near
/// each other. The tops of blocks belong to no part, because the block above mixes them.
pub fn parts(count: usize, most: usize) -> Vec<LevelsOfPart> {
    let storeys = storeys(count);
    if storeys.is_empty() {
        return vec![vec![std::iter::once(0..count.div_ceil(PAGE)).collect()]];
    }
    let is_fit = |(number, storey): &(usize, &Storey)| *number > 0 && storey.blocks() <= most;
    let last = storeys.len() - 1;
    let of = storeys.iter().enumerate().find(is_fit).map_or(last, |(number, _)| number);
    let levels_of = |part: usize| {
        let mut levels = Vec::new();
        for (number, storey) in storeys[..=of].iter().enumerate() {
            let blocks = TOPS.pow((of - number) as u32);
            let blocks = part * blocks..storey.blocks().min((part + 1) * blocks);
            let pages: Vec<_> = blocks.map(|block| storey.pages_of(block)).collect();
            let range = |level: usize, pages: &[usize; HALVINGS + 1]| match level {
                // Floors on the ground are pages of the scene.
                0 if storey.is_ground => pages[0]..(pages[0] + FLOOR).min(count.div_ceil(PAGE)),
                _ => pages[level]..pages[level + 1],
            };
            levels.extend((0..HALVINGS).map(|level| pages.iter().map(|pages| range(level, pages)).collect()));
        }
        levels
    };
    (0..storeys[of].blocks()).map(levels_of).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pages_of_storeys_follow_each_other() {
        assert_eq!([1, 1024, 1025].map(pages_of_levels), [0, 0, 1 + 1 + 1]);
        for count in [1025, 5000, 8192, 8193, 70_000, 1_000_000] {
            let storeys = storeys(count);
            let mut end = count.div_ceil(PAGE);
            for storey in &storeys {
                assert_eq!(storey.first, end, "{count}");
                for block in 0..storey.blocks() {
                    let (pages, nodes) = (storey.pages_of(block), storey.levels_of(block));
                    let begin = if storey.is_ground { 1 } else { 0 };
                    assert_eq!(pages[begin], end, "{count}");
                    for level in begin..HALVINGS {
                        assert_eq!(pages[level + 1] - pages[level], nodes[level].div_ceil(PAGE), "{count}");
                    }
                    end = pages[HALVINGS];
                }
            }
            assert_eq!(end + 1, count.div_ceil(PAGE) + pages_of_levels(count), "{count}");
            let (last, levels) = (storeys.last().unwrap(), levels_of_pages(count));
            let highest = (storeys.len() * HALVINGS) as u32;
            assert_eq!((levels.len(), levels[0], *levels.last().unwrap()), (end + 1, 0, highest), "{count}");
            assert!((0..=highest).all(|level| levels.contains(&level)), "{count}");
            assert!(last.blocks() == 1 && last.above().nodes <= PAGE);
        }
    }
    /// Every page but those of the tops of the coarsest blocks is in one part, at its level.
    #[test]
    fn parts_hold_the_pages_of_a_scene_once() {
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
            let parts = parts(count, most);
            assert_eq!(parts.len(), expected, "{count}");
            let mut seen = vec![0; levels.len()];
            for part in &parts {
                assert_eq!(part.len(), coarsest + 1, "{count}");
                for (level, pages) in part.iter().enumerate() {
                    for page in pages.iter().cloned().flatten() {
                        assert_eq!(levels[page], level as u32, "page {page} of {count}");
                        seen[page] += 1;
                    }
                }
            }
            let is_once = seen.iter().zip(&levels).all(|(seen, level)| *seen == i32::from(*level <= coarsest as u32));
            assert!(is_once, "{count}");
        }
    }
}
