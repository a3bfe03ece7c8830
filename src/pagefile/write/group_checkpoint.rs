//! Outputs of finished groups, and the checkpoint that keeps them for another run.

use std::fs::File;
use std::sync::atomic::{AtomicUsize, Ordering};

use anyhow::Result;
use bytemuck::{cast_slice, pod_collect_to_vec};

use super::hierarchy_layout::HierarchyLevel;
use crate::files::Checkpoint;
use crate::lod::{Node, Nodes};
use crate::pagefile::PageLod;
use crate::scene::sh_coefficients;

/// The output nodes of a group. Their parents are not known yet.
#[derive(Debug, PartialEq)]
pub struct GroupOutput {
    pub nodes: Nodes,
    /// The pages of the step before, and their table entries, which lack the page of the parents.
    pub last_pages: Vec<(usize, PageLod)>,
    pub bounds: GroupBounds,
}

/// The box to which distances of the nodes of a group are measured, and their reference pixel widths.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GroupBounds {
    pub low: [f32; 3],
    pub high: [f32; 3],
    /// The largest of the group, world units.
    pub reference_width: f32,
    /// Of the nodes of one step, world units.
    pub own_reference_width: f32,
}

impl GroupBounds {
    /// The bounds of Gaussians of the scene.
    pub fn around(nodes: &Nodes) -> Self {
        let (low, high) = nodes.bounds();
        Self { low, high, reference_width: 0.0, own_reference_width: 0.0 }
    }

    /// The union of two bounds.
    pub fn union(self, other: Self) -> Self {
        Self {
            low: [0, 1, 2].map(|i| self.low[i].min(other.low[i])),
            high: [0, 1, 2].map(|i| self.high[i].max(other.high[i])),
            reference_width: self.reference_width.max(other.reference_width),
            own_reference_width: self.own_reference_width.max(other.own_reference_width),
        }
    }
}

impl GroupOutput {
    fn encoded(&self) -> Vec<u8> {
        let Self { nodes, last_pages, bounds: GroupBounds { low, high, reference_width, own_reference_width } } = self;
        let mut bytes = Vec::new();
        bytes.extend((nodes.len() as u64).to_le_bytes());
        bytes.extend(
            [&low[..], &high[..], &[*reference_width, *own_reference_width]]
                .into_iter()
                .flat_map(cast_slice::<f32, u8>),
        );
        bytes.extend(cast_slice::<Node, u8>(&nodes.nodes));
        bytes.extend(cast_slice::<[f32; 3], u8>(&nodes.sh));
        for (page, level) in last_pages {
            bytes.extend((*page as u64).to_le_bytes());
            bytes.extend(level.encoded());
        }
        bytes
    }

    /// `None` if the bytes are not an encoded output with nodes of this degree.
    fn decoded(bytes: &[u8], sh_degree: u32) -> Option<Self> {
        let (count, rest) = bytes.split_first_chunk()?;
        let (bounds, rest) = rest.split_first_chunk::<32>()?;
        let [x0, y0, z0, x1, y1, z1, reference_width, own_reference_width]: [f32; 8] =
            bytemuck::pod_read_unaligned(bounds);
        let count = usize::try_from(u64::from_le_bytes(*count)).ok()?;
        let (nodes, rest) = rest.split_at_checked(count.checked_mul(size_of::<Node>())?)?;
        let (sh, rest) = rest.split_at_checked(count * sh_coefficients(sh_degree) * size_of::<[f32; 3]>())?;
        let (pages, []) = rest.as_chunks::<{ 8 + PageLod::BYTES }>() else { return None };
        let page = |entry: &[u8; 8 + PageLod::BYTES]| {
            let (page, level) = entry.split_first_chunk()?;
            Some((u64::from_le_bytes(*page) as usize, PageLod::decoded(level.first_chunk()?)))
        };
        Some(Self {
            nodes: Nodes { nodes: pod_collect_to_vec(nodes), sh: pod_collect_to_vec(sh), sh_degree },
            last_pages: pages.iter().map(page).collect::<Option<_>>()?,
            bounds: GroupBounds { low: [x0, y0, z0], high: [x1, y1, z1], reference_width, own_reference_width },
        })
    }
}

/// The checkpoint of the outputs of all groups of one hierarchy level.
pub struct GroupCheckpoint<'k> {
    checkpoint: &'k Checkpoint,
    /// The output file, which holds all pages below a kept output.
    file: &'k File,
    /// Number of outputs that were found from an earlier run.
    pub found: AtomicUsize,
}

impl<'k> GroupCheckpoint<'k> {
    pub fn new(checkpoint: &'k Checkpoint, file: &'k File) -> Self {
        Self { checkpoint, file, found: AtomicUsize::new(0) }
    }

    /// The index of the level whose outputs are kept: the highest one with enough groups that an interruption loses
    /// little.
    pub fn level(levels: &[HierarchyLevel]) -> usize {
        const ENOUGH: usize = 64;
        levels.iter().rposition(|level| level.groups() >= ENOUGH).unwrap_or(0)
    }

    fn name(group: usize) -> String {
        format!("top.{group}")
    }

    /// The output of a group, if an earlier run has written it.
    pub fn find(&self, group: usize, sh_degree: u32) -> Option<GroupOutput> {
        let output = GroupOutput::decoded(&self.checkpoint.read(&Self::name(group))?, sh_degree)?;
        self.found.fetch_add(1, Ordering::Relaxed);
        Some(output)
    }

    /// Keeps the output of a group, once all pages below it are on the disk.
    ///
    /// # Errors
    /// If it cannot be written.
    pub fn save(&self, group: usize, output: &GroupOutput) -> Result<()> {
        self.file.sync_data().map_err(|error| self.checkpoint.failed(&error))?;
        self.checkpoint.save(&Self::name(group), &output.encoded())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pagefile::NO_PAGE;

    #[test]
    fn outputs_are_read_as_they_were_written() {
        let mut nodes = Nodes::new(1);
        for i in 0..3 {
            nodes.push(
                Node::leaf([i as f32, 2.0, 3.0], [1.0, 0.0, 0.0, 0.0], [0.1, 0.2, 0.3], 0.5),
                &[[0.25; 3], [1.0, 2.0, i as f32], [0.0; 3], [4.0; 3]],
            );
        }
        let level = PageLod::of(&nodes.nodes, [&[1, 2, 3], &[4, 5, 6]], 1.0);
        let bounds = GroupBounds { reference_width: 0.5, own_reference_width: 0.25, ..GroupBounds::around(&nodes) };
        let output =
            GroupOutput { nodes, last_pages: vec![(77, level), (78, PageLod { parent: NO_PAGE, ..level })], bounds };
        let bytes = output.encoded();
        assert_eq!(GroupOutput::decoded(&bytes, 1), Some(output));
        assert_eq!(GroupOutput::decoded(&bytes[..bytes.len() - 1], 1), None);
        assert_eq!(GroupOutput::decoded(&[], 1), None);
        assert_eq!(GroupOutput::decoded(&[255; 64], 1), None);
    }
}
