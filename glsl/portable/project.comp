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

#include "shared/storage.glsl"
#include "shared/projection.glsl"
#include "shared/spans.glsl"

shared uint first_span;

void main() {
    uint index = workgroup() * WORKGROUP + lane();
    bool exists = index < totals.visible_kept;
    uint gaussian = exists ? gaussian_from_splat[index] : 0;
    vec3 mean = exists ? uintBitsToFloat(bounds[gaussian].xyz) : vec3(0.0);
    precise vec3 p = (mean - push.view.position_high) - push.view.position_low;

    Splat splat;
    Ellipse ellipse = EMPTY_ELLIPSE;
    float z = max(depth_of(mean, push.view), push.view.near);
    if (exists) project(gaussian, p, z, splat, ellipse);
    uvec2 rows = tile_rows(ellipse, push.view.size_px);  // first, count

    uint total;
    uint offset = workgroup_exclusive_add(rows.y, total);
    if (lane() == 0) {
        first_span = atomicAdd(totals.spans, total);  // any order is right: spans are found through their range
        // More than 2^32 spans have at least as many instances, so the frame is refused in the same way.
        if (first_span + total < first_span) atomicAdd(totals.listed_high, 1);
    }
    barrier();
    offset += first_span;
    bool fits = offset <= push.span_capacity && rows.y <= push.span_capacity - offset;
    if (!fits) rows.y = 0;

    uint tiles = write_spans(ellipse, rows, offset);
    workgroup_exclusive_add(tiles, total);
    if (lane() == 0) {
        uint before = atomicAdd(totals.listed_low, total);  // a sum of integers: order does not matter
        if (before + total < before) atomicAdd(totals.listed_high, 1);
    }
    if (!exists) return;
    span_ranges[index] = tiles == 0 ? uvec2(0) : uvec2(offset, rows.x | rows.y << 16);
    tile_counts[index] = tiles;
    float far = BY_DISTANCE && tiles > 0 ? distance_of(mean, push.view) : z;
    uint depth = floatBitsToUint(far) - floatBitsToUint(push.view.near);  // positive floats order like their bits
    depth_keys[index] = tiles == 0 ? push.depth_limit : min(depth >> push.depth_shift, push.depth_limit - 1);
    if (tiles > 0) {
        uvec4 stored[SH_PLANES];
        fetch_sh(gaussian, stored);
        splat.colour = stored_colour(stored, direction(p));
        splats[index] = splat;
    }
}
