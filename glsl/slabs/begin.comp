#version 460
#include "shared/workgroup.glsl"
#include "shared/rules.glsl"
#include "fast/transmittance.glsl"
// One invocation per pixel: writes the state of a pixel before the first slab.
// Before: nothing. After: image has colour 0 and transmittance 1, in the form of slabs/blend.comp.

layout(binding = 0, rgba32f) writeonly uniform image2D image;
layout(push_constant, scalar) uniform Push {
    uvec2 size_px;
} push;

void main() {
    uint index = workgroup() * WORKGROUP + lane();
    if (index >= push.size_px.x * push.size_px.y) return;
    imageStore(image, ivec2(index % push.size_px.x, index / push.size_px.x), vec4(0.0, 0.0, 0.0, UNIT));
}
