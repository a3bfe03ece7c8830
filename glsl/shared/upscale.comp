#version 460
#include "shared/workgroup.glsl"
// One invocation per pixel of `image`: interpolates the smaller image `drawn` of the same view bilinearly.
// Before: `drawn` is complete. After: `image` is complete.

layout(binding = 0, rgba32f) readonly uniform image2D drawn;
layout(binding = 1, rgba32f) writeonly uniform image2D image;
layout(push_constant, scalar) uniform Push {
    uvec2 drawn_size_px;
    uvec2 size_px;
} push;

void main() {
    uint index = workgroup() * WORKGROUP + lane();
    uvec2 pixel = uvec2(index % push.size_px.x, index / push.size_px.x);
    if (pixel.y >= push.size_px.y) return;
    vec2 place = (vec2(pixel) + 0.5) * vec2(push.drawn_size_px) / vec2(push.size_px) - 0.5;
    ivec2 last = ivec2(push.drawn_size_px) - 1;
    ivec2 low = clamp(ivec2(floor(place)), ivec2(0), last), high = min(low + 1, last);
    vec2 part = clamp(place - vec2(low), 0.0, 1.0);
    vec4 above = mix(imageLoad(drawn, low), imageLoad(drawn, ivec2(high.x, low.y)), part.x);
    vec4 below = mix(imageLoad(drawn, ivec2(low.x, high.y)), imageLoad(drawn, high), part.x);
    imageStore(image, ivec2(pixel), mix(above, below, part.y));
}
