#version 460
#include "shared/workgroup.glsl"
#include "shared/ballot.glsl"
#include "portable/frame.glsl"
#include "shared/depth.glsl"
#include "shared/harmonics.glsl"
const uvec2 LISTED = uvec2(TILE, TILE);
#include "shared/ellipse.glsl"
#include "shared/grids.glsl"
#include "shared/rotation.glsl"
// One invocation per visible Gaussian: computes its splat, its depth key, and the tiles it touches, as one span per
// tile row.
// Before: gaussian_from_splat from cull_compact; totals.spans and the instance demand are 0.
// After: all [visible_kept] outputs are set. A splat without a tile has an empty span range and the largest depth key.
// duplicate writes exactly the tiles of these spans: no later stage decides a tile hit again.

layout(binding = 0, scalar) readonly buffer Ids { uint gaussian_from_splat[]; };            // [visible_capacity]
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
layout(push_constant, scalar) uniform Push {
    View view;
    uint span_capacity;
    uint depth_limit;  // the largest depth key, for splats without tiles
    uint depth_shift;  // lowest bits that depth keys leave out
} push;

#define FIND(visible) (visible)
#define IN_WORLD(depth) (depth)
#define NEAR push.view.near
#include "portable/make_splat.glsl"
