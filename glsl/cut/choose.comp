#version 460
#include "shared/workgroup.glsl"
#include "shared/frame.glsl"
#include "slabs/slab.glsl"
#include "cut/cut.glsl"
// One invocation per page in view: lists it if some of its nodes are drawn.
// Before: `seen` from look, the sums of all rounds. After: the pages of the cut are listed in any order, and counted.

layout(binding = 0, scalar) readonly buffer Errors { PageErrors errors[]; };                // [pages]
layout(binding = 1, scalar) readonly buffer Steps { uint steps[]; };                        // [256]
layout(binding = 2, scalar) readonly buffer Seen { uvec4 seen[]; };                         // [room]
layout(binding = 3, scalar) buffer State { CutState state; };
layout(binding = 4, scalar) readonly buffer Slots { uint slots[]; };                        // [pages]
layout(binding = 5, scalar) writeonly buffer Listed { uvec4 listed[]; };       // [elements] behind the views, the pages
layout(binding = 6, scalar) writeonly buffer Pages { uint pages[]; };                       // [room]
layout(push_constant, scalar) uniform Push {
    float given_squared;
    uint searches;
    uvec2 most_nodes;
    uvec2 most_energy;
    uint pixels;
    uint room;        // in `seen`
    uint first_page;  // the element of `listed` with the first page
} push;

#include "cut/search.glsl"

// Adds a number to two words. Sums are of whole numbers: order does not matter.
#define ADD(words, number) { \
    uint before = atomicAdd(words[0], number.x); \
    uint more = number.y + uint(before + number.x < before); \
    if (more > 0) atomicAdd(words[1], more); \
}

void main() {
    uint first = workgroup() * WORKGROUP;
    uint pages_seen = min(state.seen, push.room);
    if (first >= pages_seen) return;
    read_rounds(ROUNDS);
    float limit_squared = limit_found();
    if (first + lane() == 0) state.limit_squared = floatBitsToUint(limit_squared);
    if (first + lane() >= pages_seen) return;
    SeenPage place = seen_page_of(seen[first + lane()]);
    PageErrors page = errors[place.page];
    Left left = left_of(place, page, limit_squared);
    if (!is_in_cut(page, left.limits)) return;
    uint slot = slots[place.page], listed_before = atomicAdd(state.listed, 1);
    if (slot == NO_SLOT) atomicAdd(state.missing, 1);
    uint filled = slot == NO_SLOT ? 0 : page.count, limits = left.limits.x | left.limits.y << 16;
    listed[push.first_page + listed_before] = uvec4(slot, limits, place.view, filled | HAS_INDICES);
    pages[listed_before] = place.page;
    ADD(state.nodes, uvec2(nodes_of(left), 0));
    ADD(state.energy, in_units(energy_of(left, place, page)));
}
