#version 460
#define VIEW current_view
#include "shared/workgroup.glsl"
#include "portable/frame.glsl"
#include "pages/page.glsl"
#include "slabs/slab.glsl"
#include "shared/error_code.glsl"
// One workgroup per page of the draw list: marks its Gaussians that may touch the image and are in the slab, as
// portable/cull.comp for a chunk of 1024 Gaussians.
// Before: the draw list has the pages and their views. After: visible_masks and chunk_counts as after cull.

layout(binding = 0, scalar) readonly buffer Bounds { uvec4 bounds[]; };                     // [gaussians] mean, reach
layout(binding = 1, scalar) writeonly buffer VisibleMasks { uint visible_masks[]; };        // [pages * 32]
layout(binding = 2, scalar) writeonly buffer ChunkCounts { uint chunk_counts[]; };          // [pages]
layout(binding = 3, scalar) readonly buffer DrawList { uvec4 draw_list[]; };                   // [elements]
layout(binding = 4, scalar) readonly buffer Indices { uint indices[]; };                    // [gaussians] at most
layout(binding = 5, scalar) readonly buffer Levels { uint levels[]; };                      // [2 * gaussians] at most
layout(push_constant, scalar) uniform Push {
    Slab slab;
    vec2 focal_px;
    vec2 centre_px;
    uvec2 size_px;
    uint band;  // rows that are drawn: View.band
    float near;        // world units
    uint first_page;   // the element of `draw_list` with the first page
    uint pages;
    uint depth_limit;  // the largest depth key of a splat with tiles
    uint depth_shift;  // lowest bits that depth keys leave out
    uint gaussians;    // number of Gaussians of one placement, with nodes
} push;

#include "pages/current_page.glsl"
#include "pages/gaussian_index.glsl"
#include "lod/nodes.glsl"
#include "shared/marks.glsl"
#include "shared/cull_test.glsl"
#include "shared/depth_key.glsl"

const uint WORDS = PAGE / 32;
shared uint words[WORDS];
shared uint count;

void main() {
    if (workgroup() >= push.pages) return;
    set_current_page(workgroup());
    if (lane() < WORDS) words[lane()] = 0;
    if (lane() == 0) count = 0;
    barrier();
    for (uint i = lane(); i < PAGE; i += WORKGROUP) {
        uint gaussian = page.slot * PAGE + i;
        float z = 0.0;
        bool visible = i < page.count && is_in_cut(gaussian) && may_be_visible(bounds[gaussian], z);
        if (visible) {
            vec3 mean = uintBitsToFloat(bounds[gaussian].xyz);
            visible = is_in(push.slab, uvec2(depth_key(mean, z), index_of(gaussian)));
        }
        uvec4 ballot = subgroupBallot(visible);
        if (subgroupElect()) {
            // `first` is a multiple of the subgroup size. The bits are disjoint: order does not matter.
            uint first = i - gl_SubgroupInvocationID;
            for (uint w = 0; w * 32 < gl_SubgroupSize; w++) {
                atomicOr(words[first / 32 + w], ballot[w] << (first % 32));
            }
        }
    }
    barrier();
    if (lane() < WORDS) {
        visible_masks[workgroup() * WORDS + lane()] = words[lane()];
        atomicAdd(count, bitCount(words[lane()]));  // a sum of integers: order does not matter
    }
    barrier();
    if (lane() == 0) chunk_counts[workgroup()] = count;
}
