#version 460
#define WORKGROUP_SIZE 128
#include "shared/workgroup.glsl"
#include "shared/ballot.glsl"
#include "fast/frame.glsl"
#include "shared/harmonics.glsl"
#include "shared/grids.glsl"
#include "shared/rotation.glsl"
// One workgroup per chunk of 384 Gaussians: projects those that can touch the image to splats, and finds the bins that
// each splat touches, as one span per row of bins.
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
layout(push_constant, scalar) uniform Push {
    View view;
    uint gaussians;
    uint visible_capacity;
    uint span_capacity;
    uint depth_limit;  // the largest depth key
    uint depth_shift;  // lowest bits that depth keys leave out
    uint block_height;  // px
} push;

#define LISTED (uvec2(BIN_COLUMNS, BIN_ROWS) * uvec2(BLOCK_WIDTH, push.block_height))
#include "shared/ellipse.glsl"
#include "fast/splat.glsl"
#include "shared/storage.glsl"
#include "shared/cull_test.glsl"
#include "shared/projection.glsl"
#include "shared/spans.glsl"

const bool SH_EARLY = SH_STORED_PLANES <= 3;
shared uint survivors[PROJECT_CHUNK];
shared float depths[PROJECT_CHUNK];  // of the survivors
shared uint found;
shared uint splats_here, spans_here;  // new ones of the workgroup's current batch
shared uvec2 first;                   // indices of the first of these splats and spans

void make_splat(uint gaussian, float z, bool exists) {
    vec3 mean = exists ? uintBitsToFloat(bounds[gaussian].xyz) : vec3(0.0);
    precise vec3 p = (mean - push.view.position_high) - push.view.position_low;
    Splat splat;
    Ellipse ellipse = EMPTY_ELLIPSE;
    // If there are few words, they are loaded before it is certain that they are needed: they arrive while the splat is
    // projected.
    uvec4 stored[SH_PLANES];
    if (SH_EARLY && exists) fetch_sh(gaussian, stored);
    if (exists) project(gaussian, p, z, splat, ellipse);
    uvec2 rows = tile_rows(ellipse, push.view.size_px);  // first, count

    uint row_spans = rows.y > 1 ? rows.y : 0;
    // Any order is right, here and below: lists are sorted later, and spans are found through their range.
    uvec4 ballot = subgroupBallot(rows.y > 0);
    uint index = subgroupBallotExclusiveBitCount(ballot), offset = subgroupExclusiveAdd(row_spans);
    uint all_spans = subgroupAdd(row_spans);
    uvec2 mine = uvec2(0);
    if (subgroupElect()) {
        mine.x = atomicAdd(splats_here, subgroupBallotBitCount(ballot));
        if (all_spans > 0) mine.y = atomicAdd(spans_here, all_spans);
    }
    mine = subgroupBroadcastFirst(mine);
    barrier();
    if (lane() == 0) {
        first = uvec2(atomicAdd(counters.visible, splats_here), 0);
        if (spans_here > 0) {
            first.y = atomicAdd(counters.spans, spans_here);
            if (first.y + spans_here < first.y) atomicAdd(counters.listed_high, 1);  // the frame is refused
        }
        splats_here = spans_here = 0;
    }
    barrier();
    index += first.x + mine.x;
    offset += first.y + mine.y;
    bool kept = rows.y > 0 && index < push.visible_capacity;
    bool fits = row_spans == 0 || offset <= push.span_capacity && row_spans <= push.span_capacity - offset;
    if (!kept || !fits) rows.y = 0;
    write_spans(ellipse, rows.y > 1 ? rows : uvec2(0), offset);
    if (!kept) return;
    gaussian_from_splat[index] = gaussian;
    uint place = rows.y == 1 ? tile_span(ellipse, rows.x, push.view.size_px) : offset;
    span_ranges[index] = uvec2(place, rows.x | rows.y << 16);
    float far = BY_DISTANCE ? distance_of(mean, push.view) : z;
    uint depth = floatBitsToUint(far) - floatBitsToUint(push.view.near);  // positive floats order like their bits
    depth_keys[index] = min(depth >> push.depth_shift, push.depth_limit);
    if (!SH_EARLY) fetch_sh(gaussian, stored);
    splat.colour = stored_colour(stored, direction(p));
    splats[index * SPLAT_WORDS] = first_element(splat);
    splats[index * SPLAT_WORDS + 1] = second_element(splat);
    if (!COMPACT) splats[index * SPLAT_WORDS + 2] = third_element(splat);
}

void main() {
    uint begin = workgroup() * PROJECT_CHUNK;
    if (begin >= push.gaussians) return;
    if (lane() == 0) found = splats_here = spans_here = 0;
    barrier();
    for (uint i = lane(); i < PROJECT_CHUNK; i += WORKGROUP) {
        uint gaussian = begin + i;
        float z = 0.0;
        bool visible = gaussian < push.gaussians && may_be_visible(bounds[gaussian], z);
        uvec4 ballot = subgroupBallot(visible);
        uint place = 0;
        if (subgroupElect()) place = atomicAdd(found, subgroupBallotBitCount(ballot));
        place = subgroupBroadcastFirst(place) + subgroupBallotExclusiveBitCount(ballot);
        if (visible) {
            survivors[place] = gaussian;
            depths[place] = z;
        }
    }
    barrier();
    for (uint i = 0; i < found; i += WORKGROUP) {
        bool exists = i + lane() < found;
        make_splat(exists ? survivors[i + lane()] : 0, exists ? depths[i + lane()] : push.view.near, exists);
    }
}
