#version 460
#include "shared/workgroup.glsl"
#include "portable/frame.glsl"
// One workgroup per chunk of 1024 Gaussians: writes the ids of the visible ones, in ascending order.
// Before: visible_masks from cull, chunk_offsets from cull_offsets.
// After: gaussian_from_splat[0 .. visible_kept] holds them; ids beyond the capacity are left out.

layout(binding = 0, scalar) readonly buffer VisibleMasks { uint visible_masks[]; };         // [chunks * 32]
layout(binding = 1, scalar) readonly buffer ChunkOffsets { uint chunk_offsets[]; };         // [chunks]
layout(binding = 2, scalar) writeonly buffer Ids { uint gaussian_from_splat[]; };           // [visible_capacity]
layout(push_constant, scalar) uniform Push {
    uint chunks;
    uint visible_capacity;
} push;

const uint WORDS = CULL_CHUNK / 32;
shared uint words[WORDS];
shared uint word_offsets[WORDS];

void main() {
    uint chunk = workgroup();
    if (chunk >= push.chunks) return;
    if (lane() < WORDS) words[lane()] = visible_masks[chunk * WORDS + lane()];
    barrier();
    if (lane() < WORDS) {
        uint offset = chunk_offsets[chunk];
        for (uint w = 0; w < lane(); w++) offset += bitCount(words[w]);
        word_offsets[lane()] = offset;
    }
    barrier();
    for (uint i = lane(); i < CULL_CHUNK; i += WORKGROUP) {
        uint word = words[i / 32], bit = 1u << (i % 32);
        if ((word & bit) != 0) {
            uint splat = word_offsets[i / 32] + bitCount(word & (bit - 1));
            if (splat < push.visible_capacity) gaussian_from_splat[splat] = chunk * CULL_CHUNK + i;
        }
    }
}
