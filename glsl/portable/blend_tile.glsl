// One workgroup blends the list of a tile, one invocation per pixel.
// Requires: the bindings and push constants of portable/blend.comp, portable/staged.glsl or rays/staged.glsl, and
//   stage(splat)       puts the splat of a lane into workgroup memory
//   Block, block_of(place, inside)  what contains the places of a subgroup
//   reaches(i, block)  false if a staged splat reaches none of these places
#include "portable/blend_pixel.glsl"

shared uint stopped_subgroups;

// The even bits of a byte, packed: one coordinate of a Morton index.
uint even_bits(uint i) {
    return (i & 1) | (i >> 1 & 2) | (i >> 2 & 4) | (i >> 3 & 8);
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
    bool inside = all(lessThan(pixel, push.size_px));
    PLACE place = place_of(pixel);
    Block block = block_of(place, inside);
    vec4 state = begin_pixel(pixel, inside);
    vec3 colour = state.rgb;
    float transmittance = abs(state.a);
    bool stopped = !inside || !sees(place) || state.a < 0.0;

    uvec2 list = ranges[tile];
    if (lane() == 0) {
        stopped_subgroups = 0;
        atomicMax(totals.longest_list, list.y - list.x);  // a maximum: order does not matter
    }
    uvec2 entries = entries_of_pass(list);
    uint begin = entries.x, end = entries.y;
    bool subgroup_stopped = false;
    uint evaluations = 0, walked = 0;
    // Splats are loaded one batch ahead and their ids two, so that the loads run while a batch is blended.
    SPLAT ahead;
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
                subgroupBallot(mine < count && (!CULL_PIXEL_BLOCKS || reaches(mine, block)));
            for (uint w = 0; w < BALLOT_WORDS; w++) {
                for (uint word = reaching[w]; word != 0; word &= word - 1) {
                    uint i = first + 32 * w + findLSB(word);
                    if (COUNT) {
                        walked++;
                        evaluations += uint(!stopped);
                    }
                    if (stopped) continue;
                    float fall = falloff_at(i, place);
                    stopped = blend_falloff(fall, opacity_of(i), look_of(i), colour, transmittance);
                }
            }
            if (!any_in(subgroupBallot(!stopped))) {
                subgroup_stopped = true;
                if (subgroupElect()) atomicAdd(stopped_subgroups, 1);  // a count: order does not matter
            }
        }
    }
    if (COUNT) count_work(evaluations, walked, inside && stopped && push.last_pass == 1, list.y > list.x && !RESUME);
    if (!inside) return;
    if (sees(place)) end_pixel(pixel, vec3(colour), float(transmittance), stopped);
    else imageStore(image, ivec2(pixel), vec4(0.0));  // no ray: transparent, without the background
}
