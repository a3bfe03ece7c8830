#version 460
#include "workgroup.glsl"
#include "frame.glsl"
#include "depth.glsl"
// One workgroup per chunk of 1024 Gaussians: which of them can touch the image?
// Before: nothing. After: visible_masks has a bit per Gaussian, chunk_counts the number of bits set in each chunk.
// The test is a bound: a Gaussian that touches a pixel centre is never dropped, some that do not are kept.

layout(binding = 0, scalar) readonly buffer Bounds { uvec4 bounds[]; };                     // [gaussians] mean, reach
layout(binding = 1, scalar) writeonly buffer VisibleMasks { uint visible_masks[]; };        // [chunks * 32]
layout(binding = 2, scalar) writeonly buffer ChunkCounts { uint chunk_counts[]; };          // [chunks]
layout(push_constant, scalar) uniform Push {
    View view;
    uint gaussians;
} push;

const uint WORDS = CULL_CHUNK / 32;
shared uint words[WORDS];
shared uint count;

// `bound`: the mean, and two bfloat16: how many standard deviations from the mean alpha falls to ALPHA_MIN, and above
// it the same in world units along the longest axis, negative if alpha starts lower.
// Bound on the half extent of the splat: rows of J W have length f/z * sqrt(1 + t^2), t the clamped slope
// (project.comp), and the low-pass adds deviations * sqrt(LOW_PASS) at most.
bool may_be_visible(uvec4 bound) {
    vec3 mean = uintBitsToFloat(bound.xyz);
    float reach = uintBitsToFloat(bound.w & 0xffff0000), deviations = uintBitsToFloat(bound.w << 16);
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
    extent += deviations * sqrt(LOW_PASS);
    vec2 mean_px = push.view.focal_px * slope + push.view.centre_px;
    // px, over the rounding of all of the above; the first term is that of the view transform.
    vec2 slack = 1e-6 * push.view.focal_px * sqrt(1.0 + dot(slope, slope)) + 1e-5 * (extent + abs(mean_px)) + 0.01;
    vec2 from = mean_px - extent - slack, to = mean_px + extent + slack;
    // On the image, and not between pixel centres, as the many splats are whose opacity is hardly more than ALPHA_MIN.
    return all(greaterThanEqual(to, vec2(0.0))) && all(lessThanEqual(from, size))
        && all(lessThanEqual(ceil(from - 0.5), floor(to - 0.5)));
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
            visible = may_be_visible(bounds[gaussian]);
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
