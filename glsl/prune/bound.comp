#version 460
#include "shared/workgroup.glsl"
#include "portable/frame.glsl"
#include "portable/blend_splat.glsl"
#include "prune/share.glsl"
// One workgroup per 16x16 tile, one invocation per pixel: walks the list of the whole scene, and bounds the
// change of the image if Gaussians are dropped.
//
// Let w be the sum of the shares of the dropped splats in a pixel, and D the brightest colour. Then the pixel changes
// by at most D * w. If the pixel stops later without the dropped splats, splats behind the former stop show, too, and
// w grows by the transmittance at that stop (docs/prune.md).
// Before: the lists of a complete frame of the whole scene; kept. After: image = (bound, w, D, number of splats in w).
// The bound is D * w with an allowance for the rounding of f32.
// A list longer than `pass_limit` takes several passes; between passes the image holds (w, T without dropped
// splats, D so far, T), with T negated for pixels that have stopped, and counts the number of blended splats.

layout(constant_id = 1) const bool RESUME = false;  // not the first pass

layout(binding = 0, scalar) readonly buffer Ranges { uvec2 ranges[]; };                     // [tiles]
layout(binding = 1, scalar) readonly buffer SplatIds { uint splat_ids[]; };                 // [instance_capacity]
layout(binding = 2, scalar) readonly buffer Splats { Splat splats[]; };                     // [visible_capacity]
layout(binding = 3, scalar) readonly buffer Ids { uint gaussian_from_splat[]; };            // [visible_capacity]
layout(binding = 4, scalar) readonly buffer Kept { uint kept[]; };                          // bits
layout(binding = 5, scalar) buffer Counts { uint counts[]; };                               // [pixels]
layout(binding = 6, rgba32f) uniform image2D image;
layout(push_constant, scalar) uniform Push {
    uvec2 size_px;
    uint tiles;
    float background;  // its brightest channel
    uint pass_begin;   // instances of each list that earlier passes walked
    uint pass_limit;   // instances of a list that this pass may walk
    uint last_pass;    // 1: finish the pixels
} push;

shared vec2 staged_mean[WORKGROUP];
shared vec4 staged_weight[WORKGROUP];  // factor, opacity
shared float staged_limit[WORKGROUP];
shared bool staged_kept[WORKGROUP];
shared uint brightest_bits;

const float ULP = 1.1920929e-7;  // of 1.0
const float SLACK = 1e-3;        // for the rounding of the sum of shares

// The pixel that a lane walks.
struct Walk {
    float dropped;  // w: the shares of the dropped splats
    float without;  // transmittance of the image without dropped splats
    float whole;    // transmittance of the whole image
    uint blended;
    bool stopped;   // the pixel of the whole image has stopped
};

void walk_splat(uint i, vec2 centre, inout Walk walk) {
    vec2 mean = staged_mean[i];
    vec4 weight = staged_weight[i];
    float limit = staged_limit[i];
    float share = take_share(mean, weight, limit, centre, walk.whole, walk.stopped);
    if (share == 0.0) return;
    walk.blended++;
    // The share of a dropped splat that ends the pixel is the remaining transmittance.
    if (!staged_kept[i]) {
        walk.dropped += share;
        return;
    }
    bool stops;
    take_share(mean, weight, limit, centre, walk.without, stops);
    // The transmittance is higher without the dropped splats, so the pixel cannot stop earlier.
    if (walk.stopped && !stops) walk.dropped += share;
}

void main() {
    uint tile = workgroup();
    if (tile >= push.tiles) return;
    uint tiles_x = div_up(push.size_px.x, TILE);
    uvec2 pixel = uvec2(tile % tiles_x, tile / tiles_x) * TILE + uvec2(lane() % TILE, lane() / TILE);
    vec2 centre = vec2(pixel) + 0.5;
    bool inside = all(lessThan(pixel, push.size_px));
    uint place = pixel.y * push.size_px.x + pixel.x;
    vec4 state = RESUME && inside ? imageLoad(image, ivec2(pixel)) : vec4(0.0, 1.0, 0.0, 1.0);
    Walk walk = Walk(state.r, state.g, abs(state.a), RESUME && inside ? counts[place] : 0, !inside || state.a < 0.0);
    float brightest = state.b;

    if (lane() == 0) brightest_bits = 0;
    uvec2 list = ranges[tile];
    uint begin = list.x + min(push.pass_begin, list.y - list.x);
    uint end = begin + min(push.pass_limit, list.y - begin);
    for (uint batch = begin; batch < end; batch += WORKGROUP) {
        barrier();
        if (batch + lane() < end) {
            uint id = splat_ids[batch + lane()];
            uint gaussian = gaussian_from_splat[id];
            Splat splat = splats[id];
            staged_mean[lane()] = splat.mean_px;
            staged_weight[lane()] = vec4(splat.factor, splat.opacity);
            staged_limit[lane()] = falloff_limit(splat.opacity);
            staged_kept[lane()] = (kept[gaussian / 32] >> (gaussian % 32) & 1) != 0;
            // Splats behind the stop of a pixel count as well, since they may show.
            brightest = max(brightest, max(splat.colour.r, max(splat.colour.g, splat.colour.b)));
        }
        barrier();
        uint count = min(WORKGROUP, end - batch);
        for (uint i = 0; i < count && !walk.stopped; i++) walk_splat(i, centre, walk);
    }
    barrier();
    float mine = subgroupMax(brightest);
    // Non-negative floats order like their bits. A maximum: order does not matter.
    if (subgroupElect()) atomicMax(brightest_bits, floatBitsToUint(mine));
    barrier();
    brightest = uintBitsToFloat(brightest_bits);
    if (!inside) return;
    if (push.last_pass == 0) {
        imageStore(
            image, ivec2(pixel), vec4(walk.dropped, walk.without, brightest, walk.stopped ? -walk.whole : walk.whole));
        counts[place] = walk.blended;
        return;
    }
    float range = max(brightest, push.background);
    // Each blended splat rounds a product and a sum in both images. Pixels without dropped splats are equal.
    float rounding = walk.dropped > 0.0 ? 2.0 * ULP * float(walk.blended) : 0.0;
    float bound = range * (walk.dropped * (1.0 + SLACK) + rounding);
    imageStore(image, ivec2(pixel), vec4(bound, walk.dropped, range, float(walk.blended)));
}
