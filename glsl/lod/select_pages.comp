#version 460
#include "shared/workgroup.glsl"
#include "shared/frame.glsl"
#include "pages/page.glsl"
#include "lod/selection.glsl"
#include "shared/error_code.glsl"
#include "lod/page_attributes.glsl"
// One invocation per page in view: lists it if some of its nodes are drawn. Where pages are demanded, it also notes
// that the page is wanted, and how much.
// Before: `seen` from look, the sums of all rounds. After: the pages of the cut are listed in any order, and counted;
// `demand` has those that are wanted and drawn coarser, in any order.

layout(binding = 0, scalar) readonly buffer Errors { PageErrors errors[]; };                // [pages]
layout(binding = 1, scalar) readonly buffer Steps { uint steps[]; };                        // [256]
layout(binding = 2, scalar) readonly buffer Seen { uvec4 seen[]; };                         // [room]
layout(binding = 3, scalar) buffer State { CutState state; };
layout(binding = 4, scalar) readonly buffer Slots { uint slots[]; };                        // [pages]
layout(binding = 5, scalar) writeonly buffer Listed { uvec4 listed[]; };       // [elements] behind the views, the pages
layout(binding = 6, scalar) writeonly buffer Pages { uint pages[]; };                       // [room]
layout(binding = 7, scalar) readonly buffer Floors { uint floors[]; };  // [pages] the least limits, as those of a page
layout(binding = 8, scalar) buffer Wanted { uint wanted[]; };  // [pages] when, and how much each was wanted last
layout(binding = 9, scalar) writeonly buffer Demand { uvec2 demand[]; };  // [demand_room] page; priority, limit
layout(push_constant, scalar) uniform Push {
    float given_squared;
    uint searches;
    uvec2 most_nodes;
    uvec2 most_energy;
    uint pixels;
    uint room;        // in `seen`
    uint first_page;  // the element of `listed` with the first page
    uint stamp;  // of the picture, 1 to 65535, or 0 where no pages are demanded
    uint demand_room;
    uint least_priority;  // of the pages in `demand`
    uint fade;  // codes above a limit over which nodes fade
    uint later;  // codes by which pages matter less, as they are wanted later
} push;

#include "lod/limit.glsl"

// Adds a number to two words. Sums are of whole numbers: order does not matter.
#define ADD(words, number) { \
    uint before = atomicAdd(words[0], number.x); \
    uint more = number.y + uint(before + number.x < before); \
    if (more > 0) atomicAdd(words[1], more); \
}

// Notes a page whose nodes, or finer ones, are wanted: `limit` is that of their parents. Its priority says by how many
// steps of codes the error of what is drawn in the place of its nodes is above the width of a pixel: no page has a
// higher one than that of its parents. A page that is there lacks others if their floor keeps its nodes away.
void demand_page(uint number, uint coarsest, float width_squared, uint limit, bool lacks_some) {
    int errors_seen = int(coarsest) - int(code_below(width_squared)) - int(push.later);
    uint priority = uint(clamp(errors_seen + 32768, 0, 65535));
    // The highest priority, and the number of pages: order does not matter.
    atomicMax(wanted[number], push.stamp << 16 | priority);
    if (!lacks_some) return;
    atomicAdd(state.missing, 1);
    if (priority < push.least_priority) return;
    uint place = atomicAdd(state.demanded, 1);
    if (place < push.demand_room) demand[place] = uvec2(number, priority | limit << 16);
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
    uvec2 limits = limits_of(place, limit_squared);
    uint slot = slots[place.page], coarsest = CODE(page.parents, PARTS - 1);
    uvec2 floors_here = uvec2(floors[place.page] & 65535, floors[place.page] >> 16);
    if (push.stamp > 0 && coarsest > limits.y) {
        bool lacks_some = slot == NO_SLOT || floors_here.y > limits.y;
        demand_page(place.page, coarsest, place.widths.y, limits.y, lacks_some);
    }
    uvec2 asked = limits;
    limits = max(limits, floors_here);
    if (!is_in_cut(page, limits)) return;
    uint listed_before = atomicAdd(state.listed, 1);
    if (push.stamp == 0 && slot == NO_SLOT) atomicAdd(state.missing, 1);
    Left left = left_of(place, page, limits);
    float lag = float(limits.x - asked.x) / float(CODES_PER_OCTAVE);
    uint notes = notes_of(page.level, lag, energy_of_node(left, place, page));
    uint last = (slot == NO_SLOT ? 0 : page.count) | notes << COUNT_BITS | HAS_INDICES;
    listed[push.first_page + listed_before] = uvec4(slot, limits.x | limits.y << 16, place.view, last);
    pages[listed_before] = place.page;
    ADD(state.nodes, uvec2(nodes_of(left), 0));
    ADD(state.energy, in_units(energy_of(left, place, page)));
}
