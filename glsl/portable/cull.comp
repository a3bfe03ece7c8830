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

#include "shared/marks.glsl"
#include "shared/cull_test.glsl"

#include "portable/cull_chunk.glsl"
