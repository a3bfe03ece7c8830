// Walks the tiles that a splat may touch, in one order for all splats.
// Requires: rays/frame.glsl, cones[], push.cones

// Calls VISIT(tile) for each.
#define WALK_TILES(splat, reach, VISIT) \
    for (uint cone = 0; cone < push.cones;) { \
        Cone c = cones[cone]; \
        vec4 sphere = uintBitsToFloat(c.sphere); \
        bool is_met = meets(splat, reach, sphere.xyz, sphere.w); \
        if (is_met && c.tile != NO_TILE) { VISIT(c.tile) } \
        cone = is_met ? cone + 1 : c.next; \
    }
