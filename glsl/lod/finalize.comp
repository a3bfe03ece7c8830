#version 460
#define WORKGROUP_SIZE 32
#include "shared/workgroup.glsl"
#include "shared/frame.glsl"
#include "pages/page.glsl"
#include "lod/selection.glsl"
// One invocation in total: sets the dispatch over the selected pages.
// Before: the draw list has the pages. After: the element before them has their number, for pages/project.comp.

layout(binding = 0, scalar) buffer State { SelectionState state; };
layout(binding = 1, scalar) writeonly buffer DrawList { uvec4 draw_list[]; };                // [elements]
layout(push_constant, scalar) uniform Push {
    uint first_page;  // the element of `draw_list` with the first page
} push;

void main() {
    if (workgroup() > 0 || lane() > 0) return;
    draw_list[push.first_page - 1] = uvec4(state.selected, 0, 0, 0);
    state.page_dispatch = folded(QUARTERS * state.selected);
}
