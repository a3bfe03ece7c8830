#version 460
#include "shared/workgroup.glsl"
#include "cut/cut.glsl"
// One invocation per page in view: what the candidates of one round leave of it.
// Before: `seen` from look, the sums of the rounds before. After: the sums of this round.

layout(binding = 0, scalar) readonly buffer Errors { PageErrors errors[]; };                // [pages]
layout(binding = 1, scalar) readonly buffer Steps { uint steps[]; };                        // [256]
layout(binding = 2, scalar) readonly buffer Seen { uvec4 seen[]; };                         // [pages * views]
layout(binding = 3, scalar) buffer State { CutState state; };
layout(push_constant, scalar) uniform Push {
    float given_squared;
    uint searches;
    uvec2 most_nodes;
    uvec2 most_energy;
    uint pixels;
    uint round;
} push;

#include "cut/search.glsl"

shared uint begins[SEARCHES];
shared uint sums[SEARCHES * CANDIDATES * 2];

// Adds a number to one of two words.
void add(uint place, uvec2 number) {
    // Sums are of whole numbers: order does not matter.
    uint before = atomicAdd(sums[place], number.x);
    uint carry = uint(before + number.x < before);
    if (number.y + carry > 0) atomicAdd(sums[place + 1], number.y + carry);
}

void main() {
    uint first = workgroup() * WORKGROUP;
    if (first >= state.seen) return;
    if (lane() < SEARCHES) begins[lane()] = found_before(lane(), push.round);
    if (lane() < SEARCHES * CANDIDATES * 2) sums[lane()] = 0;
    barrier();
    bool exists = first + lane() < state.seen;
    SeenPage page = seen_page_of(seen[exists ? first + lane() : 0]);
    for (uint search = 0; search < SEARCHES; search++) {
        if ((push.searches & 1 << search) == 0) continue;
        for (uint candidate = 0; candidate < CANDIDATES && exists; candidate++) {
            uint number = begins[search] + (candidate + 1 << 3 * (ROUNDS - 1 - push.round));
            Left left = left_of(page, limit_squared_of(number));
            uvec2 added = search == BY_NODES ? uvec2(left.nodes, 0) : in_units(left.energy);
            if (any(notEqual(added, uvec2(0)))) add((search * CANDIDATES + candidate) * 2, added);
        }
    }
    barrier();
    if (lane() < SEARCHES * CANDIDATES) {
        uint search = lane() / CANDIDATES, candidate = lane() % CANDIDATES;
        uint place = ((search * ROUNDS + push.round) * CANDIDATES + candidate) * 2;
        uint low = sums[2 * lane()], before = atomicAdd(state.sums[place], low);
        uint high = sums[2 * lane() + 1] + uint(before + low < before);
        if (high > 0) atomicAdd(state.sums[place + 1], high);
    }
}
