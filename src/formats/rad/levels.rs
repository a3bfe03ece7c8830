//! All levels of a `.rad` with a tree: parts of the tree with some thousand Gaussians of the scene, each at several
//! levels.

use std::collections::HashSet;
use std::ops::Range;

use anyhow::{Context, Result, ensure};
use rayon::prelude::*;

use super::read::RadFile;
use crate::formats::input::Input;
use crate::formats::{Leaf, Request, SourceLevels};
use crate::host_memory::host_vec;
use crate::scene::{Builder, Cancelled, NoLevel, Scene};

/// Most Gaussians of the scene that change their level together.
const MOST_LEAVES: u32 = 8192;
/// Most of them in one subtree. Subtrees near each other change their level together.
const MOST_IN_SUBTREE: u32 = 512;
/// A level of more nodes is followed by one of half as many, the others by one of an eighth: so many fit into a page.
const FEW: usize = 1024;

/// Reads the leaves of the tree, and the nodes of coarser levels. A part of the tree, subtrees near each other, takes
/// the place of a leaf of a streamed SOG.
pub(crate) fn read_levels(mut input: Input, request: &Request) -> Result<SourceLevels> {
    let input = &mut input;
    let file = RadFile::open(input, request.path)?;
    ensure!(file.has_tree(), NoLevel::no_levels());
    ensure!(u32::try_from(file.count).is_ok(), "{} nodes are not supported", file.count);
    let go_on = || if (request.watch.is_cancelled)() { Err(Cancelled) } else { Ok(()) };
    let (mut chunks, mut children) = (Vec::new(), host_vec(file.count, "the tree")?);
    file.chunks(input, |_, chunk, columns| {
        go_on()?;
        children.extend(chunk.children()?);
        chunks.push(columns);
        Ok(())
    })?;
    let place = |node: u32| (&chunks[node as usize / file.in_chunk], node as usize % file.in_chunk);
    let extent = |node| {
        let (columns, index) = place(node);
        (columns.mean(index), columns.size(index))
    };
    let extents = (0..children.len() as u32).into_par_iter().map(extent).collect();
    let tree = Tree::new(children, extents)?;
    go_on()?;
    let parts = tree.parts([MOST_LEAVES, MOST_IN_SUBTREE]);
    let parts: Vec<Vec<Vec<u32>>> = parts.par_iter().map(|roots| tree.cuts(roots)).collect();
    let of_scene = parts.iter().map(|cuts| cuts[0].len()).sum();
    let all: usize = parts.iter().flatten().map(Vec::len).sum();
    let (mut finest, mut coarser) =
        (input.builder(file.degree, of_scene)?, input.builder(file.degree, all - of_scene)?);
    let add = |builder: &mut Builder, cut: &Vec<u32>| {
        let begin = builder.len();
        builder.extend(cut.len(), |i, sh| {
            let (columns, index) = place(cut[i]);
            columns.gaussian(index, sh)
        });
        begin..builder.len()
    };
    let mut leaves = Vec::new();
    for cuts in &parts {
        go_on()?;
        let own = add(&mut finest, &cuts[0]);
        // Nothing stands for Gaussians that cannot be drawn.
        if !own.is_empty() {
            let ranges = cuts[1..].iter().map(|cut| add(&mut coarser, cut)).filter(|range| !range.is_empty());
            leaves.push(Leaf { finest: own, coarser: ranges.collect() });
        }
    }
    let ((gaussians, report), (coarser, of_coarser)) = (finest.finish(), coarser.finish());
    let left_out = (of_coarser.dropped() > 0)
        .then(|| format!("{} nodes of coarser levels are left out: they cannot be drawn", of_coarser.dropped()));
    let scene = Scene { gaussians, report, notices: left_out.into_iter().collect(), ..Scene::empty(&file.format()) };
    Ok(SourceLevels { scene, coarser, leaves })
}

/// The tree of the nodes of a file. The first node is the root.
struct Tree {
    children: Vec<Range<u32>>,
    means: Vec<[f32; 3]>,
    /// Sizes of nodes, none of which is smaller than what is below it.
    sizes: Vec<f32>,
    /// Number of leaves below each node; 1 of a leaf.
    leaves: Vec<u32>,
}

