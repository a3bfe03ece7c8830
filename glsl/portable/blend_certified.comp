#version 460
#include "shared/workgroup.glsl"
#include "portable/frame.glsl"
#include "portable/blend_splat.glsl"
// One workgroup per 16x16 tile, one invocation per pixel: blends the tile's list front to back as blend.comp does, bit
// for bit, with a bound on the error of every pixel.
// Before: ranges and sorted splat_ids, of splats that are listed wherever their alpha reaches the listing threshold.
// After: image = (colour over the background, 1 - T), certificate = the bound on every channel. Between the passes of a
// long list, image holds what it holds in blend.comp, and certificate (sum, brightest colour, number of terms so far).

layout(constant_id = 1) const bool RESUME = false;  // not the first pass

layout(binding = 0, scalar) readonly buffer Ranges { uvec2 ranges[]; };                     // [tiles]
layout(binding = 1, scalar) readonly buffer SplatIds { uint splat_ids[]; };                 // [instance_capacity]
layout(binding = 2, scalar) readonly buffer Splats { Splat splats[]; };                     // [visible_capacity]
layout(binding = 3, scalar) buffer TotalsBlock { Totals totals; };
layout(binding = 4, rgba32f) uniform image2D image;
layout(binding = 5, rgba32f) uniform image2D certificate;
layout(push_constant, scalar) uniform Push {
    uvec2 size_px;            // of the image
    uint top_px;              // row of the picture that is the first of the image
    uint tiles;
    vec3 background;
    uint pass_begin;          // instances of each list that earlier passes blended
    uint pass_limit;          // instances of a list that this pass may blend
    uint last_pass;           // 1: finish the pixels
    float unlisted;           // upper bound on the sum of all contributions below the listing threshold
    float position_error_px;  // rounding error of a mean near the middle of the image
} push;

#include "portable/staged.glsl"

const float ULP = 1.1920929e-7;  // of 1.0

// Upper bound on the error of an alpha by f32 rounding: factors and means are off by a few units in the last place.
float rounding(uint i, PLACE centre, float fall, float alpha) {
    vec3 factor = staged_weight[i].xyz;
    vec2 mean = staged_mean[i], d = centre - mean;
    float shift = push.position_error_px + 8.0 * ULP * max(abs(mean.x), abs(mean.y));
    float reach = (abs(factor.x * d.x) + abs(factor.y * d.y) + abs(factor.z * d.y)) * 16.0 * ULP;
    float moved = reach + (factor.x + abs(factor.y) + factor.z) * shift;
    float exponent = 2.0 * sqrt(fall) * moved + moved * moved + 4.0 * ULP * fall;
    return alpha * (exp2(min(exponent, 100.0)) - 1.0 + (6.0 + 2.0 * fall) * ULP);
}

#include "portable/certify_tile.glsl"
