#version 460
#include "shared/workgroup.glsl"
#include "shared/frame.glsl"
#include "pages/page.glsl"
#include "lod/selection.glsl"
#include "shared/error_code.glsl"
#include "lod/page_attributes.glsl"
// One invocation per page in view: selects it if some of its nodes are drawn. In streamed frames, it also records the
// use of the page and its priority, and requests the page if it is missing.
// Before: `in_view` from cull_pages, the sums of all rounds. After: the draw list has the selected pages in any order,
// and the state their number; `requests` has the needed pages that are drawn coarser, in any order.

layout(binding = 0, scalar) readonly buffer Errors { PageErrors errors[]; };                // [pages]
layout(binding = 1, scalar) readonly buffer Steps { uint steps[]; };                        // [256]
layout(binding = 2, scalar) readonly buffer InView { uvec4 in_view[]; };                    // [capacity]
layout(binding = 3, scalar) buffer State { SelectionState state; };
layout(binding = 4, scalar) readonly buffer Slots { uint slots[]; };                        // [pages]
layout(binding = 5, scalar) writeonly buffer DrawList { uvec4 draw_list[]; };                // [elements]
layout(binding = 6, scalar) writeonly buffer PageNumbers { uint page_numbers[]; };          // [capacity]
layout(binding = 7, scalar) readonly buffer FallbackLimits { uint fallback_limits[]; };  // [pages]
layout(binding = 8, scalar) buffer LastUsed { uint last_used[]; };  // [pages] priority, stamp << 16
layout(binding = 9, scalar) writeonly buffer Requests { uvec2 requests[]; };  // [max_requests] page; priority, limit
layout(push_constant, scalar) uniform Push {
    float given_squared;
    uint searches;
    uvec2 max_nodes;
    uvec2 max_error;
    uint pixels;
    uint capacity;    // of `in_view`
    uint first_page;  // the element of `draw_list` with the first page
    uint stamp;       // of a streamed frame, 1 to 65535; otherwise 0, and no page is requested
    uint max_requests;
    uint min_priority;  // of requests
    uint fade;        // codes above a limit over which nodes fade
    uint priority_penalty;  // subtracted from priorities, in codes: for prefetching
} push;

#include "lod/limit.glsl"

// Adds a number of 64 bits to a sum in two words. Sums are of whole numbers: order does not matter.
#define ADD(words, number) { \
    uint before = atomicAdd(words[0], number.x); \
    uint more = number.y + uint(before + number.x < before); \
    if (more > 0) atomicAdd(words[1], more); \
}

// Records the use of a page whose nodes, or finer ones, the selection needs, and requests it if `is_coarser`: if it is
// drawn coarser than selected. Its priority is the number of codes from the width of a pixel to the largest error of
// its parents, which are drawn instead. It is at most the priority of the parents' page. `limit`: of the parents.
void use_page(uint number, uint parent_error, float width_squared, uint limit, bool is_coarser) {
    int visible_error = int(parent_error) - int(code_below(width_squared)) - int(push.priority_penalty);
    uint priority = uint(clamp(visible_error + 32768, 0, 65535));
    // A maximum, and the number of pages: order does not matter.
    atomicMax(last_used[number], push.stamp << 16 | priority);
    if (!is_coarser) return;
    atomicAdd(state.missing, 1);
    if (priority < push.min_priority) return;
    uint position = atomicAdd(state.requested, 1);
    if (position < push.max_requests) requests[position] = uvec2(number, priority | limit << 16);
}

void main() {
    uint first = workgroup() * WORKGROUP;
    uint pages_seen = min(state.in_view, push.capacity);
    if (first >= pages_seen) return;
    read_rounds(ROUNDS);
    float limit_squared = limit_found();
    if (first + lane() == 0) state.limit_squared = floatBitsToUint(limit_squared);
    if (first + lane() >= pages_seen) return;
    PageInView seen_page = page_in_view_of(in_view[first + lane()]);
    uint number = seen_page.page;
    PageErrors page = errors[number];
    uvec2 selected_limits = limits_of(seen_page, limit_squared);
    uint slot = slots[number], parent_error = CODE(page.parent_errors, PARTS - 1);
    uvec2 fallback = uvec2(fallback_limits[number] & 65535, fallback_limits[number] >> 16);
    if (push.stamp > 0 && seen_page.is_drawn && parent_error > selected_limits.y) {
        bool is_coarser = slot == NO_SLOT || fallback.y > selected_limits.y;
        use_page(number, parent_error, seen_page.widths.y, selected_limits.y, is_coarser);
    }
    // Clamps the level where finer pages are missing.
    uvec2 limits = max(selected_limits, fallback);
    if (!is_in_cut(page, limits)) return;
    Remaining remaining = remaining_of(seen_page, page, limits);
    // The counts are of the whole picture, also where a band of it is drawn.
    ADD(state.nodes, uvec2(nodes_of(remaining), 0));
    ADD(state.squared_error, error_in_units(squared_error_of(remaining, seen_page, page)));
    if (!seen_page.is_drawn) return;
    uint position = atomicAdd(state.selected, 1);
    if (push.stamp == 0 && slot == NO_SLOT) atomicAdd(state.missing, 1);
    float lag = float(limits.x - selected_limits.x) / float(CODES_PER_OCTAVE);
    uint attributes = packed_attributes(page.level, lag, squared_error_of_node(remaining, seen_page, page));
    uint last = (slot == NO_SLOT ? 0 : page.count) | attributes << COUNT_BITS | HAS_INDICES;
    draw_list[push.first_page + position] = uvec4(slot, limits.x | limits.y << 16, seen_page.view, last);
    page_numbers[position] = number;
}
