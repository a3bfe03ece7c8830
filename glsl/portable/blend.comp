#version 460
#include "shared/workgroup.glsl"
#include "shared/ballot.glsl"
#include "portable/frame.glsl"
#include "portable/blend_splat.glsl"
// One workgroup per 16x16 tile, one invocation per pixel: blends the tile's list front to back.
// Batches of 256 splats are staged in workgroup memory. Each subgroup holds a small block of pixels, finds the staged
// splats that reach it by ballot, blends only those, and ends when all its pixels have stopped. The workgroup ends with
// its last subgroup.
// Before: ranges and sorted splat_ids. After: image = (colour over the background, 1 - T).
// A list longer than `pass_limit` takes several passes; between them the image holds (colour, T), with T negated for
// pixels that have stopped.

layout(constant_id = 0) const bool CULL_PIXEL_BLOCKS = true;
layout(constant_id = 1) const bool RESUME = false;  // not the first pass
layout(constant_id = 2) const bool COUNT = false;   // count the work into `totals`

layout(binding = 0, scalar) readonly buffer Ranges { uvec2 ranges[]; };                     // [tiles]
layout(binding = 1, scalar) readonly buffer SplatIds { uint splat_ids[]; };                 // [instance_capacity]
layout(binding = 2, scalar) readonly buffer Splats { Splat splats[]; };                     // [visible_capacity]
layout(binding = 3, scalar) buffer TotalsBlock { Totals totals; };
layout(binding = 4, scalar) readonly buffer TilesByClass { uint tiles_by_class[]; };        // [TILE_CLASSES * tiles]
layout(binding = 5, rgba32f) uniform image2D image;
layout(push_constant, scalar) uniform Push {
    uvec2 size_px;
    uint tiles;
    vec3 background;
    uint pass_begin;   // instances of each list that earlier passes blended
    uint pass_limit;   // instances of a list that this pass may blend
    uint last_pass;    // 1: finish the pixels
} push;

#include "portable/blend_pixel.glsl"

shared vec2 staged_mean[WORKGROUP];
shared vec4 staged_weight[WORKGROUP];  // factor, opacity
shared vec4 staged_colour[WORKGROUP];  // colour, and the falloff beyond which the splat is not drawn
shared uint stopped_subgroups;

// The even bits of a byte, packed: one coordinate of a Morton index.
uint even_bits(uint i) {
    return (i & 1) | (i >> 1 & 2) | (i >> 2 & 4) | (i >> 3 & 8);
}

// True if staged splat `i` may reach a pixel centre in the box from `low` to `high` (px). The test is exact, apart from
// a slack for rounding: the least falloff in the box lies at the mean or on one of the two sides that face it.
bool reaches(uint i, vec2 low, vec2 high) {
    vec3 factor = staged_weight[i].xyz;
    vec2 from = low - staged_mean[i], to = high - staged_mean[i];
    vec2 near = clamp(vec2(0.0), from, to);
    float best_y = -factor.x * factor.y / (factor.y * factor.y + factor.z * factor.z) * near.x;
    float best_x = -factor.y / factor.x * near.y;
    vec2 on_x = vec2(near.x, clamp(best_y, from.y, to.y));
    vec2 on_y = vec2(clamp(best_x, from.x, to.x), near.y);
    float least = min(falloff(factor, on_x), falloff(factor, on_y));
    // u is a difference of products. Its rounding shifts sqrt(falloff) by at most the second term.
    vec2 far = max(abs(from), abs(to));
    float limit =
        sqrt(float(staged_colour[i].w) + 1e-4) + 1e-6 * (factor.x * far.x + (abs(factor.y) + factor.z) * far.y);
    return !(least > limit * limit);
}

void stage(Splat splat) {
    staged_mean[lane()] = splat.mean_px;
    staged_weight[lane()] = vec4(splat.factor, splat.opacity);
    staged_colour[lane()] = colour_and_limit(splat);
}

// The `place`-th tile in the order of the classes, which begins with the longest lists.
uint next_tile(uint place) {
    for (uint c = 0; c < TILE_CLASSES; c++) {
        uint count = totals.tiles_in_class[c];
        if (place < count) return tiles_by_class[c * push.tiles + place];
        place -= count;
    }
    return 0;  // unreachable: every tile is in a class
}

