#version 460
#include "shared/workgroup.glsl"
#include "shared/marks.glsl"
// One invocation per Gaussian: sets its marks.
// Before: nothing. After: the last words of bounds have the marks.

layout(binding = 0, scalar) buffer Bounds { uvec4 bounds[]; };                              // [gaussians] mean, reach
layout(binding = 1, scalar) readonly buffer LeftOut { uint left_out[]; };                   // [gaussians / 32] bits
layout(binding = 2, scalar) readonly buffer Selected { uint selected[]; };                  // [gaussians / 32] bits
layout(push_constant, scalar) uniform Push {
    uint gaussians;
} push;

void main() {
    uint gaussian = workgroup() * WORKGROUP + lane();
    if (gaussian >= push.gaussians) return;
    uint word = gaussian / 32, bit = 1u << gaussian % 32, before = bounds[gaussian].w;
    uint after = with_marks(before, (left_out[word] & bit) != 0, (selected[word] & bit) != 0);
    if (after != before) bounds[gaussian].w = after;
}
