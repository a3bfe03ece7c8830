#version 460
#include "shared/workgroup.glsl"
#include "portable/frame.glsl"
// One invocation per splat: writes its instances, from the place that scan found or, with SINGLE_PASS, from the place
// that its workgroup allocates.
// Before: span_ranges, spans and tile_counts from project; totals.listed_kept; instance_offsets from scan, or with
// SINGLE_PASS `cursor` is 0. After: tile_keys and splat_ids [0 .. listed_kept] hold every (tile, splat) once.
// With SINGLE_PASS workgroups take their places in any order: the sort after it has to order by depth as well, and
// instances of one tile and depth stay in any order.

layout(constant_id = 0) const bool SINGLE_PASS = false;

layout(binding = 0, scalar) readonly buffer TotalsBlock { Totals totals; };
layout(binding = 1, scalar) readonly buffer Order { uint splat_from_rank[]; };              // [visible_capacity]
layout(binding = 2, scalar) readonly buffer InstanceOffsets { uint instance_offsets[]; };   // [visible_capacity]
layout(binding = 3, scalar) buffer Cursor { uint cursor[]; };                               // [1]
layout(binding = 4, scalar) readonly buffer SpanRanges { uvec2 span_ranges[]; };            // [visible_capacity]
layout(binding = 5, scalar) readonly buffer Spans { uint spans[]; };                        // [span_capacity]
layout(binding = 6, scalar) readonly buffer TileCounts { uint tile_counts[]; };             // [visible_capacity]
layout(binding = 7, scalar) writeonly buffer TileKeys { uint tile_keys[]; };                // [instance_capacity]
layout(binding = 8, scalar) writeonly buffer SplatIds { uint splat_ids[]; };                // [instance_capacity]
layout(push_constant, scalar) uniform Push {
    uint tiles_x;
} push;

shared uint first_instance;

// The first of the `count` instances that this invocation writes. The whole workgroup must call it.
uint allocate(uint count) {
    uint total;
    uint place = workgroup_exclusive_add(count, total);
    if (lane() == 0) first_instance = atomicAdd(cursor[0], total);  // any order is right: see above
    barrier();
    return first_instance + place;
}

void main() {
    uint rank = workgroup() * WORKGROUP + lane();
    bool exists = rank < totals.visible_kept;
    uint splat = exists ? splat_from_rank[rank] : 0;
    uint count = exists ? tile_counts[splat] : 0;
    uint place = 0;
    if (SINGLE_PASS) {
        place = allocate(count);
    } else if (exists) {
        place = instance_offsets[rank];
    }
    if (count == 0) return;
    uvec2 range = span_ranges[splat];
    for (uint row = 0; row < range.y >> 16; row++) {
        uint span = spans[range.x + row];
        for (uint column = span & 0xffff; column < span >> 16; column++) {
            if (place < totals.listed_kept) {
                tile_keys[place] = ((range.y & 0xffff) + row) * push.tiles_x + column;
                splat_ids[place] = splat;
            }
            place++;
        }
    }
}
