#version 460
#include "shared/workgroup.glsl"
#include "portable/frame.glsl"
#include "portable/blend_splat.glsl"
// One workgroup per 16x16 tile, one invocation per pixel: blends the tile's list front to back as blend.comp does, bit
// for bit, and bounds the distance of the picture from the sum of all contributions in the same order.
//
// Let T be the transmittance of the picture and D the brightest colour. A contribution alpha that is left out moves a
// colour by at most T * alpha * D, and everything behind the point where a pixel stops by at most T * D
// (docs/accuracy.md). These bounds are proven; an allowance for the rounding of f32 is added.
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
    uvec2 size_px;
    uint tiles;
    vec3 background;
    uint pass_begin;          // instances of each list that earlier passes blended
    uint pass_limit;          // instances of a list that this pass may blend
    uint last_pass;           // 1: finish the pixels
    float unlisted;           // upper bound on the sum of all contributions below the listing threshold
    float position_error_px;  // rounding error of a mean near the middle of the image
} push;

#include "portable/blend_pixel.glsl"

shared vec2 staged_mean[WORKGROUP];
shared vec4 staged_weight[WORKGROUP];  // factor, opacity
shared vec4 staged_look[WORKGROUP];    // colour and limit
shared uint brightest_bits;

const float ULP = 1.1920929e-7;  // of 1.0

// Upper bound on the relative error of an alpha by f32 rounding: factors and means are off by a few units in the last
// place.
float rounding(vec3 factor, vec2 mean, vec2 d, float fall) {
    float shift = push.position_error_px + 8.0 * ULP * max(abs(mean.x), abs(mean.y));
    float reach = (abs(factor.x * d.x) + abs(factor.y * d.y) + abs(factor.z * d.y)) * 16.0 * ULP;
    float moved = reach + (factor.x + abs(factor.y) + factor.z) * shift;
    float exponent = 2.0 * sqrt(fall) * moved + moved * moved + 4.0 * ULP * fall;
    return exp2(min(exponent, 100.0)) - 1.0 + (6.0 + 2.0 * fall) * ULP;
}

void main() {
    uint tile = workgroup();
    if (tile >= push.tiles) return;
    uint tiles_x = div_up(push.size_px.x, TILE);
    uvec2 pixel = uvec2(tile % tiles_x, tile / tiles_x) * TILE + uvec2(lane() % TILE, lane() / TILE);
    vec2 centre = vec2(pixel) + 0.5;
    bool inside = all(lessThan(pixel, push.size_px));
    vec4 state = begin_pixel(pixel, inside);
    vec3 colour = state.rgb;
    float transmittance = abs(state.a);
    bool stopped = !inside || state.a < 0.0;
    vec3 so_far = RESUME && inside ? imageLoad(certificate, ivec2(pixel)).rgb : vec3(0.0);
    float sum = so_far.x, brightest = so_far.y;

    uvec2 list = ranges[tile];
    // The passes of one list count it once, those of several slabs each their own.
    float terms = so_far.z + (push.pass_begin == 0 ? float(list.y - list.x) : 0.0);
    if (lane() == 0) {
        brightest_bits = 0;
        atomicMax(totals.longest_list, list.y - list.x);  // a maximum: order does not matter
    }
    uint begin = list.x + min(push.pass_begin, list.y - list.x);
    uint end = begin + min(push.pass_limit, list.y - begin);
    for (uint batch = begin; batch < end; batch += WORKGROUP) {
        barrier();
        if (batch + lane() < end) {
            Splat splat = splats[splat_ids[batch + lane()]];
            staged_mean[lane()] = splat.mean_px;
            staged_weight[lane()] = vec4(splat.factor, splat.opacity);
            staged_look[lane()] = colour_and_limit(splat);
            // Splats behind the point where a pixel stops count as well.
            brightest = max(brightest, max(splat.colour.r, max(splat.colour.g, splat.colour.b)));
        }
        barrier();
        uint count = min(WORKGROUP, end - batch);
        for (uint i = 0; i < count && !stopped; i++) {
            vec2 d = centre - staged_mean[i];
            vec4 weight = staged_weight[i], look = staged_look[i];
            float fall = falloff(weight.xyz, d);
            float part = transmittance * min(ALPHA_MAX, weight.w * exp2(-fall));
            float inexact = rounding(weight.xyz, staged_mean[i], d, fall);
            if (fall <= look.w) {
                // The product with T and two sums are rounded, in addition to the weight.
                sum += part * inexact + ULP * (transmittance + 1.0);
                stopped = blend_splat(staged_mean[i], weight, look, centre, colour, transmittance);
                if (stopped) sum += transmittance;
            } else {
                sum += part * (1.0 + inexact);
            }
        }
    }
    barrier();
    float mine = subgroupMax(brightest);
    // Non-negative floats order like their bits. A maximum: order does not matter.
    if (subgroupElect()) atomicMax(brightest_bits, floatBitsToUint(mine));
    barrier();
    brightest = uintBitsToFloat(brightest_bits);
    if (!inside) return;
    float range = max(brightest, max(push.background.r, max(push.background.g, push.background.b)));
    // The sum itself is rounded, by at most one unit per term.
    float rounded = 1.0 + 1e-3 + terms * ULP;
    float bound = rounded * range * sum + push.unlisted;
    imageStore(
        certificate, ivec2(pixel), push.last_pass == 1 ? vec4(vec3(bound), 1.0) : vec4(sum, brightest, terms, 0.0));
    end_pixel(pixel, colour, transmittance, stopped);
}
