#version 460
#include "shared/workgroup.glsl"
#include "shared/ballot.glsl"
#include "rays/frame.glsl"
#include "portable/blend_splat.glsl"
// One invocation per splat, in the order of depths: writes its tiles, which project counted.
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
    float large;  // the chord beyond which a subgroup shares a splat
} push;

#include "rays/walk_tiles.glsl"

#define WRITE_TILE(tile) \
    if (next < end) { \
        tile_keys[next] = tile; \
        splat_ids[next++] = id; \
    }

// Writes the tiles of a splat that this lane finds, to the instances from `next` up to `end`.
void write_part(RaySplat splat, Reach reach, uvec2 part, uint id, uint next, uint end) {
    WALK_TILES(splat, reach, part.x, part.y, WRITE_TILE)
}

void main() {
    uint rank = workgroup() * WORKGROUP + lane(), id = 0, first = 0, count = 0;
    RaySplat splat;
    Reach reach;
    // The demand may exceed the capacity; nothing is listed then.
    if (rank < totals.visible_kept && totals.listed_kept > 0) {
        id = splat_from_rank[rank];
        first = instance_offsets[rank];
        count = tile_counts[id];
    }
    if (count > 0) {
        splat = splats[id];
        reach = reach_of(splat, falloff_limit(splat.opacity));
        if (!is_large(splat)) write_part(splat, reach, uvec2(0, push.cones), id, first, first + count);
    }
    uvec4 waiting = subgroupBallot(count > 0 && is_large(splat));
    for (uint w = 0; w < BALLOT_WORDS; w++) {
        for (uint word = waiting[w]; word != 0; word &= word - 1) {
            uint owner = 32 * w + findLSB(word);
            RaySplat theirs = broadcast_splat(splat, owner);
            Reach their_reach = broadcast_reach(reach, owner);
            uint mine = count_part(theirs, their_reach), begin = subgroupBroadcast(first, owner);
            begin += subgroupExclusiveAdd(mine);
            write_part(theirs, their_reach, part_of_lane(), subgroupBroadcast(id, owner), begin, begin + mine);
        }
    }
}
