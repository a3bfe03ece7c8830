#version 460
#include "shared/workgroup.glsl"
#include "lod/selection.glsl"
#include "shared/error_code.glsl"
// One invocation per page in view and candidate limit of a round: sums the nodes and errors that remain of the page.
// Before: `in_view` from cull_pages, the sums of the rounds before. After: the sums of this round.

layout(binding = 0, scalar) readonly buffer Errors { PageErrors errors[]; };                // [pages]
layout(binding = 1, scalar) readonly buffer Steps { uint steps[]; };                        // [256]
layout(binding = 2, scalar) readonly buffer InView { uvec4 in_view[]; };                    // [capacity]
layout(binding = 3, scalar) buffer State { SelectionState state; };
layout(push_constant, scalar) uniform Push {
    float given_squared;
    uint searches;
    uvec2 max_nodes;
    uvec2 max_error;
    uint pixels;
    uint capacity;  // of `in_view`
    uint round;
    uint fade;  // codes above a limit over which nodes fade
} push;

#include "lod/limit.glsl"

const uint LANES = CANDIDATES + 1;  // per page
shared uint sums[SEARCHES * CANDIDATES * 2];

void main() {
    uint first = workgroup() * (WORKGROUP / LANES);
    uint pages = min(state.in_view, push.capacity);
    if (first >= pages) return;
    if (lane() < SEARCHES * CANDIDATES * 2) sums[lane()] = 0;
    read_rounds(push.round);
    uint number = first + lane() / LANES, candidate = lane() % LANES;
    if (number < pages && candidate < CANDIDATES) {
        PageInView seen_page = page_in_view_of(in_view[number]);
        PageErrors page = errors[seen_page.page];
        for (uint search = 0; search < SEARCHES; search++) {
            if ((push.searches & 1 << search) == 0) continue;
            uint tried = found_by(search) + (candidate + 1 << 3 * (ROUNDS - 1 - push.round));
            Remaining remaining = remaining_of(seen_page, page, limits_of(seen_page, limit_squared_of(tried)));
            uvec2 added = search == BY_NODES ? uvec2(nodes_of(remaining), 0)
                : error_in_units(squared_error_of(remaining, seen_page, page));
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
