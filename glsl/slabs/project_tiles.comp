#version 460
#define VIEW current_view
#include "shared/workgroup.glsl"
#include "shared/ballot.glsl"
#include "portable/frame.glsl"
#include "pages/page.glsl"
#include "shared/error_code.glsl"
#include "shared/depth.glsl"
#include "shared/harmonics.glsl"
const uvec2 LISTED = uvec2(TILE, TILE);
#include "shared/ellipse.glsl"
#include "shared/grids.glsl"
#include "shared/rotation.glsl"
// One invocation per visible Gaussian of the draw list: projects it as portable/project.comp.
// Before: gaussian_from_splat has elements of the draw list (pages/current_page.glsl). After: as portable/project.comp.

layout(binding = 0, scalar) readonly buffer Ids { uint gaussian_from_splat[]; };   // [visible_capacity]
layout(binding = 1, scalar) readonly buffer Bounds { uvec4 bounds[]; };                     // [gaussians] mean, reach
layout(binding = 2, scalar) readonly buffer GridsBlock { Grids grids; };
layout(binding = 3, scalar) readonly buffer Shapes { uvec4 plane[]; } shapes[2];            // [gaussians] at most each
layout(binding = 4, scalar) readonly buffer Sh { uvec4 plane[]; } sh[SH_PLANES];            // [gaussians] at most each
layout(binding = 5, scalar) writeonly buffer Splats { Splat splats[]; };                    // [visible_capacity]
layout(binding = 6, scalar) writeonly buffer DepthKeys { uint depth_keys[]; };              // [visible_capacity]
// span_ranges: (first span, first row | rows << 16).
layout(binding = 7, scalar) writeonly buffer SpanRanges { uvec2 span_ranges[]; };           // [visible_capacity]
layout(binding = 8, scalar) writeonly buffer TileCounts { uint tile_counts[]; };            // [visible_capacity]
layout(binding = 9, scalar) writeonly buffer Spans { uint spans[]; };                       // [span_capacity]
layout(binding = 10, scalar) buffer TotalsBlock { Totals totals; };
layout(binding = 11, scalar) readonly buffer DrawList { uvec4 draw_list[]; };                  // [elements]
layout(binding = 12, scalar) readonly buffer Levels { uint levels[]; };                     // [2 * gaussians] at most
layout(push_constant, scalar) uniform Push {
    vec2 focal_px;
    vec2 centre_px;
    uvec2 size_px;
    uint band;  // rows that are drawn: View.band
    float near;        // world units
    uint first_page;   // the element of `draw_list` with the first page
    uint span_capacity;
    uint depth_limit;  // the largest depth key, for splats without tiles
    uint depth_shift;  // lowest bits that depth keys leave out
} push;

#include "pages/current_page.glsl"
#include "lod/nodes.glsl"
#define OPACITIES_OF(gaussian) opacities_of_node(gaussian)
#define FIND(visible) gaussian_of_element(visible)
#include "portable/make_splat.glsl"
