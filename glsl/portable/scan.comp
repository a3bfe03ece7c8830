#version 460
#include "shared/workgroup.glsl"
#include "portable/frame.glsl"
// One workgroup per chunk of 2048 splats in depth order: finds the first instance of each splat.
// Before: exclusive `sums` from scan_totals. After: instance_offsets[rank] is set; first_ranks has, for every chunk of
// 1024 instances, the rank of the splat that its first instance belongs to.

layout(binding = 0, scalar) readonly buffer TotalsBlock { Totals totals; };
layout(binding = 1, scalar) readonly buffer Order { uint splat_from_rank[]; };              // [visible_capacity]
layout(binding = 2, scalar) readonly buffer TileCounts { uint tile_counts[]; };             // [visible_capacity]
layout(binding = 3, scalar) readonly buffer Sums { uint sums[]; };                          // [chunks]
layout(binding = 4, scalar) writeonly buffer InstanceOffsets { uint instance_offsets[]; };  // [visible_capacity]
layout(binding = 5, scalar) writeonly buffer FirstRanks { uint first_ranks[]; };            // [instance chunks]

const uint ITEMS = SCAN_CHUNK / WORKGROUP;

void main() {
    uint chunk = workgroup();
    if (chunk * SCAN_CHUNK >= totals.visible_kept) return;
    uint first = chunk * SCAN_CHUNK + lane() * ITEMS;
    uint counts[ITEMS];
    uint sum = 0;
    for (uint k = 0; k < ITEMS; k++) {
        counts[k] = first + k < totals.visible_kept ? tile_counts[splat_from_rank[first + k]] : 0;
        sum += counts[k];
    }
    uint total;
    uint offset = sums[chunk] + workgroup_exclusive_add(sum, total);
    for (uint k = 0; k < ITEMS; k++) {
        if (first + k < totals.visible_kept) {
            instance_offsets[first + k] = offset;
            uint end = min(offset + counts[k], totals.listed_kept);
            for (uint p = div_up(offset, DUPLICATE_CHUNK); p * DUPLICATE_CHUNK < end; p++) first_ranks[p] = first + k;
        }
        offset += counts[k];
    }
}