impl Tree {
    /// The tree of nodes with these children, and means and sizes.
    fn new(children: Vec<Range<u32>>, extents: Vec<([f32; 3], f32)>) -> Result<Self> {
        let (means, mut sizes): (Vec<_>, Vec<_>) = extents.into_iter().unzip();
        ensure!(!children.is_empty(), "its tree has no nodes");
        // Parents come before their children.
        let (mut order, mut is_found) = (vec![0], vec![false; children.len()]);
        is_found[0] = true;
        let mut next = 0;
        while let Some(of_node) = order.get(next).and_then(|node| children.get(*node as usize)) {
            for child in of_node.clone() {
                let count = children.len();
                let found = is_found.get_mut(child as usize);
                let found = found.with_context(|| format!("its tree names node {child}, and there are {count}"))?;
                ensure!(!std::mem::replace(found, true), "its tree names node {child} of {count} twice");
                order.push(child);
            }
            next += 1;
        }
        ensure!(
            next == children.len(),
            "{} of its {} nodes are not in its tree",
            children.len() - next,
            children.len()
        );
        let mut leaves = vec![0; children.len()];
        for node in order.into_iter().rev().map(|node| node as usize) {
            let below = children[node].start as usize..children[node].end as usize;
            sizes[node] = sizes[below.clone()].iter().copied().fold(sizes[node], f32::max);
            leaves[node] = leaves[below].iter().sum::<u32>().max(1);
        }
        Ok(Self { children, means, sizes, leaves })
    }

    fn of(&self, node: u32) -> Range<u32> {
        self.children[node as usize].clone()
    }

    /// Visits the nodes of the subtrees of these roots, parents first. The children of a node are visited only if
    /// `visit` returns true for it.
    fn walk(&self, roots: &[u32], mut visit: impl FnMut(u32) -> bool) {
        let mut to_visit: Vec<u32> = roots.iter().rev().copied().collect();
        while let Some(node) = to_visit.pop() {
            if visit(node) {
                to_visit.extend(self.of(node).rev());
            }
        }
    }

    /// The roots of subtrees that hold all leaves, part by part: a part has at most `most` leaves, a subtree at most
    /// `most_in_subtree`.
    fn parts(&self, [most, most_in_subtree]: [u32; 2]) -> Vec<Vec<u32>> {
        let mut roots = Vec::new();
        self.walk(&[0], |node| {
            let is_large = self.leaves[node as usize] > most_in_subtree;
            roots.extend((!is_large).then_some(node));
            is_large
        });
        let (mut parts, mut to_split) = (Vec::new(), vec![roots]);
        while let Some(roots) = to_split.pop() {
            if roots.len() > 1 && self.leaves_of(&roots) > most {
                to_split.extend(self.halves(roots));
            } else {
                parts.push(roots);
            }
        }
        parts
    }

    /// The number of leaves below these nodes.
    fn leaves_of(&self, roots: &[u32]) -> u32 {
        roots.iter().map(|root| self.leaves[*root as usize]).sum()
    }

    /// Halves of several subtrees with about as many leaves each, cut across the longest side of the box of the means.
    fn halves(&self, mut roots: Vec<u32>) -> [Vec<u32>; 2] {
        let all = self.leaves_of(&roots);
        let along = |axis: usize| roots.iter().map(move |root| self.means[*root as usize][axis]);
        let side = |axis: &usize| along(*axis).fold(f32::MIN, f32::max) - along(*axis).fold(f32::MAX, f32::min);
        let longest = (0..3).max_by(|a, b| side(a).total_cmp(&side(b))).expect("three axes");
        let at = |root: &u32| self.means[*root as usize][longest];
        roots.sort_by(|a, b| at(a).total_cmp(&at(b)));
        let mut before = 0;
        let is_half = |root: &u32| {
            before += self.leaves[*root as usize];
            before >= all.div_ceil(2)
        };
        let half = roots.iter().position(is_half).map_or(1, |last| last + 1).min(roots.len() - 1);
        let others = roots.split_off(half);
        [others, roots]
    }

