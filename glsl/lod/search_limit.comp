#version 460
#include "shared/workgroup.glsl"
#include "lod/selection.glsl"
#include "shared/error_code.glsl"
// One invocation per page in view and candidate of a round: what the candidate leaves of the page.
// Before: `seen` from look, the sums of the rounds before. After: the sums of this round.

layout(binding = 0, scalar) readonly buffer Errors { PageErrors errors[]; };                // [pages]
layout(binding = 1, scalar) readonly buffer Steps { uint steps[]; };                        // [256]
layout(binding = 2, scalar) readonly buffer Seen { uvec4 seen[]; };                         // [room]
layout(binding = 3, scalar) buffer State { CutState state; };
layout(push_constant, scalar) uniform Push {
    float given_squared;
    uint searches;
    uvec2 most_nodes;
    uvec2 most_energy;
    uint pixels;
    uint room;  // in `seen`
    uint round;
    uint fade;  // codes above a limit over which nodes fade
} push;

#include "lod/limit.glsl"

const uint LANES = CANDIDATES + 1;  // of a page
shared uint sums[SEARCHES * CANDIDATES * 2];

void main() {
    uint first = workgroup() * (WORKGROUP / LANES);
    uint pages = min(state.seen, push.room);
    if (first >= pages) return;
    if (lane() < SEARCHES * CANDIDATES * 2) sums[lane()] = 0;
    read_rounds(push.round);
    uint number = first + lane() / LANES, candidate = lane() % LANES;
    if (number < pages && candidate < CANDIDATES) {
        SeenPage place = seen_page_of(seen[number]);
        PageErrors page = errors[place.page];
        for (uint search = 0; search < SEARCHES; search++) {
            if ((push.searches & 1 << search) == 0) continue;
            uint tried = found_by(search) + (candidate + 1 << 3 * (ROUNDS - 1 - push.round));
            Left left = left_of(place, page, limits_of(place, limit_squared_of(tried)));
            uvec2 added = search == BY_NODES ? uvec2(nodes_of(left), 0) : in_units(energy_of(left, place, page));
            // Sums are of whole numbers: order does not matter.
            uint word = (search * CANDIDATES + candidate) * 2, before = atomicAdd(sums[word], added.x);
            added.y += uint(before + added.x < before);
            if (added.y > 0) atomicAdd(sums[word + 1], added.y);
        }
    }
    barrier();
    if (lane() < SEARCHES * CANDIDATES) {
        uint search = lane() / CANDIDATES, candidate = lane() % CANDIDATES;
        uint word = ((search * ROUNDS + push.round) * CANDIDATES + candidate) * 2;
        uint low = sums[2 * lane()], before = atomicAdd(state.sums[word], low);
        uint high = sums[2 * lane() + 1] + uint(before + low < before);
        if (high > 0) atomicAdd(state.sums[word + 1], high);
    }
}
