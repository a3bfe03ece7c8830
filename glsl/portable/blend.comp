#version 460
#include "shared/workgroup.glsl"
#include "shared/ballot.glsl"
#include "portable/frame.glsl"
#include "portable/blend_splat.glsl"
// One workgroup per 16x16 tile, one invocation per pixel: blends the tile's list front to back.
// Batches of 256 splats are staged in workgroup memory. Each subgroup holds a small block of pixels, finds the staged
// splats that reach it by ballot, blends only those, and ends when all its pixels have stopped. The workgroup ends with
// its last subgroup.
// Before: ranges and sorted splat_ids. After: image = (colour over the background, 1 - T).
// A list longer than `pass_limit` takes several passes; between them the image holds (colour, T), with T negated for
// pixels that have stopped.

layout(constant_id = 0) const bool CULL_PIXEL_BLOCKS = true;
layout(constant_id = 1) const bool RESUME = false;  // not the first pass
layout(constant_id = 2) const bool COUNT = false;   // count the work into `totals`

layout(binding = 0, scalar) readonly buffer Ranges { uvec2 ranges[]; };                     // [tiles]
layout(binding = 1, scalar) readonly buffer SplatIds { uint splat_ids[]; };                 // [instance_capacity]
layout(binding = 2, scalar) readonly buffer Splats { Splat splats[]; };                     // [visible_capacity]
layout(binding = 3, scalar) buffer TotalsBlock { Totals totals; };
layout(binding = 4, scalar) readonly buffer TilesByClass { uint tiles_by_class[]; };        // [TILE_CLASSES * tiles]
layout(binding = 5, rgba32f) uniform image2D image;
layout(push_constant, scalar) uniform Push {
    uvec2 size_px;     // of the image
    uint top_px;       // row of the picture that is the first of the image
    uint tiles;
    vec3 background;
    uint pass_begin;   // instances of each list that earlier passes blended
    uint pass_limit;   // instances of a list that this pass may blend
    uint last_pass;    // 1: finish the pixels
} push;

#include "portable/staged.glsl"

void stage(Splat splat) {
    put(splat);
}

// The pixel centres of a subgroup lie in a box (px).
struct Block {
    vec2 low;
    vec2 high;
};

Block block_of(PLACE centre, bool inside) {
    return Block(subgroupBroadcast(centre, 0), subgroupBroadcast(centre, gl_SubgroupSize - 1));
}

// True if staged splat `i` may reach a pixel centre in the box. The test is exact, apart from a slack for rounding: the
// least falloff in the box lies at the mean or on one of the two sides that face it.
bool reaches(uint i, Block block) {
    vec3 factor = staged_weight[i].xyz;
    vec2 from = block.low - staged_mean[i], to = block.high - staged_mean[i];
    vec2 near = clamp(vec2(0.0), from, to);
    float best_y = -factor.x * factor.y / (factor.y * factor.y + factor.z * factor.z) * near.x;
    float best_x = -factor.y / factor.x * near.y;
    vec2 on_x = vec2(near.x, clamp(best_y, from.y, to.y));
    vec2 on_y = vec2(clamp(best_x, from.x, to.x), near.y);
    float least = min(falloff(factor, on_x), falloff(factor, on_y));
    // u is a difference of products. Its rounding shifts sqrt(falloff) by at most the second term.
    vec2 far = max(abs(from), abs(to));
    float limit =
        sqrt(staged_look[i].w + 1e-4) + 1e-6 * (factor.x * far.x + (abs(factor.y) + factor.z) * far.y);
    return !(least > limit * limit);
}

#include "portable/blend_tile.glsl"
