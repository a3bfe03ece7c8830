//! Where the blocks of a hierarchy lie in a page file: the pages of their floors and levels.

use crate::storage::pages::PAGE;

/// Pages whose nodes are the floor of a block.
pub const FLOOR: usize = 8;
/// The same in nodes.
const FLOOR_NODES: usize = FLOOR * PAGE;

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

    /// Nodes of the floor, the first and the second level, and the top of a block.
    pub fn levels_of(&self, block: usize) -> [usize; 4] {
        let floor = FLOOR_NODES.min(self.nodes - block * FLOOR_NODES);
        let first = floor.div_ceil(2);
        let second = first.div_ceil(2);
        [floor, first, second, second.div_ceil(2)]
    }

    /// The first pages of the floor, the first and the second level of a block, and the page behind them.
    pub fn pages_of(&self, block: usize) -> [usize; 4] {
        let [floor, first, second] = [0, 1, 2].map(|level| self.levels_of(block)[level].div_ceil(PAGE));
        let whole = (FLOOR_NODES / 2 + FLOOR_NODES / 4) / PAGE;
        if self.is_ground {
            let begin = self.first + block * whole;
            return [block * FLOOR, begin, begin + first, begin + first + second];
        }
        let begin = self.first + block * (FLOOR + whole);
        [begin, begin + floor, begin + floor + first, begin + floor + first + second]
    }

    /// The storey above.
    pub fn above(&self) -> Self {
        let last = self.blocks() - 1;
        let nodes = last * PAGE + self.levels_of(last)[3];
        Self { nodes, first: self.pages_of(last)[3], is_ground: false }
    }
}

/// The storeys of a scene of `count` Gaussians. None if it fits into one page.
pub fn storeys(count: usize) -> Vec<Storey> {
    let mut storeys = Vec::new();
    let mut next = Storey { nodes: count, first: count.div_ceil(PAGE), is_ground: true };
    while next.nodes > PAGE {
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
                    for level in begin..3 {
                        assert_eq!(pages[level + 1] - pages[level], nodes[level].div_ceil(PAGE), "{count}");
                    }
                    end = pages[3];
                }
            }
            assert_eq!(end + 1, count.div_ceil(PAGE) + pages_of_levels(count), "{count}");
            assert!(storeys.last().unwrap().above().nodes <= PAGE);
        }
    }
}
