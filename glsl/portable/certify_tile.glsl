// One workgroup blends the list of a tile, one invocation per pixel, as blend_tile.glsl does, bit for bit, and bounds
// the distance of the picture from the sum of all contributions in the same order.
//
// Let T be the transmittance of the picture and D the brightest colour. A contribution alpha that is left out moves a
// colour by at most T * alpha * D, and everything behind the point where a pixel stops by at most T * D
// (docs/accuracy.md). These bounds are proven; an allowance for the rounding of f32 is added.
// Requires: the bindings and push constants of portable/blend_certified.comp, portable/staged.glsl or rays/staged.glsl,
// ULP, and
//   rounding(i, place, fall, alpha)  bounds what rounding changes of alpha, that of a staged splat at this falloff
#include "portable/blend_pixel.glsl"

shared uint brightest_bits;

void main() {
    uint tile = workgroup();
    if (tile >= push.tiles) return;
    uvec2 pixel = pixel_of_lane(tile);
    bool inside = all(lessThan(pixel, push.size_px));
    PLACE place = place_of(pixel);
    vec4 state = begin_pixel(pixel, inside);
    vec3 colour = state.rgb;
    float transmittance = abs(state.a);
    bool stopped = !inside || !sees(place) || state.a < 0.0;
    vec3 so_far = RESUME && inside ? imageLoad(certificate, ivec2(pixel)).rgb : vec3(0.0);
    float sum = so_far.x, brightest = so_far.y;

    uvec2 list = ranges[tile];
    // The passes of one list count it once, those of several slabs each their own.
    float terms = so_far.z + (push.pass_begin == 0 ? float(list.y - list.x) : 0.0);
    if (lane() == 0) {
        brightest_bits = 0;
        atomicMax(totals.longest_list, list.y - list.x);  // a maximum: order does not matter
    }
    uvec2 entries = entries_of_pass(list);
    uint begin = entries.x, end = entries.y;
    for (uint batch = begin; batch < end; batch += WORKGROUP) {
        barrier();
        if (batch + lane() < end) {
            SPLAT splat = splats[splat_ids[batch + lane()]];
            put(splat);
            // Splats behind the point where a pixel stops count as well.
            brightest = max(brightest, max(splat.colour.r, max(splat.colour.g, splat.colour.b)));
        }
        barrier();
        uint count = min(WORKGROUP, end - batch);
        for (uint i = 0; i < count && !stopped; i++) {
            float fall = falloff_at(i, place), opacity = opacity_of(i);
            vec4 look = look_of(i);
            float alpha = min(ALPHA_MAX, opacity * exp2(-fall)), inexact = rounding(i, place, fall, alpha);
            if (fall <= look.w) {
                // The product with T and two sums are rounded, in addition to the weight.
                sum += transmittance * inexact + ULP * (transmittance + 1.0);
                stopped = blend_falloff(fall, opacity, look, colour, transmittance);
                if (stopped) sum += transmittance;
            } else {
                sum += transmittance * (alpha + inexact);
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
    if (!sees(place)) {  // no ray: nothing is left out
        imageStore(image, ivec2(pixel), vec4(0.0));
        imageStore(certificate, ivec2(pixel), vec4(vec3(0.0), 1.0));
        return;
    }
    float range = max(brightest, max(push.background.r, max(push.background.g, push.background.b)));
    // The sum itself is rounded, by at most one unit per term.
    float rounded = 1.0 + 1e-3 + terms * ULP;
    float bound = rounded * range * sum + push.unlisted;
    imageStore(
        certificate, ivec2(pixel), push.last_pass == 1 ? vec4(vec3(bound), 1.0) : vec4(sum, brightest, terms, 0.0));
    end_pixel(pixel, colour, transmittance, stopped);
}
