#version 460
#include "shared/workgroup.glsl"
#include "shared/rules.glsl"
#include "fast/transmittance.glsl"
// One invocation per pixel: converts the states of slabs/blend.comp to the image, as fast/blend.comp does.
// Before: image has the states after the last slab. After: image = (colour over the background, 1 - T).

layout(binding = 0, rgba32f) uniform image2D image;
layout(push_constant, scalar) uniform Push {
    uvec2 size_px;
    vec3 background;
} push;

void main() {
    uint index = workgroup() * WORKGROUP + lane();
    if (index >= push.size_px.x * push.size_px.y) return;
    ivec2 pixel = ivec2(index % push.size_px.x, index / push.size_px.x);
    vec4 state = imageLoad(image, pixel);
    float transmittance = transmittance_of(abs(state.a));
    imageStore(image, pixel, vec4(fma(vec3(transmittance), push.background, state.rgb), 1.0 - transmittance));
}
