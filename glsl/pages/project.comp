#version 460
#define WORKGROUP_SIZE 128
#define VIEW current_view
#include "shared/workgroup.glsl"
#include "shared/ballot.glsl"
#include "fast/frame.glsl"
#include "pages/page.glsl"
#include "slabs/slab.glsl"
#include "shared/error_code.glsl"
#include "lod/page_attributes.glsl"
#include "inspect/codes.glsl"
#include "shared/harmonics.glsl"
#include "shared/grids.glsl"
#include "shared/rotation.glsl"
// One workgroup per quarter of a page of the draw list: projects its Gaussians that may touch the image and are in the
// slab, as fast/project.comp.
// Before: counters as the previous dispatch of the frame wrote them, 0 at first. After: as fast/project.comp.

layout(binding = 0, scalar) readonly buffer Bounds { uvec4 bounds[]; };                     // [gaussians] mean, reach
layout(binding = 1, scalar) readonly buffer GridsBlock { Grids grids; };
layout(binding = 2, scalar) readonly buffer Shapes { uvec4 plane[]; } shapes[2];            // [gaussians] at most each
layout(binding = 3, scalar) readonly buffer Sh { uvec4 plane[]; } sh[SH_PLANES];            // [gaussians] at most each
layout(binding = 4, scalar) writeonly buffer Ids { uint gaussian_from_splat[]; };           // [visible_capacity]
layout(binding = 5, scalar) writeonly buffer Splats { uvec4 splats[]; };             // [SPLAT_WORDS * visible_capacity]
layout(binding = 6, scalar) writeonly buffer DepthKeys { uint depth_keys[]; };              // [visible_capacity]
layout(binding = 7, scalar) writeonly buffer SpanRanges { uvec2 span_ranges[]; };           // [visible_capacity]
layout(binding = 8, scalar) writeonly buffer Spans { uint spans[]; };                       // [span_capacity]
layout(binding = 9, scalar) buffer CountersBlock { FastCounters counters; };
// The placed views, the number of pages, the pages.
layout(binding = 10, scalar) readonly buffer DrawList { uvec4 draw_list[]; };                  // [elements]
layout(binding = 11, scalar) readonly buffer Indices { uint indices[]; };                   // [gaussians] at most
layout(binding = 12, scalar) readonly buffer Levels { uint levels[]; };                     // [2 * gaussians] at most
layout(constant_id = 9) const uint ATTRIBUTE = NO_ATTRIBUTE;

layout(push_constant, scalar) uniform Push {
    Slab slab;
    vec2 focal_px;
    vec2 centre_px;
    uvec2 size_px;
    uint band;  // rows that are drawn: View.band
    float near;        // world units
    uint first_page;   // the element of `draw_list` with the first page; the element before it has the number of pages
    uint visible_capacity;
    uint span_capacity;
    uint depth_limit;  // the largest depth key
    uint depth_shift;  // lowest bits that depth keys leave out
    uint block_height;  // px
    uint gaussians;    // number of Gaussians of one placement, with nodes
    vec3 right;        // the axes of the camera in the world
    vec3 down;
    vec3 forward;
} push;

#include "pages/current_page.glsl"
#include "pages/gaussian_index.glsl"
#define INDEX_OF(gaussian) index_of(gaussian)
#include "lod/nodes.glsl"
#define OPACITIES_OF(gaussian) opacities_of_node(gaussian)

// Number of levels by which a node is coarser than selected, because finer pages are missing: the octaves of its error
// above the selected limit, since errors double from level to level.
float lag_of_node(uint gaussian) {
    float codes = float(levels[2 * gaussian] & 0xffff) - float(page.error_limits & 0xffff);
    return clamp(codes / float(CODES_PER_OCTAVE) + lag_of(page), 0.0, float(level_of(page)));
}

#define ATTRIBUTES
#define VIEW_AXES mat3(current_view.right, current_view.down, current_view.forward)
#define IN_WORLD_AXES(v) (mat3(push.right, push.down, push.forward) * ((v) * VIEW_AXES))
#define LEVEL float(level_of(page))
#define LAG(gaussian) lag_of_node(gaussian)
#define SQUARED_ERROR squared_error_of(page)
#include "fast/make_splat.glsl"

const uint QUARTER = PAGE / QUARTERS;

void main() {
    if (workgroup() >= QUARTERS * draw_list[push.first_page - 1].x) return;
    set_current_page(workgroup() / QUARTERS);
    uint begin = workgroup() % QUARTERS * QUARTER, end = min(begin + QUARTER, page.count);
    if (begin >= end) return;
    if (lane() == 0) found = splats_here = spans_here = 0;
    barrier();
    for (uint i = begin + lane(); i < begin + QUARTER; i += WORKGROUP) {
        uint gaussian = page.slot * PAGE + i;
        float z = 0.0;
        bool visible = i < end && is_in_cut(gaussian) && may_be_visible(bounds[gaussian], z);
        if (visible) {
            vec3 mean = uintBitsToFloat(bounds[gaussian].xyz);
            visible = is_in(push.slab, uvec2(depth_key(mean, z), index_of(gaussian)));
        }
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
        make_splat(exists ? survivors[i + lane()] : 0, exists ? depths[i + lane()] : VIEW.near, exists);
    }
}
