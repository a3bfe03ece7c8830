#version 460
#include "shared/workgroup.glsl"
#include "portable/frame.glsl"
// One workgroup per chunk of 1024 instances: writes the tile and the splat of each.
// An invocation handles one instance, not one splat, so a splat on a thousand tiles delays no other, and all stores
// coalesce.
// Before: instance_offsets and first_ranks from scan, spans from project. After: tile_keys and splat_ids
// [0 .. listed_kept] are in depth order.

layout(binding = 0, scalar) readonly buffer TotalsBlock { Totals totals; };
layout(binding = 1, scalar) readonly buffer Order { uint splat_from_rank[]; };              // [visible_capacity]
layout(binding = 2, scalar) readonly buffer InstanceOffsets { uint instance_offsets[]; };   // [visible_capacity]
layout(binding = 3, scalar) readonly buffer FirstRanks { uint first_ranks[]; };             // [instance chunks]
layout(binding = 4, scalar) readonly buffer SpanRanges { uvec2 span_ranges[]; };            // [visible_capacity]
layout(binding = 5, scalar) readonly buffer Spans { uint spans[]; };                        // [span_capacity]
layout(binding = 6, scalar) writeonly buffer TileKeys { uint tile_keys[]; };                // [instance_capacity]
layout(binding = 7, scalar) writeonly buffer SplatIds { uint splat_ids[]; };                // [instance_capacity]
layout(push_constant, scalar) uniform Push {
    uint tiles_x;
} push;

// Every listed splat has at least one instance, so a chunk holds instances of at most this many splats.
shared uint offsets[DUPLICATE_CHUNK];

// The last staged splat whose first instance is at or before `instance`.
uint find(uint instance) {
    uint low = 0;
    for (uint step = DUPLICATE_CHUNK / 2; step > 0; step /= 2) {
        if (offsets[low + step] <= instance) low += step;
    }
    return low;
}

// The tile of the `index`-th instance of a splat.
uint tile_of(uint splat, uint index) {
    uvec2 range = span_ranges[splat];
    uint rows = range.y >> 16;
    for (uint row = 0; row < rows; row++) {
        uint span = spans[range.x + row];
        uint first = span & 0xffff, width = (span >> 16) - first;
        if (index < width) return ((range.y & 0xffff) + row) * push.tiles_x + first + index;
        index -= width;
    }
    return 0;  // unreachable: tile_counts is the sum of these widths
}

void main() {
    uint chunk = workgroup();
    uint begin = chunk * DUPLICATE_CHUNK;
    if (begin >= totals.listed_kept) return;
    uint first_rank = first_ranks[chunk];
    for (uint i = lane(); i < DUPLICATE_CHUNK; i += WORKGROUP) {
        uint rank = first_rank + i;
        offsets[i] = rank < totals.visible_kept ? instance_offsets[rank] : 0xffffffff;
    }
    barrier();
    for (uint i = lane(); i < DUPLICATE_CHUNK; i += WORKGROUP) {
        uint instance = begin + i;
        if (instance < totals.listed_kept) {
            uint place = find(instance);
            uint splat = splat_from_rank[first_rank + place];
            tile_keys[instance] = tile_of(splat, instance - offsets[place]);
            splat_ids[instance] = splat;
        }
    }
}
