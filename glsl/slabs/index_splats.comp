#version 460
#include "shared/workgroup.glsl"
#include "portable/frame.glsl"
#include "pages/page.glsl"
// One invocation per visible Gaussian of the draw list: writes its index, which orders splats of equal depth.
// Before: gaussian_from_splat from cull_compact. After: index_keys has the indices.

layout(binding = 0, scalar) readonly buffer TotalsBlock { Totals totals; };
layout(binding = 1, scalar) readonly buffer Ids { uint gaussian_from_splat[]; };   // [visible_capacity]
layout(binding = 2, scalar) readonly buffer DrawList { uvec4 draw_list[]; };                   // [elements]
layout(binding = 3, scalar) readonly buffer Indices { uint indices[]; };                    // [gaussians] at most
layout(binding = 4, scalar) writeonly buffer IndexKeys { uint index_keys[]; };              // [visible_capacity]
layout(push_constant, scalar) uniform Push {
    uint first_page;  // the element of `draw_list` with the first page
    uint gaussians;   // number of Gaussians of one placement, with nodes
} push;

PageDraw page;
#include "pages/gaussian_index.glsl"

void main() {
    uint splat = workgroup() * WORKGROUP + lane();
    if (splat >= totals.visible_kept) return;
    uint element = gaussian_from_splat[splat];
    page = page_of(draw_list[push.first_page + element / PAGE]);
    index_keys[splat] = index_of(page.slot * PAGE + element % PAGE);
}
