#version 460
#include "shared/workgroup.glsl"
#include "portable/frame.glsl"
// One invocation per instance: writes its index to the range of its tile if the tile's list begins or ends here.
// Before: tile_keys are sorted, `ranges` is 0. After: ranges[t] = (first, one past the last) instance of tile t; an
// empty tile keeps (0, 0).

layout(binding = 0, scalar) readonly buffer TotalsBlock { Totals totals; };
layout(binding = 1, scalar) readonly buffer TileKeys { uint tile_keys[]; };                 // [instance_capacity]
layout(binding = 2, scalar) writeonly buffer Ranges { uvec2 ranges[]; };                    // [tiles]

void main() {
    uint i = workgroup() * WORKGROUP + lane();
    uint count = totals.listed_kept;
    if (i >= count) return;
    uint tile = tile_keys[i];
    if (i == 0 || tile_keys[i - 1] != tile) ranges[tile].x = i;
    if (i == count - 1 || tile_keys[i + 1] != tile) ranges[tile].y = i + 1;
}
