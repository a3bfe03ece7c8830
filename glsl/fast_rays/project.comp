#version 460
#define WORKGROUP_SIZE 128
#include "shared/workgroup.glsl"
#include "shared/ballot.glsl"
#include "fast_rays/frame.glsl"
#include "fast_rays/record.glsl"
#include "shared/harmonics.glsl"
#include "shared/grids.glsl"
#include "shared/rotation.glsl"
#include "shared/depth.glsl"
// One workgroup per chunk of 384 Gaussians, as fast/project.comp: projects those that rays may meet, and finds the bins
// of each splat, as one span per row of bins.
// Before: counters are 0. After: counters.visible and counters.spans are demands; the outputs of all splats that fit
// are set, in any order. Later stages order splats of equal depth by `gaussian_from_splat`.

layout(binding = 0, scalar) readonly buffer Bounds { uvec4 bounds[]; };                     // [gaussians] mean, reach
layout(binding = 1, scalar) readonly buffer GridsBlock { Grids grids; };
layout(binding = 2, scalar) readonly buffer Shapes { uvec4 plane[]; } shapes[2];            // [gaussians] at most each
layout(binding = 3, scalar) readonly buffer Sh { uvec4 plane[]; } sh[SH_PLANES];            // [gaussians] at most each
layout(binding = 4, scalar) writeonly buffer Ids { uint gaussian_from_splat[]; };           // [visible_capacity]
layout(binding = 5, scalar) writeonly buffer Splats { uvec4 splats[]; };             // [SPLAT_WORDS * visible_capacity]
layout(binding = 6, scalar) writeonly buffer DepthKeys { uint depth_keys[]; };              // [visible_capacity]
// span_ranges: (index of the first span, or the span itself if there is only one; first row | rows << 16).
layout(binding = 7, scalar) writeonly buffer SpanRanges { uvec2 span_ranges[]; };           // [visible_capacity]
layout(binding = 8, scalar) writeonly buffer Spans { uint spans[]; };                       // [span_capacity]
layout(binding = 9, scalar) buffer CountersBlock { FastCounters counters; };
layout(binding = 10, scalar) readonly buffer LensTable { uvec4 lens_table[]; };             // fast_rays/frame.glsl
layout(binding = 11, scalar) readonly buffer Footprints { vec3 footprints[]; };             // [(FOOTPRINTS + 1)^2]
layout(binding = 12, scalar) readonly buffer Cells { uvec4 cells[]; };       // [6 * CELLS^2 * CELL_ELEMENTS], or none
layout(push_constant, scalar) uniform Push {
    View view;
    uint gaussians;
    uint visible_capacity;
    uint span_capacity;
    uint depth_limit;  // the largest depth key
    uint depth_shift;  // lowest bits that depth keys leave out
    uint block_height;  // px
} push;

#define RAYS
#define INDEX_OF(gaussian) (gaussian)
#define IN_WORLD(depth) (depth)
#define NEAR push.view.near
#include "fast/make_splat.glsl"
#include "fast/project_chunk.glsl"
