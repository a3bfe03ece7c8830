#version 460
#include "shared/workgroup.glsl"
#include "rays/frame.glsl"
#include "inspect/codes.glsl"
#include "portable/blend_splat.glsl"
// One workgroup per 16x16 tile, one invocation per pixel: counts the work of a blend along rays, or draws its depths,
// as inspect.comp.
// Before: ranges and sorted splat_ids; for WORK_DEPTHS, splats with their depth as colour. After: image as of
// inspect.comp; 0 where a pixel has no ray.

layout(constant_id = 1) const bool RESUME = false;  // not the first pass
layout(constant_id = 2) const uint WORK = 0;        // no glyphs

layout(binding = 0, scalar) readonly buffer Ranges { uvec2 ranges[]; };                     // [tiles]
layout(binding = 1, scalar) readonly buffer SplatIds { uint splat_ids[]; };                 // [instance_capacity]
layout(binding = 2, scalar) readonly buffer Splats { RaySplat splats[]; };                  // [visible_capacity]
layout(binding = 3, scalar) buffer TotalsBlock { Totals totals; };
layout(binding = 4, rgba32f) uniform image2D image;
layout(binding = 5, scalar) readonly buffer Rays { vec3 rays[]; };                          // [pixels] 0 if none
layout(push_constant, scalar) uniform Push {
    uvec2 size_px;
    uint tiles;
    vec3 background;
    uint pass_begin;   // instances of each list that earlier passes walked
    uint pass_limit;   // instances of a list that this pass may walk
    uint last_pass;    // 1: finish the pixels
} push;

#include "rays/staged.glsl"

bool draws_glyphs() {
    return false;
}

bool draw_glyph(uint i, PLACE ray, inout vec3 sum, inout float transmittance) {
    return false;  // unreachable
}

#include "inspect/inspect_tile.glsl"
