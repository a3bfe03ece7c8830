#version 460
#include "workgroup.glsl"
#include "frame.glsl"
#include "depth.glsl"
// One workgroup per chunk of 1024 Gaussians: which of them can touch the image?
// Before: nothing. After: visible_masks has a bit per Gaussian, chunk_counts the number of bits set in each chunk.
// The test is a bound: a Gaussian that touches a pixel centre is never dropped, some that do not are kept.

layout(binding = 0, scalar) readonly buffer Bounds { vec4 bounds[]; };                      // [gaussians] mean, reach
layout(binding = 1, scalar) writeonly buffer VisibleMasks { uint visible_masks[]; };        // [chunks * 32]
layout(binding = 2, scalar) writeonly buffer ChunkCounts { uint chunk_counts[]; };          // [chunks]
layout(push_constant, scalar) uniform Push {
    View view;
    uint gaussians;
} push;

const uint WORDS = CULL_CHUNK / 32;
shared uint words[WORDS];
shared uint count;

// `reach`: world units from the mean to where alpha falls to 1/255 along the longest axis; negative if it never reaches it.
// Bound on the half extent of the splat: rows of J W have length f/z * sqrt(1 + t^2), t the clamped slope
// (project.comp), and the low-pass adds LARGEST_EXTENT * sqrt(LOW_PASS) at most.
bool may_be_visible(vec3 mean, float reach) {
    precise vec3 p = (mean - push.view.position_high) - push.view.position_low;
    float z = depth_of(mean, push.view);
    if (!(reach >= 0.0 && z > push.view.near)) return false;
    vec2 slope = vec2(dot(push.view.right, p), dot(push.view.down, p)) / z;
    vec2 size = vec2(push.view.size_px);
    vec2 margin = 0.15 * size;
    vec2 low = (-push.view.centre_px - margin) / push.view.focal_px;
    vec2 high = (size - push.view.centre_px + margin) / push.view.focal_px;
    vec2 clamped = clamp(slope, low, high);
    vec2 extent = push.view.focal_px / z * sqrt(1.0 + clamped * clamped) * reach;
    extent += LARGEST_EXTENT * sqrt(LOW_PASS);
    vec2 mean_px = push.view.focal_px * slope + push.view.centre_px;
    vec2 slack = 1e-4 * (extent + abs(mean_px)) + 1.0;  // px, over the rounding of all of the above
    extent += slack;
    return all(greaterThanEqual(mean_px + extent, vec2(0.0))) && all(lessThanEqual(mean_px - extent, size));
}

void main() {
    uint chunk = workgroup();
    if (chunk * CULL_CHUNK >= push.gaussians) return;
    if (lane() < WORDS) words[lane()] = 0;
    if (lane() == 0) count = 0;
    barrier();
    for (uint i = lane(); i < CULL_CHUNK; i += WORKGROUP) {
        uint gaussian = chunk * CULL_CHUNK + i;
        bool visible = false;
        if (gaussian < push.gaussians) {
            vec4 bound = bounds[gaussian];
            visible = may_be_visible(bound.xyz, bound.w);
        }
        uvec4 ballot = subgroupBallot(visible);
        if (subgroupElect()) {
            // `i` is a multiple of the subgroup size here. Disjoint bits: order does not matter.
            uint first = i - gl_SubgroupInvocationID;
            for (uint w = 0; w * 32 < gl_SubgroupSize; w++) {
                atomicOr(words[first / 32 + w], ballot[w] << (first % 32));
            }
        }
    }
    barrier();
    if (lane() < WORDS) {
        visible_masks[chunk * WORDS + lane()] = words[lane()];
        atomicAdd(count, bitCount(words[lane()]));  // a sum of integers: order does not matter
    }
    barrier();
    if (lane() == 0) chunk_counts[chunk] = count;
}