// Adds the counts of this subgroup to `totals`. All are sums of integers: order does not matter.
void count_work(uint evaluations, uint walked, bool opaque, bool has_list) {
    uint sum = subgroupAdd(evaluations), slots = subgroupAdd(walked), pixels = subgroupAdd(uint(opaque));
    if (subgroupElect()) {
        uint before = atomicAdd(totals.evaluations_low, sum);
        if (before + sum < before) atomicAdd(totals.evaluations_high, 1);
        before = atomicAdd(totals.walked_low, slots);
        if (before + slots < before) atomicAdd(totals.walked_high, 1);
        atomicAdd(totals.stopped_pixels, pixels);
        if (has_list && gl_SubgroupID == 0) atomicAdd(totals.listed_tiles, 1);
    }
}

void main() {
    if (workgroup() >= push.tiles) return;
    uint tile = next_tile(workgroup());
    uint tiles_x = div_up(push.size_px.x, TILE);
    uvec2 corner = uvec2(tile % tiles_x, tile / tiles_x) * TILE;
    // Morton order gives a subgroup of any size a compact block: 4x2 pixels for 8, 8x4 for 32, 8x8 for 64.
    uvec2 pixel = corner + uvec2(even_bits(lane()), even_bits(lane() >> 1));
    vec2 centre = vec2(pixel) + 0.5;
    vec2 block_low = subgroupBroadcast(centre, 0);
    vec2 block_high = subgroupBroadcast(centre, gl_SubgroupSize - 1);

    bool inside = all(lessThan(pixel, push.size_px));
    vec4 state = begin_pixel(pixel, inside);
    vec3 colour = state.rgb;
    float transmittance = abs(state.a);
    bool stopped = !inside || state.a < 0.0;

    uvec2 list = ranges[tile];
    if (lane() == 0) {
        stopped_subgroups = 0;
        atomicMax(totals.longest_list, list.y - list.x);  // a maximum: order does not matter
    }
    uint begin = list.x + min(push.pass_begin, list.y - list.x);
    uint end = begin + min(push.pass_limit, list.y - begin);
    bool subgroup_stopped = false;
    uint evaluations = 0, walked = 0;
    // Splats are loaded one batch ahead and their ids two, so that the loads run while a batch is blended.
    Splat ahead;
    uint id_ahead = 0;
    if (begin + lane() < end) ahead = splats[splat_ids[begin + lane()]];
    if (begin + WORKGROUP + lane() < end) id_ahead = splat_ids[begin + WORKGROUP + lane()];
    for (uint batch = begin; batch < end; batch += WORKGROUP) {
        // All lanes are done with the last batch. No lane stops before the next barrier, so all take the same branch.
        barrier();
        if (stopped_subgroups == gl_NumSubgroups) break;
        stage(ahead);
        barrier();
        uint following = batch + WORKGROUP + lane();
        if (following < end) ahead = splats[id_ahead];
        if (following + WORKGROUP < end) id_ahead = splat_ids[following + WORKGROUP];
        uint count = min(WORKGROUP, end - batch);
        for (uint first = 0; first < count && !subgroup_stopped; first += gl_SubgroupSize) {
            uint mine = first + gl_SubgroupInvocationID;
            uvec4 reaching =
                subgroupBallot(mine < count && (!CULL_PIXEL_BLOCKS || reaches(mine, block_low, block_high)));
            for (uint w = 0; w < BALLOT_WORDS; w++) {
                for (uint word = reaching[w]; word != 0; word &= word - 1) {
                    uint i = first + 32 * w + findLSB(word);
                    if (COUNT) {
                        walked++;
                        evaluations += uint(!stopped);
                    }
                    if (!stopped) {
                        stopped = blend_splat(
                            staged_mean[i], staged_weight[i], staged_colour[i], centre, colour, transmittance);
                    }
                }
            }
            if (!any_in(subgroupBallot(!stopped))) {
                subgroup_stopped = true;
                if (subgroupElect()) atomicAdd(stopped_subgroups, 1);  // a count: order does not matter
            }
        }
    }
    if (COUNT) count_work(evaluations, walked, inside && stopped && push.last_pass == 1, list.y > list.x && !RESUME);
    if (inside) end_pixel(pixel, vec3(colour), float(transmittance), stopped);
}
