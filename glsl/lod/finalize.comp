#version 460
#define WORKGROUP_SIZE 32
#include "shared/workgroup.glsl"
#include "shared/frame.glsl"
#include "pages/page.glsl"
#include "lod/selection.glsl"
// One invocation in all: sets the dispatch over the listed pages.
// Before: the pages are listed. After: the element before the first has their number, as pages/project.comp reads it.

layout(binding = 0, scalar) buffer State { CutState state; };
layout(binding = 1, scalar) writeonly buffer Listed { uvec4 listed[]; };       // [elements] behind the views, the pages
layout(push_constant, scalar) uniform Push {
    uint first_page;  // the element of `listed` with the first page
} push;

void main() {
    if (workgroup() > 0 || lane() > 0) return;
    listed[push.first_page - 1] = uvec4(state.listed, 0, 0, 0);
    state.over_pages = folded(QUARTERS * state.listed);
}
