#version 460
#include "shared/workgroup.glsl"
#include "portable/frame.glsl"
#include "inspect/codes.glsl"
#include "portable/blend_splat.glsl"
// One workgroup per 16x16 tile, one invocation per pixel: walks the tile's list as a blend does, and counts or draws
// the work instead of blending.
// Before: ranges and sorted splat_ids; for WORK_DEPTHS, splats with their depth as colour. After: image = (a count in
// all three channels, 1), (colour, 1 - T), or (mean depth, median depth, count, 1 - T).
// A list longer than `pass_limit` takes several passes; between passes the image holds these values with T instead of
// alpha, negated for pixels that have stopped.

layout(constant_id = 1) const bool RESUME = false;  // not the first pass
layout(constant_id = 2) const uint WORK = 0;

layout(binding = 0, scalar) readonly buffer Ranges { uvec2 ranges[]; };                     // [tiles]
layout(binding = 1, scalar) readonly buffer SplatIds { uint splat_ids[]; };                 // [instance_capacity]
layout(binding = 2, scalar) readonly buffer Splats { Splat splats[]; };                     // [visible_capacity]
layout(binding = 3, scalar) buffer TotalsBlock { Totals totals; };
layout(binding = 4, rgba32f) uniform image2D image;
layout(push_constant, scalar) uniform Push {
    uvec2 size_px;     // of the image
    uint top_px;       // row of the picture that is the first of the image
    uint tiles;
    vec3 background;
    uint pass_begin;   // instances of each list that earlier passes walked
    uint pass_limit;   // instances of a list that this pass may walk
    uint last_pass;    // 1: finish the pixels
} push;

#include "portable/staged.glsl"

const float CENTRE_RADIUS = 1.5;         // px
const float OUTLINE_ALPHA = 0.5;
const float OUTLINES_STOP = 1.0 / 512.0;  // half a step of 8 bits

// True if a splat is drawn at the offset `d` (px) from its mean, but not 1 px farther out.
bool is_border(vec3 factor, float limit, vec2 d) {
    float u = factor.x * d.x + factor.y * d.y, v = factor.z * d.y;
    vec2 outwards = vec2(factor.x * u, factor.y * u + factor.z * v);  // half the gradient of the falloff
    outwards = outwards == vec2(0.0) ? vec2(1.0, 0.0) : normalize(outwards);
    return falloff(factor, d) <= limit && !(falloff(factor, d + outwards) <= limit);
}

bool draws_glyphs() {
    return WORK == WORK_CENTRES || WORK == WORK_OUTLINES;
}

// Draws the glyph of staged splat `i` into a pixel. Returns true if the pixel stops.
bool draw_glyph(uint i, vec2 centre, inout vec3 sum, inout float transmittance) {
    vec2 d = centre - staged_mean[i];
    vec4 look = staged_look[i];
    if (WORK == WORK_CENTRES) {
        if (!(length(d) <= CENTRE_RADIUS)) return false;
        sum = look.rgb;
        return true;
    }
    if (!is_border(staged_weight[i].xyz, look.w, d)) return false;
    sum += OUTLINE_ALPHA * transmittance * look.rgb;
    transmittance *= 1.0 - OUTLINE_ALPHA;
    return transmittance < OUTLINES_STOP;
}

#include "inspect/inspect_tile.glsl"
