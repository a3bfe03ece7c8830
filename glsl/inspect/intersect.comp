#version 460
#include "shared/workgroup.glsl"
#include "portable/frame.glsl"
// One invocation per word of `visible_masks`: intersects the visible set, culled from any camera, with the Gaussians
// that this view may see; if a Gaussian is isolated, keeps only this Gaussian.
// Before: visible_masks and chunk_counts from cull. After: both describe the intersection, and later stages read them
// like the result of cull.

layout(binding = 0, scalar) readonly buffer Bounds { uvec4 bounds[]; };                     // [gaussians] mean, reach
layout(binding = 1, scalar) buffer VisibleMasks { uint visible_masks[]; };                  // [chunks * 32]
layout(binding = 2, scalar) writeonly buffer ChunkCounts { uint chunk_counts[]; };          // [chunks]
layout(push_constant, scalar) uniform Push {
    View view;
    uint chunks;
    uint isolated;  // ALL, or the index of the Gaussian to keep
} push;

#include "shared/marks.glsl"
#include "shared/cull_test.glsl"

const uint ALL = 0xffffffff;
const uint WORDS = CULL_CHUNK / 32;
shared uint counts[WORKGROUP / WORDS];

void main() {
    uint word = workgroup() * WORKGROUP + lane();
    bool exists = word < push.chunks * WORDS;
    if (lane() < WORKGROUP / WORDS) counts[lane()] = 0;
    barrier();
    uint kept = 0;
    for (uint left = exists ? visible_masks[word] : 0; left != 0; left &= left - 1) {
        uint bit = findLSB(left), gaussian = 32 * word + bit;
        bool wanted = push.isolated == ALL || push.isolated == gaussian;
        if (wanted && may_be_visible(bounds[gaussian])) kept |= 1u << bit;
    }
    if (exists) visible_masks[word] = kept;
    atomicAdd(counts[lane() / WORDS], bitCount(kept));  // a sum of integers: order does not matter
    barrier();
    if (exists && lane() % WORDS == 0) chunk_counts[word / WORDS] = counts[lane() / WORDS];
}
