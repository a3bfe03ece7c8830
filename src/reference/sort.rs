//! A stable sort by some bits of the keys.

use std::ops::Range;

use rayon::prelude::*;

/// Keys and values ordered by the key bits in `bits`; pairs with equal bits keep their order.
pub fn sort(keys: &[u32], values: &[u32], bits: Range<u32>) -> (Vec<u32>, Vec<u32>) {
    let mask = ((1_u64 << bits.end) - (1_u64 << bits.start)) as u32;
    let mut pairs: Vec<(u32, u32)> = keys.iter().copied().zip(values.iter().copied()).collect();
    pairs.par_sort_by_key(|(key, _)| key & mask);
    pairs.into_iter().unzip()
}
