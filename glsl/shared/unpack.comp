#version 460
#include "shared/workgroup.glsl"
// One invocation per pixel: the inverse of `pack` for colours of 8 bits.
// Before: `packed` holds red, green and blue of rows of the picture, row by row without gaps, from a word on.
// After: these rows of `image` hold them, from 0 to 1, with an alpha of 1.

layout(binding = 0, rgba32f) writeonly uniform image2D image;
layout(binding = 1, scalar) readonly buffer Packed { uint packed[]; };  // [words]
layout(push_constant, scalar) uniform Push {
    uvec2 size_px;    // of the rows
    uint top;         // the first row in `image`
    uint first_word;  // of the rows in `packed`
} push;

void main() {
    uint pixel = workgroup() * WORKGROUP + lane();
    if (pixel >= push.size_px.x * push.size_px.y) return;
    // Three bytes lie in one word or in two.
    uint first = 3 * pixel, word = push.first_word + first / 4, shift = 8 * (first % 4);
    uint bytes = packed[word] >> shift;
    if (shift > 8) bytes |= packed[word + 1] << 32 - shift;
    vec3 colour = vec3(bytes & 0xff, bytes >> 8 & 0xff, bytes >> 16 & 0xff) / 255.0;
    imageStore(image, ivec2(pixel % push.size_px.x, push.top + pixel / push.size_px.x), vec4(colour, 1.0));
}
