#version 460
#include "workgroup.glsl"
#include "frame.glsl"
// One invocation per splat: allocates its instances and writes them, in a single pass without a scan.
// Before: span_ranges, spans and tile_counts from project; totals.instances_kept; `cursor` is 0.
// After: tile_keys and splat_ids [0 .. instances_kept] hold every (tile, splat) once. Workgroups take their places in any
// order: the sort behind it has to order by depth as well, and what lies at one depth and tile stays in any order.

layout(binding = 0, scalar) readonly buffer TotalsBlock { Totals totals; };
layout(binding = 1, scalar) buffer Cursor { uint cursor[]; };                               // [1]
layout(binding = 2, scalar) readonly buffer SpanRanges { uvec2 span_ranges[]; };            // [visible_capacity]
layout(binding = 3, scalar) readonly buffer Spans { uint spans[]; };                        // [span_capacity]
layout(binding = 4, scalar) readonly buffer TileCounts { uint tile_counts[]; };             // [visible_capacity]
layout(binding = 5, scalar) writeonly buffer TileKeys { uint tile_keys[]; };                // [instance_capacity]
layout(binding = 6, scalar) writeonly buffer SplatIds { uint splat_ids[]; };                // [instance_capacity]
layout(push_constant, scalar) uniform Push {
    uint tiles_x;
} push;

shared uint first_instance;

void main() {
    uint splat = workgroup() * WORKGROUP + lane();
    uint count = splat < totals.visible_kept ? tile_counts[splat] : 0;
    uint total;
    uint place = workgroup_exclusive_add(count, total);
    if (lane() == 0) first_instance = atomicAdd(cursor[0], total);  // any order: see above
    barrier();
    place += first_instance;
    if (count == 0) return;
    uvec2 range = span_ranges[splat];
    for (uint row = 0; row < range.y >> 16; row++) {
        uint span = spans[range.x + row];
        for (uint column = span & 0xffff; column < span >> 16; column++) {
            if (place < totals.instances_kept) {
                tile_keys[place] = ((range.y & 0xffff) + row) * push.tiles_x + column;
                splat_ids[place] = splat;
            }
            place++;
        }
    }
}
