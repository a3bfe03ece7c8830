#version 460
#include "shared/workgroup.glsl"
#include "portable/frame.glsl"
// One workgroup per chunk of 1024 Gaussians: marks those that may touch the image.
// Before: nothing. After: visible_masks has a bit per Gaussian, chunk_counts the number of bits set in each chunk.
// The test is a bound: a Gaussian that touches a pixel centre is never dropped, some that do not are kept.

layout(binding = 0, scalar) readonly buffer Bounds { uvec4 bounds[]; };                     // [gaussians] mean, reach
layout(binding = 1, scalar) writeonly buffer VisibleMasks { uint visible_masks[]; };        // [chunks * 32]
layout(binding = 2, scalar) writeonly buffer ChunkCounts { uint chunk_counts[]; };          // [chunks]
layout(push_constant, scalar) uniform Push {
    View view;
    uint gaussians;
} push;

#include "shared/cull_test.glsl"

const uint WORDS = CULL_CHUNK / 32;
shared uint words[WORDS];
shared uint count;

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
            // `first` is a multiple of the subgroup size. The bits are disjoint: order does not matter.
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
