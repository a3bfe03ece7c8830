//! The constants of the fast path's stages, and the fingerprint under which a device remembers a passed self-test.

use anyhow::Result;

use crate::gpu::{Device, Shader, Stage};
use crate::render::portable::digit_bits;
use crate::render::shaders::SharedConstants;
use crate::render::shaders::fast::*;

/// Heights of blocks, px. Low blocks balance the work of small and of crowded pictures; with high blocks fewer splats
/// are listed more than once.
pub const BLOCK_HEIGHTS: [u32; 3] = [4, 8, 16];

/// The most workgroup memory of the counts of a sort, bytes.
const SORT_COUNTS_BYTES: u32 = 16 << 10;

pub(super) fn sort_constants(constants: &SharedConstants, subgroup: u32) -> SortConstants {
    let subgroups = Sort::WORKGROUP[0] / subgroup;
    let digit_bits = digit_bits(subgroups, SORT_COUNTS_BYTES);
    SortConstants { digit_bits, subgroups, ..SortConstants::of(constants) }
}

pub(in crate::render) fn blend_constants(
    constants: &SharedConstants,
    subgroup: u32,
    block_height: u32,
) -> BlendConstants {
    BlendConstants { block_height: block_height.max(subgroup / BLOCK_WIDTH), ..BlendConstants::of(constants) }
}

/// A fingerprint of all stages.
pub(super) fn fingerprint(device: &Device, constants: &SharedConstants, subgroup: u32) -> Result<blake3::Hash> {
    let mut stages = vec![
        Stage::<Project>::fingerprint(device, &ProjectConstants::of(constants), subgroup)?,
        Stage::<List>::fingerprint(device, &ListConstants::of(constants), subgroup)?,
        Stage::<Offsets>::fingerprint(device, &(), subgroup)?,
        Stage::<Sort>::fingerprint(device, &sort_constants(constants, subgroup), subgroup)?,
        Stage::<MergeRuns>::fingerprint(device, &(), subgroup)?,
        Stage::<MergePairs>::fingerprint(device, &(), subgroup)?,
        Stage::<Masks>::fingerprint(device, &MasksConstants::of(constants), subgroup)?,
    ];
    for height in BLOCK_HEIGHTS {
        let constants = &blend_constants(constants, subgroup, height);
        stages.push(Stage::<Blend>::fingerprint(device, constants, subgroup)?);
    }
    let mut hasher = blake3::Hasher::new();
    stages.iter().for_each(|stage| _ = hasher.update(stage.as_bytes()));
    Ok(hasher.finalize())
}
