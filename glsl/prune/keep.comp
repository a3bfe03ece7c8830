#version 460
#include "shared/workgroup.glsl"
#include "portable/frame.glsl"
// One invocation per word of `visible_masks`: removes dropped Gaussians from the visible set.
// Before: visible_masks and chunk_counts from cull. After: both describe the kept Gaussians, so that later stages draw
// only these. Indices do not change, so the order of splats does not change, either.

layout(binding = 0, scalar) readonly buffer Kept { uint kept[]; };                          // [chunks * 32] bits
layout(binding = 1, scalar) buffer VisibleMasks { uint visible_masks[]; };                  // [chunks * 32]
layout(binding = 2, scalar) writeonly buffer ChunkCounts { uint chunk_counts[]; };          // [chunks]
layout(push_constant, scalar) uniform Push {
    uint chunks;
} push;

const uint WORDS = CULL_CHUNK / 32;
shared uint counts[WORKGROUP / WORDS];

void main() {
    uint word = workgroup() * WORKGROUP + lane();
    bool exists = word < push.chunks * WORDS;
    if (lane() < WORKGROUP / WORDS) counts[lane()] = 0;
    barrier();
    uint left = exists ? visible_masks[word] & kept[word] : 0;
    if (exists) visible_masks[word] = left;
    atomicAdd(counts[lane() / WORDS], bitCount(left));  // a sum of integers: order does not matter
    barrier();
    if (exists && lane() % WORDS == 0) chunk_counts[word / WORDS] = counts[lane() / WORDS];
}