    /// The levels of a part, the finest first: the leaves, then nodes that stand for them. The smallest nodes are
    /// drawn in place of their children first.
    fn cuts(&self, roots: &[u32]) -> Vec<Vec<u32>> {
        let mut inner = Vec::new();
        self.walk(roots, |node| {
            inner.extend((!self.of(node).is_empty()).then_some(node));
            true
        });
        // Of equal sizes, children come first.
        inner.reverse();
        inner.sort_by(|a, b| self.sizes[*a as usize].total_cmp(&self.sizes[*b as usize]));
        let mut drawn = HashSet::new();
        let cut = |drawn: &HashSet<u32>| {
            let mut cut = Vec::new();
            self.walk(roots, |node| {
                let is_split = !self.of(node).is_empty() && !drawn.contains(&node);
                cut.extend((!is_split).then_some(node));
                is_split
            });
            cut
        };
        let mut cuts = vec![cut(&drawn)];
        let (mut count, mut inner) = (cuts[0].len(), inner.into_iter().peekable());
        while inner.peek().is_some() {
            let (finer, most) = (count, if count > FEW { count / 2 } else { count / 8 });
            while let Some(node) = inner.next_if(|_| count > most) {
                count -= self.of(node).len() - 1;
                drawn.insert(node);
            }
            if count <= finer / 2 {
                cuts.push(cut(&drawn));
            }
        }
        cuts
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A root with two children, which have three leaves and four. Their means are their numbers.
    fn tree() -> Tree {
        let children = vec![1..3, 3..6, 6..10, 0..0, 0..0, 0..0, 0..0, 0..0, 0..0, 0..0];
        let sizes = [1.0, 2.0, 3.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 4.0];
        Tree::new(children, sizes.into_iter().enumerate().map(|(i, size)| ([0.0, i as f32, 0.0], size)).collect())
            .unwrap()
    }

    #[test]
    fn sizes_and_leaves_are_those_below() {
        assert_eq!(tree().sizes[..4], [4.0, 2.0, 4.0, 1.0]);
        assert_eq!(tree().leaves[..4], [7, 3, 4, 1]);
    }

    #[test]
    fn parts_have_all_leaves() {
        assert_eq!(tree().parts([7, 7]), [vec![0]]);
        assert_eq!(tree().parts([7, 4]), [vec![1, 2]]);
        assert_eq!(tree().parts([6, 4]), [vec![1], vec![2]]);
        assert_eq!(tree().parts([4, 3]), [vec![1, 6], vec![7, 8, 9]]);
        assert_eq!(tree().parts([2, 1]), [vec![3, 4], vec![5, 6], vec![7, 8], vec![9]]);
        assert_eq!(tree().parts([1, 4]), [vec![1], vec![2]]);
    }

    #[test]
    fn small_nodes_are_drawn_first() {
        let tree = tree();
        assert_eq!(tree.cuts(&[1, 2]), [vec![3, 4, 5, 6, 7, 8, 9], vec![1, 2]]);
        // 2000 leaves, the first of which have smaller parents.
        let pairs = (0..1000).map(|i| 1001 + 2 * i..1003 + 2 * i);
        let children = std::iter::once(1..1001).chain(pairs).chain(vec![0..0; 2000]).collect();
        let extents = (0..3001).map(|i| ([0.0; 3], i as f32)).collect();
        let cuts = Tree::new(children, extents).unwrap().cuts(&[0]);
        assert_eq!(cuts.iter().map(Vec::len).collect::<Vec<_>>(), [2000, 1000, 1]);
        let children = std::iter::once(1..1501).chain((0..1500).map(|i| 1501 + 2 * i..1503 + 2 * i));
        let children: Vec<Range<u32>> = children.chain(vec![0..0; 3000]).collect();
        let extents = vec![([0.0; 3], 0.0); children.len()];
        let tree = Tree::new(children, extents).unwrap();
        assert_eq!(tree.cuts(&[0]).iter().map(Vec::len).collect::<Vec<_>>(), [3000, 1500, 1]);
    }

    #[test]
    fn what_is_no_tree_is_refused() {
        let refused = |children: Vec<Range<u32>>| {
            let extents = vec![([0.0; 3], 1.0); children.len()];
            Tree::new(children, extents).err().unwrap().to_string()
        };
        assert_eq!(refused(Vec::new()), "its tree has no nodes");
        assert_eq!(refused(vec![1..3, 0..0, 1..2]), "its tree names node 1 of 3 twice");
        assert_eq!(refused(vec![0..1; 1]), "its tree names node 0 of 1 twice");
        assert_eq!(refused(vec![1..3, 0..0]), "its tree names node 2, and there are 2");
        assert_eq!(refused(vec![1..2, 0..0, 0..0]), "1 of its 3 nodes are not in its tree");
    }
}
