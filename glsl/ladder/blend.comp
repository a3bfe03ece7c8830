#version 460
#include "shared/workgroup.glsl"
#include "shared/ballot.glsl"
#include "portable/frame.glsl"
#include "portable/blend_splat.glsl"
// One workgroup per 16x16 tile, one invocation per pixel: blends the tile's list front to back, with fewer
// optimizations than portable/blend.comp, for the ladder that measures each of them.
// With BATCH = 0 every pixel reads every splat from memory; otherwise BATCH splats at a time are staged in workgroup
// memory.
// Before: ranges and sorted splat_ids. After: image = (colour over the background, 1 - T), with the same bits as from
// portable/blend.comp.
// A list longer than `pass_limit` takes several passes; between them the image holds (colour, T), with T negated for
// pixels that have stopped.

layout(constant_id = 0) const uint BATCH = 0;
layout(constant_id = 1) const bool RESUME = false;       // not the first pass
layout(constant_id = 2) const bool BALLOT_EXIT = false;  // subgroups, not lanes, report that they stopped

layout(binding = 0, scalar) readonly buffer Ranges { uvec2 ranges[]; };                     // [tiles]
layout(binding = 1, scalar) readonly buffer SplatIds { uint splat_ids[]; };                 // [instance_capacity]
layout(binding = 2, scalar) readonly buffer Splats { Splat splats[]; };                     // [visible_capacity]
layout(binding = 3, scalar) buffer TotalsBlock { Totals totals; };
layout(binding = 4, rgba32f) uniform image2D image;
layout(push_constant, scalar) uniform Push {
    uvec2 size_px;
    uint tiles;
    vec3 background;
    uint pass_begin;   // instances of each list that earlier passes blended
    uint pass_limit;   // instances of a list that this pass may blend
    uint last_pass;    // 1: finish the pixels
} push;

#include "portable/blend_pixel.glsl"

const uint STAGED = BATCH == 0 ? 1 : BATCH;
shared vec2 staged_mean[STAGED];
shared vec4 staged_weight[STAGED];  // factor, opacity
shared vec4 staged_look[STAGED];    // colour and limit
shared uint stopped_lanes;

vec3 colour;
float transmittance;
bool stopped;

void blend_from_memory(vec2 centre, uint begin, uint end) {
    for (uint i = begin; i < end && !stopped; i++) {
        Splat splat = splats[splat_ids[i]];
        vec4 weight = vec4(splat.factor, splat.opacity);
        stopped = blend_splat(splat.mean_px, weight, colour_and_limit(splat), centre, colour, transmittance);
    }
}

void blend_in_batches(vec2 centre, uint begin, uint end) {
    bool reported = false;
    for (uint batch = begin; batch < end; batch += STAGED) {
        // All lanes are done with the last batch. No lane stops before the next barrier, so all take the same branch.
        barrier();
        if (stopped_lanes == WORKGROUP) break;
        if (lane() < STAGED && batch + lane() < end) {
            Splat splat = splats[splat_ids[batch + lane()]];
            staged_mean[lane()] = splat.mean_px;
            staged_weight[lane()] = vec4(splat.factor, splat.opacity);
            staged_look[lane()] = colour_and_limit(splat);
        }
        barrier();
        uint count = min(STAGED, end - batch);
        for (uint i = 0; i < count && !stopped; i++) {
            stopped = blend_splat(
                staged_mean[i], staged_weight[i], staged_look[i], centre, colour, transmittance);
        }
        // Counts: order does not matter.
        if (BALLOT_EXIT) {
            if (!reported && !any_in(subgroupBallot(!stopped))) {
                reported = true;
                if (subgroupElect()) atomicAdd(stopped_lanes, gl_SubgroupSize);
            }
        } else if (stopped && !reported) {
            reported = true;
            atomicAdd(stopped_lanes, 1);
        }
    }
}

void main() {
    uint tile = workgroup();
    if (tile >= push.tiles) return;
    uint tiles_x = div_up(push.size_px.x, TILE);
    uvec2 pixel = uvec2(tile % tiles_x, tile / tiles_x) * TILE + uvec2(lane() % TILE, lane() / TILE);
    bool inside = all(lessThan(pixel, push.size_px));
    vec4 state = begin_pixel(pixel, inside);
    colour = state.rgb;
    transmittance = abs(state.a);
    stopped = !inside || state.a < 0.0;

    uvec2 list = ranges[tile];
    if (lane() == 0) {
        stopped_lanes = 0;
        atomicMax(totals.longest_list, list.y - list.x);  // a maximum: order does not matter
    }
    uvec2 entries = entries_of_pass(list);
    uint begin = entries.x, end = entries.y;
    vec2 centre = vec2(pixel) + 0.5;
    if (BATCH == 0) {
        blend_from_memory(centre, begin, end);
    } else {
        blend_in_batches(centre, begin, end);
    }
    if (inside) end_pixel(pixel, colour, transmittance, stopped);
}
