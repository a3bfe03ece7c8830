#version 460
#include "shared/workgroup.glsl"
#include "portable/frame.glsl"
// One workgroup per chunk of 2048 splats in depth order: adds up their tile counts.
// Before: splat_from_rank is the depth order. After: sums[chunk] is set.

layout(binding = 0, scalar) readonly buffer TotalsBlock { Totals totals; };
layout(binding = 1, scalar) readonly buffer Order { uint splat_from_rank[]; };              // [visible_capacity]
layout(binding = 2, scalar) readonly buffer TileCounts { uint tile_counts[]; };             // [visible_capacity]
layout(binding = 3, scalar) writeonly buffer Sums { uint sums[]; };                         // [chunks]

void main() {
    uint chunk = workgroup();
    if (chunk * SCAN_CHUNK >= totals.visible_kept) return;
    uint sum = 0;
    for (uint i = lane(); i < SCAN_CHUNK; i += WORKGROUP) {
        uint rank = chunk * SCAN_CHUNK + i;
        if (rank < totals.visible_kept) sum += tile_counts[splat_from_rank[rank]];
    }
    uint total;
    workgroup_exclusive_add(sum, total);
    if (lane() == 0) sums[chunk] = total;
}
