#version 460
#include "shared/workgroup.glsl"
#include "portable/frame.glsl"
// One invocation per splat: permutes the depth keys into the order of the splats' indices. A stable sort by depth then
// keeps the order of indices for splats of equal depth.
// Before: splat_from_index is sorted. After: depth_keys and splats have the keys and the splats in that order.

layout(binding = 0, scalar) readonly buffer TotalsBlock { Totals totals; };
layout(binding = 1, scalar) readonly buffer Order { uint splat_from_index[]; };             // [visible_capacity]
layout(binding = 2, scalar) readonly buffer Unordered { uint unordered[]; };                // [visible_capacity]
layout(binding = 3, scalar) writeonly buffer DepthKeys { uint depth_keys[]; };              // [visible_capacity]
layout(binding = 4, scalar) writeonly buffer Ordered { uint splats[]; };                    // [visible_capacity]

void main() {
    uint rank = workgroup() * WORKGROUP + lane();
    if (rank >= totals.visible_kept) return;
    uint splat = splat_from_index[rank];
    depth_keys[rank] = unordered[splat];
    splats[rank] = splat;
}
