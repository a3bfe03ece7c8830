#version 460
#include "shared/workgroup.glsl"
#include "shared/ballot.glsl"
#include "rays/frame.glsl"
#include "shared/depth.glsl"
#include "shared/harmonics.glsl"
#include "shared/grids.glsl"
#include "shared/rotation.glsl"
#include "portable/blend_splat.glsl"
// One invocation per visible Gaussian: computes its splat and its depth key, and counts the tiles that it may touch.
// Before: gaussian_from_splat from cull_compact; the instance demand is 0. After: all [visible_kept] outputs are set. A
// splat without a tile has the largest depth key.

layout(binding = 0, scalar) readonly buffer Ids { uint gaussian_from_splat[]; };            // [visible_capacity]
layout(binding = 1, scalar) readonly buffer Bounds { uvec4 bounds[]; };                     // [gaussians] mean, reach
layout(binding = 2, scalar) readonly buffer GridsBlock { Grids grids; };
layout(binding = 3, scalar) readonly buffer Shapes { uvec4 plane[]; } shapes[2];            // [gaussians] at most each
layout(binding = 4, scalar) readonly buffer Sh { uvec4 plane[]; } sh[SH_PLANES];            // [gaussians] at most each
layout(binding = 5, scalar) writeonly buffer Splats { RaySplat splats[]; };                 // [visible_capacity]
layout(binding = 6, scalar) writeonly buffer DepthKeys { uint depth_keys[]; };              // [visible_capacity]
layout(binding = 7, scalar) writeonly buffer TileCounts { uint tile_counts[]; };            // [visible_capacity]
layout(binding = 8, scalar) readonly buffer Cones { Cone cones[]; };                        // [cones]
layout(binding = 9, scalar) readonly buffer Footprints { vec3 footprints[]; };              // [(FOOTPRINTS + 1)^2]
layout(binding = 10, scalar) buffer TotalsBlock { Totals totals; };
layout(push_constant, scalar) uniform Push {
    View view;
    uint is_parallel;
    uint cones;
    uint depth_limit;  // the largest depth key, for splats without tiles
    uint depth_shift;  // lowest bits that depth keys leave out
    float half_sine;   // of the last row of footprints
    float large;       // the chord beyond which a subgroup shares a splat
} push;

#define IS_PARALLEL (push.is_parallel == 1)
#define HALF_SINE push.half_sine
#include "shared/marks.glsl"
#include "shared/storage.glsl"
#include "rays/view.glsl"
#include "rays/form.glsl"
#include "rays/walk_tiles.glsl"

RaySplat make_splat(uint gaussian, vec3 p) {
    RayForm form = ray_form(gaussian, p);
    RaySplat splat;
    splat.centre = form.centre;
    splat.u = axis_u(form.across, form.factor);
    splat.v = axis_v(form.across, form.factor);
    splat.q = depth_axis(form.across, form.gamma);
    splat.kappa = form.kappa;
    splat.opacity = form.opacity;
    splat.chord = form.chord;
    return splat;
}

void main() {
    uint index = workgroup() * WORKGROUP + lane();
    bool exists = index < totals.visible_kept;
    uint gaussian = exists ? gaussian_from_splat[index] : 0, tiles = 0;
    vec3 mean = exists ? uintBitsToFloat(bounds[gaussian].xyz) : vec3(0.0);
    vec3 p = view_axes(mean);
    RaySplat splat;
    Reach reach;
    bool is_drawn = false;
    if (exists) {
        splat = make_splat(gaussian, p);
        float limit = falloff_limit(splat.opacity);
        reach = reach_of(splat, limit);
        is_drawn = limit >= 0.0;
        if (is_drawn && !is_large(splat)) WALK_TILES(splat, reach, 0, push.cones, COUNT_TILE)
    }
    uvec4 waiting = subgroupBallot(is_drawn && is_large(splat));
    for (uint w = 0; w < BALLOT_WORDS; w++) {
        for (uint word = waiting[w]; word != 0; word &= word - 1) {
            uint owner = 32 * w + findLSB(word);
            uint all = subgroupAdd(count_part(broadcast_splat(splat, owner), broadcast_reach(reach, owner)));
            if (gl_SubgroupInvocationID == owner) tiles = all;
        }
    }
    uint total;
    workgroup_exclusive_add(tiles, total);
    if (lane() == 0) {
        uint before = atomicAdd(totals.listed_low, total);  // a sum of integers: order does not matter
        if (before + total < before) atomicAdd(totals.listed_high, 1);
    }
    if (!exists) return;
    tile_counts[index] = tiles;
    uint key = floatBitsToUint(far_of(mean)) - floatBitsToUint(VIEW.near);  // positive floats order like their bits
    depth_keys[index] = tiles == 0 ? push.depth_limit : min(key >> push.depth_shift, push.depth_limit - 1);
    if (tiles > 0) {
        uvec4 stored[SH_VECTORS];
        fetch_sh(gaussian, stored);
        splat.colour = marked_colour(bounds[gaussian].w, stored_colour(stored, to_world(direction(p))));
        splats[index] = splat;
    }
}
