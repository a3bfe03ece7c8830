//! Single stages of the portable path against their twins on the CPU, over the sizes where indices go wrong.

use smalto::gpu::{DispatchSize, Stage};
use smalto::reference;
use smalto::render::shaders::PortableDispatches;
use smalto::render::shaders::portable::*;
use smalto::render::*;

use crate::SIZES;
use crate::common::{Gpu, Random, again_in_subgroups_of_four};

#[test]
fn ranges_mark_where_tiles_begin_and_end() {
    let gpu = Gpu::new();
    let stage = Stage::<Ranges>::new(&gpu.0, &()).unwrap();
    // One more than 65,535 workgroups, so that the dispatch is folded.
    for size in SIZES.into_iter().chain([65_536 * 256 + 1]) {
        let tiles = 1 + size / 100;
        let mut random = Random(size as u64);
        let mut keys: Vec<u32> = (0..size).map(|_| random.below(tiles as u32)).collect();
        keys.sort_unstable();
        let totals = gpu.upload("totals", &[Totals { listed_kept: size as u32, ..bytemuck::Zeroable::zeroed() }]);
        let tile_keys = gpu.upload("tile keys", &keys);
        let ranges = gpu.upload("ranges", &vec![[0, 0]; tiles]);
        gpu.run(|cmd| {
            let bindings = RangesBindings { totals: &totals, tile_keys: &tile_keys, ranges: &ranges };
            cmd.dispatch(&stage, bindings, (), DispatchSize::Invocations(size as u64));
        });
        assert!(gpu.download(&ranges) == reference::ranges(&keys, tiles), "{size} instances");
    }
}

#[test]
fn cull_offsets_are_an_exclusive_sum() {
    let gpu = Gpu::new();
    let stage = Stage::<CullOffsets>::new(&gpu.0, &()).unwrap();
    for size in SIZES {
        let mut random = Random(size as u64);
        let counts: Vec<u32> = (0..size).map(|_| random.below(1025)).collect();
        let expected = reference::scan(&counts);
        let sums = gpu.upload("sums", &counts);
        let totals = gpu.upload("totals", &[<Totals as bytemuck::Zeroable>::zeroed()]);
        let dispatches = gpu.upload("dispatches", &[<PortableDispatches as bytemuck::Zeroable>::zeroed()]);
        let visible_capacity = 1_000_000;
        gpu.run(|cmd| {
            let bindings = CullOffsetsBindings { sums: &sums, totals: &totals, dispatches: &dispatches };
            cmd.dispatch(
                &stage,
                bindings,
                CullOffsetsPush { chunks: size as u32, visible_capacity },
                DispatchSize::Groups(1),
            );
        });
        let sums: Vec<u64> = gpu.download(&sums).into_iter().map(u64::from).collect();
        let (total, totals) = (expected[size], gpu.download(&totals)[0]);
        assert!(sums == expected[..size], "{size} counts");
        assert_eq!(u64::from(totals.visible), total);
        let kept = total.min(visible_capacity.into());
        assert_eq!(u64::from(totals.visible_kept), kept);
        let groups = gpu.download(&dispatches)[0];
        let covered = |[x, y, _]: [u32; 3], chunk: u64| u64::from(x) * u64::from(y) * chunk;
        for (groups, chunk) in [(groups.over_visible, 256), (groups.sort_visible, 2048), (groups.scan_visible, 2048)] {
            assert!(covered(groups, chunk) >= kept && groups[0] <= 65_535, "{groups:?} cover {kept}");
        }
    }
}

#[test]
fn cull_compact_lists_the_set_bits_in_order() {
    let gpu = Gpu::new();
    let stage = Stage::<CullCompact>::new(&gpu.0, &()).unwrap();
    // The last is one more than 65,535 workgroups.
    for (chunks, capacity) in [(1, 1000), (2, 2048), (3, 10), (65_536, 1 << 20)] {
        let mut random = Random(chunks as u64);
        let masks: Vec<u32> =
            (0..chunks * 32).map(|_| (random.bits() & random.bits() & random.bits()) as u32).collect();
        let counts: Vec<u32> = masks.chunks(32).map(|m| m.iter().map(|w| w.count_ones()).sum()).collect();
        let offsets: Vec<u32> = reference::scan(&counts)[..chunks].iter().map(|o| *o as u32).collect();
        let bit = |i: &u32| masks[*i as usize / 32] >> (i % 32) & 1 == 1;
        let expected: Vec<u32> = (0..chunks as u32 * 1024).filter(bit).take(capacity).collect();
        let ids = gpu.upload("ids", &vec![u32::MAX; capacity]);
        let (visible_masks, chunk_offsets) = (gpu.upload("masks", &masks), gpu.upload("offsets", &offsets));
        gpu.run(|cmd| {
            let bindings = CullCompactBindings {
                visible_masks: &visible_masks,
                chunk_offsets: &chunk_offsets,
                gaussian_from_splat: &ids,
            };
            let push = CullCompactPush { chunks: chunks as u32, visible_capacity: capacity as u32 };
            cmd.dispatch(&stage, bindings, push, DispatchSize::Groups(chunks as u64));
        });
        assert!(gpu.download(&ids)[..expected.len()] == expected, "{chunks} chunks");
    }
}

/// Also the sort and the stages in whole frames.
#[test]
fn every_stage_agrees_in_subgroups_of_four() {
    again_in_subgroups_of_four(&["radix_sort::", "portable::", "portable_frame::", "--skip", "subgroups_of_four"]);
}
