//! The radix sort of the portable path against its twin on the CPU.

use std::ops::Range;

use smalto::gpu::{Access, DispatchSize};
use smalto::reference;
use smalto::render::*;

use crate::SIZES;
use crate::common::{Gpu, Random};

/// The keys and their values after a sort on the GPU; without values, those are the indices of the keys.
fn sorted(gpu: &Gpu, sort: &RadixSort, keys: &[u32], values: Option<&[u32]>, bits: u32) -> (Vec<u32>, Vec<u32>) {
    let pairs = Pairs::new(&gpu.0, "test", keys.len()).unwrap();
    let scratch = SortScratch::new(&gpu.0, keys.len()).unwrap();
    let lengths = gpu.upload("lengths", &[u32::MAX, keys.len() as u32]);
    let groups = DispatchSize::Groups(keys.len().div_ceil(2048) as u64).groups(1);
    let groups = gpu.upload("groups", &[[0; 3], [groups[0], groups[1], 1]]);
    let mut result = 0;
    gpu.run(|cmd| {
        cmd.upload(&pairs.keys[0], 0, keys.len(), |m| m.copy_from_slice(keys)).unwrap();
        if let Some(values) = values {
            cmd.upload(&pairs.values[0], 0, values.len(), |m| m.copy_from_slice(values)).unwrap();
        }
        cmd.barrier(Access::COPY_WRITE, Access::SHADER | Access::INDIRECT);
        let range = SortRange { lengths: &lengths, length_index: 1, bits, values_are_indices: values.is_none() };
        result = sort.record(cmd, &pairs, &scratch, range, (&groups, 12));
    });
    (gpu.download(&pairs.keys[result]), gpu.download(&pairs.values[result]))
}

fn random_keys(count: usize, bits: Range<u32>, seed: u64) -> Vec<u32> {
    let mut random = Random(seed);
    (0..count)
        .map(|_| ((random.bits() as u32) & ((1_u64 << bits.end) - 1) as u32) >> bits.start << bits.start)
        .collect()
}

#[test]
fn sort_is_a_stable_sort_at_every_size() {
    let gpu = Gpu::new();
    for subgroup in [4, gpu.0.capabilities().subgroup_size[0]] {
        let sort = RadixSort::new(&gpu.0, subgroup, 4).unwrap();
        for size in SIZES {
            let keys = random_keys(size, 0..13, size as u64);
            let values = random_keys(size, 0..32, 99);
            let expected = reference::sort(&keys, &values, 0..13);
            assert!(sorted(&gpu, &sort, &keys, Some(&values), 13) == expected, "{size} keys, subgroup {subgroup}");
        }
    }
}

#[test]
fn sort_orders_by_any_number_of_bits() {
    let gpu = Gpu::new();
    let sort = RadixSort::new(&gpu.0, gpu.0.capabilities().subgroup_size[0], 4).unwrap();
    let values: Vec<u32> = (0..5000).collect();
    for bits in [0, 1, 2, 6, 7, 8, 9, 14, 16, 17, 24, 27, 31, 32] {
        // Bits above are noise that must not matter.
        let keys = random_keys(5000, 0..32, u64::from(bits));
        let expected = reference::sort(&keys, &values, 0..bits);
        assert!(sorted(&gpu, &sort, &keys, Some(&values), bits) == expected, "{bits} bits");
        if bits > 0 {
            assert!(sorted(&gpu, &sort, &keys, None, bits) == expected, "{bits} bits, values are indices");
        }
    }
}

#[test]
fn sort_keeps_the_order_of_equal_keys() {
    let gpu = Gpu::new();
    let sort = RadixSort::new(&gpu.0, gpu.0.capabilities().subgroup_size[0], 4).unwrap();
    let count = 10_000;
    let values: Vec<u32> = (0..count).collect();
    for (name, keys) in [
        ("equal", vec![0xffff_ffff; count as usize]),
        ("zero", vec![0; count as usize]),
        ("two", (0..count).map(|i| i % 2).collect()),
        ("ascending", values.clone()),
        ("descending", (0..count).rev().collect()),
        ("one late", (0..count).map(|i| u32::from(i == 4999)).collect()),
    ] {
        assert!(sorted(&gpu, &sort, &keys, Some(&values), 32) == reference::sort(&keys, &values, 0..32), "{name}");
    }
}
