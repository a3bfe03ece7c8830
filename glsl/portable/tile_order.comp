#version 460
#include "shared/workgroup.glsl"
#include "portable/frame.glsl"
// One invocation per tile: sorts the tiles into classes by the length of their lists, so that the blend begins with the
// longest and no long list is left alone at the end.
// Before: ranges; totals.tiles_in_class is 0. After: tiles_by_class[c * tiles ..] holds the tiles_in_class[c] tiles of
// class c, in any order: it decides when a tile is blended, not what it shows.

layout(binding = 0, scalar) readonly buffer Ranges { uvec2 ranges[]; };                     // [tiles]
layout(binding = 1, scalar) writeonly buffer TilesByClass { uint tiles_by_class[]; };       // [TILE_CLASSES * tiles]
layout(binding = 2, scalar) buffer TotalsBlock { Totals totals; };
layout(push_constant, scalar) uniform Push {
    uint tiles;
} push;

// 0 for lists of at least 16 times the mean length, one more for every halving; the last class has all below the mean.
uint class_of(uint length) {
    uint ratio = length / max(totals.listed_kept / push.tiles, 1);
    return TILE_CLASSES - 1 - min(uint(findMSB(ratio) + 1), TILE_CLASSES - 1);
}

void main() {
    uint tile = workgroup() * WORKGROUP + lane();
    bool exists = tile < push.tiles;
    uint mine = TILE_CLASSES;
    if (exists) mine = class_of(ranges[tile].y - ranges[tile].x);
    for (uint c = 0; c < TILE_CLASSES; c++) {
        uvec4 members = subgroupBallot(mine == c);
        uint count = subgroupBallotBitCount(members);
        if (count == 0) continue;
        uint first = 0;
        if (subgroupElect()) first = atomicAdd(totals.tiles_in_class[c], count);  // any order is right: see above
        first = subgroupBroadcastFirst(first);
        if (mine == c) tiles_by_class[c * push.tiles + first + subgroupBallotExclusiveBitCount(members)] = tile;
    }
}
