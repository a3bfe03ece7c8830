#version 460
#include "shared/workgroup.glsl"
#include "rays/frame.glsl"
#include "portable/blend_splat.glsl"
// One invocation per splat, in the order of depths: writes its tiles, as project counted them.
// Before: instance_offsets from scan. After: tile_keys and splat_ids [0 .. listed_kept] are in depth order.

layout(binding = 0, scalar) readonly buffer TotalsBlock { Totals totals; };
layout(binding = 1, scalar) readonly buffer Order { uint splat_from_rank[]; };              // [visible_capacity]
layout(binding = 2, scalar) readonly buffer InstanceOffsets { uint instance_offsets[]; };   // [visible_capacity]
layout(binding = 3, scalar) readonly buffer TileCounts { uint tile_counts[]; };             // [visible_capacity]
layout(binding = 4, scalar) readonly buffer Splats { RaySplat splats[]; };                  // [visible_capacity]
layout(binding = 5, scalar) readonly buffer Cones { Cone cones[]; };                        // [cones]
layout(binding = 6, scalar) writeonly buffer TileKeys { uint tile_keys[]; };                // [instance_capacity]
layout(binding = 7, scalar) writeonly buffer SplatIds { uint splat_ids[]; };                // [instance_capacity]
layout(push_constant, scalar) uniform Push {
    uint cones;
} push;

#include "rays/walk_tiles.glsl"

void main() {
    uint rank = workgroup() * WORKGROUP + lane();
    if (rank >= totals.visible_kept || totals.listed_kept == 0) return;
    uint id = splat_from_rank[rank], next = instance_offsets[rank], end = next + tile_counts[id];
    if (next == end) return;
    RaySplat splat = splats[id];
    Reach reach = reach_of(splat, falloff_limit(splat.opacity));
#define WRITE(tile) \
    if (next < end) { \
        tile_keys[next] = tile; \
        splat_ids[next++] = id; \
    }
    WALK_TILES(splat, reach, WRITE)
}
