#version 460
#include "shared/workgroup.glsl"
// One invocation per group of pixels that fills whole words: rounds floats to the integers of a picture file.
// Before: `image` is complete. After: `packed` holds the colours (red, green, blue) or the coverage of all pixels, row
// by row without gaps, in 8 or 16 bits; the last word is filled up with 0.

layout(constant_id = 0) const bool COLOURS = true;  // three channels; else only coverage
layout(constant_id = 1) const bool WIDE = false;    // 16 bits; else 8 bits
layout(binding = 0, rgba32f) readonly uniform image2D image;
layout(binding = 1, scalar) writeonly buffer Packed { uint packed[]; };  // [words]
layout(push_constant, scalar) uniform Push {
    uvec2 size_px;
} push;

const uint CHANNELS = COLOURS ? 3 : 1;
const uint BITS = WIDE ? 16 : 8;
const uint PIXELS = WIDE ? 2 : 4;                 // in a group
const uint WORDS = PIXELS * CHANNELS * BITS / 32;  // of a group

// A value from 0 to 1 as an integer: clamped, and rounded to the nearest with halves away from 0. NaN is 0.
uint quantized(float value) {
    float most = WIDE ? 65535.0 : 255.0;
    precise float scaled = (value >= 0.0 ? min(value, 1.0) : 0.0) * most;
    float whole = floor(scaled);
    precise float rest = scaled - whole;  // exact
    return uint(whole) + uint(rest >= 0.5);
}

void main() {
    uint group = workgroup() * WORKGROUP + lane();
    uint pixels = push.size_px.x * push.size_px.y, first = group * PIXELS;
    if (first >= pixels) return;
    uint words[3] = uint[3](0, 0, 0);
    for (uint k = 0; k < PIXELS && first + k < pixels; k++) {
        uint index = first + k;
        vec4 value = imageLoad(image, ivec2(index % push.size_px.x, index / push.size_px.x));
        for (uint channel = 0; channel < CHANNELS; channel++) {
            uint bit = (k * CHANNELS + channel) * BITS;
            words[bit / 32] |= quantized(COLOURS ? value[channel] : value.a) << bit % 32;
        }
    }
    uint count = (min(PIXELS, pixels - first) * CHANNELS * BITS + 31) / 32;
    for (uint word = 0; word < count; word++) packed[group * WORDS + word] = words[word];
}
