// Walks the tiles that splats may touch: a lane alone for a small splat, the lanes of a subgroup together for a large
// one, each in a part of the tree.
// Requires: ballot.glsl, rays/frame.glsl, cones[], push.cones, push.large

// Calls VISIT(tile) for each tile of the cones from `begin` up to `end`. Cones above them are not asked: they would be
// met.
#define WALK_TILES(splat, reach, begin, end, VISIT) \
    for (uint cone = begin; cone < (end);) { \
        Cone c = cones[cone]; \
        vec4 sphere = uintBitsToFloat(c.sphere); \
        bool is_met = meets(splat, reach, sphere.xyz, sphere.w); \
        if (is_met && c.tile != NO_TILE) { VISIT(c.tile) } \
        cone = is_met ? cone + 1 : c.next; \
    }

bool is_large(RaySplat splat) {
    return splat.chord > push.large;
}

// What `meets` reads of the splat of another lane.
RaySplat broadcast_splat(RaySplat splat, uint from) {
    splat.centre = subgroupBroadcast(splat.centre, from);
    splat.u = subgroupBroadcast(splat.u, from);
    splat.v = subgroupBroadcast(splat.v, from);
    splat.q = subgroupBroadcast(splat.q, from);
    splat.chord = subgroupBroadcast(splat.chord, from);
    return splat;
}

Reach broadcast_reach(Reach reach, uint from) {
    reach.slope = subgroupBroadcast(reach.slope, from);
    reach.across = subgroupBroadcast(reach.across, from);
    reach.along = subgroupBroadcast(reach.along, from);
    return reach;
}

// The cones that this lane walks of a large splat: from, up to.
uvec2 part_of_lane() {
    uint each = div_up(push.cones, gl_SubgroupSize), begin = min(gl_SubgroupInvocationID * each, push.cones);
    return uvec2(begin, min(begin + each, push.cones));
}

#define COUNT_TILE(tile) tiles++;

// The number of tiles of a large splat that this lane finds.
uint count_part(RaySplat splat, Reach reach) {
    uint tiles = 0;
    uvec2 part = part_of_lane();
    WALK_TILES(splat, reach, part.x, part.y, COUNT_TILE)
    return tiles;
}
