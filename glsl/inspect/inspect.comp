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
    uvec2 size_px;
    uint tiles;
    vec3 background;
    uint pass_begin;   // instances of each list that earlier passes walked
    uint pass_limit;   // instances of a list that this pass may walk
    uint last_pass;    // 1: finish the pixels
} push;

#include "portable/blend_pixel.glsl"

// `Work` in src/render/inspect/inspector.rs documents the pictures that these constants shape.
const float CENTRE_RADIUS = 1.5;         // px
const float OUTLINE_ALPHA = 0.5;
const float OUTLINES_STOP = 1.0 / 512.0;  // half a step of 8 bits
const float NOTHING = 1e-12;              // behind this transmittance nothing is visible

shared vec2 staged_mean[WORKGROUP];
shared vec4 staged_weight[WORKGROUP];  // factor, opacity
shared vec4 staged_look[WORKGROUP];    // colour and limit
shared uint stopped_lanes;

// True if a splat is drawn at the offset `d` (px) from its mean, but not 1 px farther out.
bool is_border(vec3 factor, float limit, vec2 d) {
    float u = factor.x * d.x + factor.y * d.y, v = factor.z * d.y;
    vec2 outwards = vec2(factor.x * u, factor.y * u + factor.z * v);  // half the gradient of the falloff
    outwards = outwards == vec2(0.0) ? vec2(1.0, 0.0) : normalize(outwards);
    return falloff(factor, d) <= limit && !(falloff(factor, d + outwards) <= limit);
}

// Adds a splat to (mean depth, median depth, count). It has this share of the pixel and changes the transmittance from
// `before` to `after`.
vec3 add_depth(vec3 sum, float depth, float share, float before, float after) {
    // The mean moves towards each new depth by its fraction of all shares so far, so it stays within the depths.
    float mean = sum.z == 0.0 ? depth : sum.x + (depth - sum.x) * share / max(1.0 - after, share);
    return vec3(mean, before > 0.5 && after <= 0.5 ? depth : sum.y, sum.z + 1.0);
}

// Applies staged splat `i` to a pixel. Returns true if the pixel stops.
bool walk_splat(uint i, vec2 centre, inout vec3 sum, inout float transmittance) {
    vec2 mean = staged_mean[i];
    vec4 weight = staged_weight[i], look = staged_look[i];
    if (WORK == WORK_CENTRES) {
        if (!(distance(mean, centre) <= CENTRE_RADIUS)) return false;
        sum = look.rgb;
        return true;
    }
    if (WORK == WORK_OUTLINES) {
        if (!is_border(weight.xyz, look.w, centre - mean)) return false;
        sum += OUTLINE_ALPHA * transmittance * look.rgb;
        transmittance *= 1.0 - OUTLINE_ALPHA;
        return transmittance < OUTLINES_STOP;
    }
    if (WORK == WORK_DEPTHS && transmittance < NOTHING) return true;
    vec3 share = vec3(0.0);
    float before = transmittance;
    bool ends = blend_splat(mean, weight, vec4(vec3(1.0), look.w), centre, share, transmittance);
    // The splat that stops a pixel is drawn if the transmittance fell below STOP, but not if it would fall below
    // TRANSMITTANCE_MIN.
    bool drawn = falloff(weight.xyz, centre - mean) <= look.w && (!ends || transmittance != before);
    if (WORK == WORK_DEPTHS) {
        if (drawn) sum = add_depth(sum, look.r, share.r, before, transmittance);
    } else if (WORK == WORK_EVALUATIONS || drawn) {
        sum += 1.0;
    }
    return ends;
}

void main() {
    uint tile = workgroup();
    if (tile >= push.tiles) return;
    uint tiles_x = div_up(push.size_px.x, TILE);
    uvec2 pixel = uvec2(tile % tiles_x, tile / tiles_x) * TILE + uvec2(lane() % TILE, lane() / TILE);
    vec2 centre = vec2(pixel) + 0.5;
    bool inside = all(lessThan(pixel, push.size_px));
    vec4 state = begin_pixel(pixel, inside);
    vec3 sum = state.rgb;
    float transmittance = abs(state.a);
    bool stopped = !inside || state.a < 0.0, told = false;

    uvec2 list = ranges[tile];
    if (lane() == 0) {
        stopped_lanes = 0;
        atomicMax(totals.longest_list, list.y - list.x);  // a maximum: order does not matter
    }
    uint begin = list.x + min(push.pass_begin, list.y - list.x);
    uint end = begin + min(push.pass_limit, list.y - begin);
    if (WORK == WORK_TILE_LOAD) {
        sum = vec3(list.y - list.x);
        end = begin;
    }
    for (uint batch = begin; batch < end; batch += WORKGROUP) {
        // All lanes are done with the last batch. No lane stops before the next barrier, so all take the same branch.
        barrier();
        if (stopped_lanes == WORKGROUP) break;
        if (batch + lane() < end) {
            Splat splat = splats[splat_ids[batch + lane()]];
            staged_mean[lane()] = splat.mean_px;
            staged_weight[lane()] = vec4(splat.factor, splat.opacity);
            staged_look[lane()] = colour_and_limit(splat);
        }
        barrier();
        uint count = min(WORKGROUP, end - batch);
        for (uint i = 0; i < count && !stopped; i++) {
            stopped = walk_splat(i, centre, sum, transmittance);
        }
        if (stopped && !told) atomicAdd(stopped_lanes, 1);  // a count: order does not matter
        told = stopped;
    }
    bool opaque = WORK == WORK_CENTRES ? stopped : WORK != WORK_OUTLINES && WORK != WORK_DEPTHS;
    if (opaque && push.last_pass == 1) transmittance = 0.0;
    if (inside) end_pixel(pixel, sum, transmittance, stopped);
}
