#version 460
#define VIEW current_view
#include "shared/workgroup.glsl"
#include "portable/frame.glsl"
#include "pages/page.glsl"
#include "shared/depth.glsl"
// One invocation per visible Gaussian of the draw list: writes its view depth as the colour of its splat, as
// inspect/shade_attribute.comp.
// Before: splats from project_tiles. After: the colour of each splat is its depth in world units.

layout(binding = 0, scalar) readonly buffer TotalsBlock { Totals totals; };
layout(binding = 1, scalar) readonly buffer Ids { uint gaussian_from_splat[]; };   // [visible_capacity]
layout(binding = 2, scalar) readonly buffer Bounds { uvec4 bounds[]; };                     // [gaussians] mean, reach
layout(binding = 3, scalar) readonly buffer DrawList { uvec4 draw_list[]; };                   // [elements]
layout(binding = 4, scalar) writeonly buffer Splats { Splat splats[]; };                    // [visible_capacity]
layout(push_constant, scalar) uniform Push {
    vec2 focal_px;
    vec2 centre_px;
    uvec2 size_px;
    uint band;  // rows that are drawn: View.band
    uint first_page;  // the element of `draw_list` with the first page
} push;

#include "pages/current_page.glsl"

void main() {
    uint splat = workgroup() * WORKGROUP + lane();
    if (splat >= totals.visible_kept) return;
    uint gaussian = gaussian_of_element(gaussian_from_splat[splat]);
    splats[splat].colour = vec3(IN_WORLD(depth_of(uintBitsToFloat(bounds[gaussian].xyz), current_view)));
}
