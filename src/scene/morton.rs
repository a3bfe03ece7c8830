//! Sorts Gaussians along a Z-order (Morton) curve, so that neighbours in space are neighbours in a file.

use rayon::prelude::*;

/// Bits of the curve along each axis.
const BITS: u32 = 21;

/// A Z-order curve through a box. Two means in one cell of the curve have one key; means outside of the box have the
/// keys of its sides.
#[derive(Clone, Copy, Debug)]
pub struct Curve {
    low: [f32; 3],
    high: [f32; 3],
}

impl Curve {
    /// The curve through the box with these corners.
    pub fn through(low: [f32; 3], high: [f32; 3]) -> Self {
        Self { low, high }
    }

    /// The place of a mean on the curve: a number of 63 bits.
    pub fn key(&self, mean: [f32; 3]) -> u64 {
        (0..3).fold(0, |code, axis| {
            let [low, high, value] = [self.low[axis], self.high[axis], mean[axis]].map(f64::from);
            let fraction = if high > low { ((value - low) / (high - low)).clamp(0.0, 1.0) } else { 0.0 };
            code | spread((fraction * f64::from((1 << BITS) - 1)) as u64) << axis
        })
    }

    /// The indices of `means` along the curve. Those in one cell are ascending.
    pub fn order(&self, means: &[[f32; 3]]) -> Vec<u32> {
        self.sorted(means, &(0..means.len() as u32).collect::<Vec<_>>())
    }

    fn sorted(&self, means: &[[f32; 3]], indices: &[u32]) -> Vec<u32> {
        let keyed = |index: &u32| (self.key(means[*index as usize]), *index);
        let mut keyed: Vec<(u64, u32)> = indices.par_iter().map(keyed).collect();
        keyed.par_sort_unstable();
        keyed.into_iter().map(|(_, index)| index).collect()
    }
}

/// The indices of `means` along the curve through their bounding box. Those in one cell are ascending.
pub fn along_curve(means: &[[f32; 3]]) -> Vec<u32> {
    let mut indices = (0..means.len() as u32).collect();
    sort(means, &mut indices);
    indices
}

/// Sorts indices of `means` along the curve through the bounding box of the indexed means. Indices in one cell of the
/// curve are ascending.
pub(crate) fn sort(means: &[[f32; 3]], indices: &mut Vec<u32>) {
    let [low, high] = indices.iter().map(|i| means[*i as usize]).fold(
        [[f32::INFINITY; 3], [f32::NEG_INFINITY; 3]],
        |[low, high], mean| {
            [std::array::from_fn(|k| low[k].min(mean[k])), std::array::from_fn(|k| high[k].max(mean[k]))]
        },
    );
    *indices = Curve::through(low, high).sorted(means, indices);
}

/// Spreads the [`BITS`] low bits of a number three places apart.
fn spread(mut value: u64) -> u64 {
    for (shift, mask) in [
        (32, 0x1f_0000_0000_ffff),
        (16, 0x1f_0000_ff00_00ff),
        (8, 0x100f_00f0_0f00_f00f),
        (4, 0x10c3_0c30_c30c_30c3),
        (2, 0x1249_2492_4924_9249),
    ] {
        value = (value | value << shift) & mask;
    }
    value
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bits_are_spread_three_apart() {
        for value in [0, 1, 0b1011, (1 << BITS) - 1, 0x15_5555] {
            let expected = (0..BITS).fold(0, |code, bit| code | (value >> bit & 1) << (3 * bit));
            assert_eq!(spread(value), expected, "{value:x}");
        }
    }

    #[test]
    fn corners_of_a_cube_are_in_the_order_of_the_curve() {
        let means: Vec<[f32; 3]> =
            (0..8).rev().map(|i| [0, 1, 2].map(|axis| if i >> axis & 1 == 1 { 5.0 } else { -1e3 })).collect();
        let mut indices: Vec<u32> = (0..8).collect();
        sort(&means, &mut indices);
        assert_eq!(indices, [7, 6, 5, 4, 3, 2, 1, 0]);
    }
}
