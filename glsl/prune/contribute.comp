#version 460
#include "shared/workgroup.glsl"
#include "portable/frame.glsl"
#include "portable/blend_splat.glsl"
#include "prune/share.glsl"
// One workgroup per 16x16 tile, one invocation per pixel: walks the tile's list as a blend does, and adds the
// share of each splat to the largest share and to the sum of shares of its Gaussian.
// Before: the lists of a complete frame; contributions of earlier views, or zeros. After: contributions include this
// view, and image = (0, 0, 0, 1 - T) with the T of the image.
// A list longer than `pass_limit` takes several passes; between passes the image is as in portable/blend.comp.

layout(constant_id = 1) const bool RESUME = false;  // not the first pass

// The contribution of a Gaussian to all pixels of all views so far.
struct Contribution {
    uint largest;   // bits of the largest share, a float from 0 to 1: non-negative floats order like their bits
    uint sum_low;   // sum of the shares in units of 1 / SHARE_UNIT, 64 bits: enough for 2^40 pixels
    uint sum_high;
};

layout(binding = 0, scalar) readonly buffer Ranges { uvec2 ranges[]; };                     // [tiles]
layout(binding = 1, scalar) readonly buffer SplatIds { uint splat_ids[]; };                 // [instance_capacity]
layout(binding = 2, scalar) readonly buffer Splats { Splat splats[]; };                     // [visible_capacity]
layout(binding = 3, scalar) readonly buffer Ids { uint gaussian_from_splat[]; };            // [visible_capacity]
layout(binding = 4, scalar) buffer Contributions { Contribution contributions[]; };         // [gaussians]
layout(binding = 5, rgba32f) uniform image2D image;
layout(push_constant, scalar) uniform Push {
    uvec2 size_px;
    uint tiles;
    vec3 background;   // 0
    uint pass_begin;   // instances of each list that earlier passes walked
    uint pass_limit;   // instances of a list that this pass may walk
    uint last_pass;    // 1: finish the pixels
} push;

#include "portable/blend_pixel.glsl"

shared vec2 staged_mean[WORKGROUP];
shared vec4 staged_weight[WORKGROUP];  // factor, opacity
shared float staged_limit[WORKGROUP];
shared uint staged_largest[WORKGROUP];  // bits of a float
shared uint staged_sum[WORKGROUP];      // at most 256 pixels of SHARE_UNIT - 1 each, which is less than 2^32
shared uint stopped_subgroups;

// A share in units of 1 / SHARE_UNIT, less than 1.
uint in_units(float share) {
    return min(uint(roundEven(share * float(SHARE_UNIT))), SHARE_UNIT - 1);
}

// Adds the shares of staged splat `i` in the pixels of this subgroup. A maximum and a sum of integers: order does not
// matter.
void note(uint i, float share) {
    float most = subgroupMax(share);
    if (most == 0.0) return;
    uint sum = subgroupAdd(in_units(share));
    if (subgroupElect()) {
        atomicMax(staged_largest[i], floatBitsToUint(most));
        atomicAdd(staged_sum[i], sum);
    }
}

// Adds the shares of a Gaussian in a tile. A maximum and a sum of integers: order does not matter.
void add(uint gaussian, uint largest, uint sum) {
    atomicMax(contributions[gaussian].largest, largest);
    uint before = atomicAdd(contributions[gaussian].sum_low, sum);
    if (before + sum < before) atomicAdd(contributions[gaussian].sum_high, 1);
}

void main() {
    uint tile = workgroup();
    if (tile >= push.tiles) return;
    uint tiles_x = div_up(push.size_px.x, TILE);
    uvec2 pixel = uvec2(tile % tiles_x, tile / tiles_x) * TILE + uvec2(lane() % TILE, lane() / TILE);
    vec2 centre = vec2(pixel) + 0.5;
    bool inside = all(lessThan(pixel, push.size_px));
    vec4 state = begin_pixel(pixel, inside);
    float transmittance = abs(state.a);
    bool stopped = !inside || state.a < 0.0, subgroup_stopped = false;

    if (lane() == 0) stopped_subgroups = 0;
    uvec2 list = ranges[tile];
    uvec2 entries = entries_of_pass(list);
    uint begin = entries.x, end = entries.y;
    for (uint batch = begin; batch < end; batch += WORKGROUP) {
        // All lanes are done with the last batch. No lane stops before the next barrier, so all take the same branch.
        barrier();
        if (stopped_subgroups == gl_NumSubgroups) break;
        uint id = batch + lane() < end ? splat_ids[batch + lane()] : 0;
        if (batch + lane() < end) {
            Splat splat = splats[id];
            staged_mean[lane()] = splat.mean_px;
            staged_weight[lane()] = vec4(splat.factor, splat.opacity);
            staged_limit[lane()] = falloff_limit(splat.opacity);
            staged_largest[lane()] = 0;
            staged_sum[lane()] = 0;
        }
        barrier();
        uint count = min(WORKGROUP, end - batch);
        for (uint i = 0; i < count && !subgroup_stopped; i++) {
            float share = 0.0;
            if (!stopped) {
                share = take_share(
                    staged_mean[i], staged_weight[i], staged_limit[i], centre, transmittance, stopped);
            }
            note(i, share);
            subgroup_stopped = subgroupAll(stopped);
            if (subgroup_stopped && subgroupElect()) atomicAdd(stopped_subgroups, 1);  // a count
        }
        barrier();
        if (batch + lane() < end && staged_largest[lane()] != 0) {
            add(gaussian_from_splat[id], staged_largest[lane()], staged_sum[lane()]);
        }
    }
    if (inside) end_pixel(pixel, vec3(0.0), transmittance, stopped);
}
