//! Blocks of a hierarchy that are written: what the blocks above need of them, which is kept for another run.

use std::fs::File;
use std::sync::atomic::{AtomicUsize, Ordering};

use anyhow::Result;
use bytemuck::{cast_slice, pod_collect_to_vec};

use super::hierarchy_layout::Storey;
use crate::files::Kept;
use crate::lod::{Node, Nodes};
use crate::pagefile::Level;
use crate::scene::sh_coefficients;

/// The top of a block, whose parents are not known yet.
#[derive(Debug, PartialEq)]
pub struct Top {
    pub nodes: Nodes,
    /// The level below it: its pages and what their table says but for the page of the parents.
    pub last: Vec<(usize, Level)>,
    pub place: Place,
}

/// From where the nodes of a block are judged.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Place {
    pub low: [f32; 3],
    pub high: [f32; 3],
    /// Of the whole block.
    pub detail: f32,
    /// Of one of its levels, which is finer.
    pub own_detail: f32,
}

impl Place {
    /// The place of Gaussians of the scene.
    pub fn around(nodes: &Nodes) -> Self {
        let (low, high) = nodes.bounds();
        Self { low, high, detail: 0.0, own_detail: 0.0 }
    }

    /// A place that holds both.
    pub fn and(self, other: Self) -> Self {
        Self {
            low: [0, 1, 2].map(|i| self.low[i].min(other.low[i])),
            high: [0, 1, 2].map(|i| self.high[i].max(other.high[i])),
            detail: self.detail.max(other.detail),
            own_detail: self.own_detail.max(other.own_detail),
        }
    }
}

impl Top {
    fn encoded(&self) -> Vec<u8> {
        let Self { nodes, last, place: Place { low, high, detail, own_detail } } = self;
        let mut bytes = Vec::new();
        bytes.extend((nodes.len() as u64).to_le_bytes());
        bytes.extend([&low[..], &high[..], &[*detail, *own_detail]].into_iter().flat_map(cast_slice::<f32, u8>));
        bytes.extend(cast_slice::<Node, u8>(&nodes.nodes));
        bytes.extend(cast_slice::<[f32; 3], u8>(&nodes.sh));
        for (page, level) in last {
            bytes.extend((*page as u64).to_le_bytes());
            bytes.extend(level.encoded());
        }
        bytes
    }

    /// `None` if this is not what [`Self::encoded`] made of nodes of this degree.
    fn decoded(bytes: &[u8], sh_degree: u32) -> Option<Self> {
        let (count, rest) = bytes.split_first_chunk()?;
        let (place, rest) = rest.split_first_chunk::<32>()?;
        let [x0, y0, z0, x1, y1, z1, detail, own_detail]: [f32; 8] = bytemuck::pod_read_unaligned(place);
        let count = usize::try_from(u64::from_le_bytes(*count)).ok()?;
        let (nodes, rest) = rest.split_at_checked(count.checked_mul(size_of::<Node>())?)?;
        let (sh, rest) = rest.split_at_checked(count * sh_coefficients(sh_degree) * size_of::<[f32; 3]>())?;
        let (pages, []) = rest.as_chunks::<{ 8 + Level::BYTES }>() else { return None };
        let page = |entry: &[u8; 8 + Level::BYTES]| {
            let (page, level) = entry.split_first_chunk()?;
            Some((u64::from_le_bytes(*page) as usize, Level::decoded(level.first_chunk()?)))
        };
        Some(Self {
            nodes: Nodes { nodes: pod_collect_to_vec(nodes), sh: pod_collect_to_vec(sh), sh_degree },
            last: pages.iter().map(page).collect::<Option<_>>()?,
            place: Place { low: [x0, y0, z0], high: [x1, y1, z1], detail, own_detail },
        })
    }
}

/// Where the tops of the blocks of one storey are kept.
pub struct KeptTops<'k> {
    kept: &'k Kept,
    /// The file that holds all below a kept top.
    file: &'k File,
    /// Tops that were kept by an earlier run.
    pub found: AtomicUsize,
}

impl<'k> KeptTops<'k> {
    pub fn new(kept: &'k Kept, file: &'k File) -> Self {
        Self { kept, file, found: AtomicUsize::new(0) }
    }

    /// The storey whose tops are kept: the last one that has enough blocks for little to be lost.
    pub fn storey(storeys: &[Storey]) -> usize {
        const ENOUGH: usize = 64;
        storeys.iter().rposition(|storey| storey.blocks() >= ENOUGH).unwrap_or(0)
    }

    fn name(block: usize) -> String {
        format!("top.{block}")
    }

    /// The top of a block that an earlier run has written.
    pub fn find(&self, block: usize, sh_degree: u32) -> Option<Top> {
        let top = Top::decoded(&self.kept.content(&Self::name(block))?, sh_degree)?;
        self.found.fetch_add(1, Ordering::Relaxed);
        Some(top)
    }

    /// Keeps the top of a block, after all that is below it.
    ///
    /// # Errors
    /// If it cannot be written.
    pub fn keep(&self, block: usize, top: &Top) -> Result<()> {
        self.file.sync_data().map_err(|error| self.kept.failed(&error))?;
        self.kept.keep(&Self::name(block), &top.encoded())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pagefile::NO_PAGE;

    #[test]
    fn tops_are_read_as_they_were_written() {
        let mut nodes = Nodes::new(1);
        for i in 0..3 {
            nodes.push(
                Node::leaf([i as f32, 2.0, 3.0], [1.0, 0.0, 0.0, 0.0], [0.1, 0.2, 0.3], 0.5),
                &[[0.25; 3], [1.0, 2.0, i as f32], [0.0; 3], [4.0; 3]],
            );
        }
        let level = Level::of(&nodes.nodes, [&[1, 2, 3], &[4, 5, 6]], 1.0);
        let place = Place { detail: 0.5, own_detail: 0.25, ..Place::around(&nodes) };
        let top = Top { nodes, last: vec![(77, level), (78, Level { parent: NO_PAGE, ..level })], place };
        let bytes = top.encoded();
        assert_eq!(Top::decoded(&bytes, 1), Some(top));
        assert_eq!(Top::decoded(&bytes[..bytes.len() - 1], 1), None);
        assert_eq!(Top::decoded(&[], 1), None);
        assert_eq!(Top::decoded(&[255; 64], 1), None);
    }
}
