#version 460
#include "shared/workgroup.glsl"
#include "shared/ballot.glsl"
#include "rays/frame.glsl"
#include "portable/blend_splat.glsl"
// One workgroup per 16x16 tile, one invocation per pixel: blends the tile's list front to back along the rays of its
// pixels, as portable/blend.comp.
// Before: ranges and sorted splat_ids. After: image = (colour over the background, 1 - T); 0 where a pixel has no ray.

layout(constant_id = 0) const bool CULL_PIXEL_BLOCKS = true;
layout(constant_id = 1) const bool RESUME = false;  // not the first pass
layout(constant_id = 2) const bool COUNT = false;   // count the work into `totals`

layout(binding = 0, scalar) readonly buffer Ranges { uvec2 ranges[]; };                     // [tiles]
layout(binding = 1, scalar) readonly buffer SplatIds { uint splat_ids[]; };                 // [instance_capacity]
layout(binding = 2, scalar) readonly buffer Splats { RaySplat splats[]; };                  // [visible_capacity]
layout(binding = 3, scalar) buffer TotalsBlock { Totals totals; };
layout(binding = 4, scalar) readonly buffer TilesByClass { uint tiles_by_class[]; };        // [TILE_CLASSES * tiles]
layout(binding = 5, rgba32f) uniform image2D image;
layout(binding = 6, scalar) readonly buffer Rays { vec3 rays[]; };                          // [pixels] 0 if none
layout(push_constant, scalar) uniform Push {
    uvec2 size_px;
    uint tiles;
    vec3 background;
    uint pass_begin;   // instances of each list that earlier passes blended
    uint pass_limit;   // instances of a list that this pass may blend
    uint last_pass;    // 1: finish the pixels
} push;

#include "rays/staged.glsl"

shared Reach staged_reach[WORKGROUP];

void stage(RaySplat splat) {
    put(splat);
    staged_reach[lane()] = reach_of(splat, falloff_limit(splat.opacity));
}

// The rays of a subgroup end within `spread` of `middle`.
struct Block {
    vec3 middle;
    float spread;
};

Block block_of(PLACE ray, bool inside) {
    bool has_ray = sees(ray);
    vec3 low = subgroupMin(has_ray ? ray : vec3(EVERYWHERE)), high = subgroupMax(has_ray ? ray : vec3(-EVERYWHERE));
    vec3 middle = 0.5 * (low + high);
    float spread = subgroupMax(has_ray ? distance(ray, middle) : 0.0);
    // Rounding of the middle and of the distance.
    return Block(middle, 1.00001 * spread + 1e-6 * length(middle));
}

bool reaches(uint i, Block block) {
    return meets(staged[i], staged_reach[i], block.middle, block.spread);
}

#include "portable/blend_tile.glsl"
