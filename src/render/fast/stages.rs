//! The constants of the fast path's stages, and the fingerprint under which a device remembers a passed self-test.

use anyhow::Result;

use crate::gpu::{Device, Shader, Stage};
use crate::render::portable::digit_bits;
use crate::render::shaders::SharedConstants;
use crate::render::shaders::fast::*;

/// The form of a picture's blocks.
#[derive(Clone, Copy)]
pub struct BlockForm {
    /// px. Low blocks balance the work of small and of crowded pictures; with high blocks fewer splats are listed more
    /// than once.
    pub height: u32,
    /// True if blend keeps entries in a ring: a subgroup takes less time for a splat, and executes more instructions.
    pub has_ring: bool,
}

impl BlockForm {
    /// True if a block has a pixel for each lane of a subgroup of this size.
    pub fn suits(self, subgroup: u32) -> bool {
        subgroup <= BLOCK_WIDTH * self.height
    }
}

/// The forms of blocks: of small pictures, of crowded ones, of others, of large ones.
pub const BLOCK_FORMS: [BlockForm; 4] = [
    BlockForm { height: 4, has_ring: true },
    BlockForm { height: 4, has_ring: false },
    BlockForm { height: 8, has_ring: false },
    BlockForm { height: 16, has_ring: false },
];

/// The most workgroup memory of the counts of a sort, bytes.
const SORT_COUNTS_BYTES: u32 = 16 << 10;

pub(super) fn sort_constants(constants: &SharedConstants, subgroup: u32) -> SortConstants {
    let subgroups = Sort::WORKGROUP[0] / subgroup;
    let digit_bits = digit_bits(subgroups, SORT_COUNTS_BYTES);
    SortConstants { digit_bits, subgroups, ..SortConstants::of(constants) }
}

pub(super) fn blend_constants(constants: &SharedConstants, form: BlockForm) -> BlendConstants {
    let BlockForm { height: block_height, has_ring } = form;
    BlendConstants { block_height, has_ring, ..BlendConstants::of(constants) }
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
    for form in BLOCK_FORMS.into_iter().filter(|form| form.suits(subgroup)) {
        let constants = &blend_constants(constants, form);
        stages.push(Stage::<Blend>::fingerprint(device, constants, subgroup)?);
    }
    let mut hasher = blake3::Hasher::new();
    stages.iter().for_each(|stage| _ = hasher.update(stage.as_bytes()));
    Ok(hasher.finalize())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The self-test draws every form that suits, so a wrong one would cost the device its fast path.
    #[test]
    fn each_lane_of_a_subgroup_has_a_pixel() {
        let suiting = |subgroup| BLOCK_FORMS.map(|form| form.suits(subgroup));
        assert_eq!([8, 16, 32].map(suiting), [[true; 4]; 3]);
        assert_eq!(suiting(64), [false, false, true, true]);
    }
}
