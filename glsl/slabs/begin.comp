#version 460
#include "shared/workgroup.glsl"
#include "shared/rules.glsl"
#include "fast/transmittance.glsl"
// One invocation per pixel: writes the state of a pixel before the first slab.
// Before: open_bins has a bit for every bin that is drawn. After: image has colour 0 and transmittance 1, in the form
// of slabs/blend.comp; pixels of other bins have stopped.

layout(binding = 0, rgba32f) writeonly uniform image2D image;
layout(binding = 1, scalar) readonly buffer OpenBins { uint open_bins[]; };                 // [bins / 32] a bit per bin
layout(push_constant, scalar) uniform Push {
    uvec2 size_px;
    uvec2 bin_px;
    uint bins_x;
} push;

void main() {
    uint index = workgroup() * WORKGROUP + lane();
    if (index >= push.size_px.x * push.size_px.y) return;
    uvec2 pixel = uvec2(index % push.size_px.x, index / push.size_px.x);
    uint bin = pixel.y / push.bin_px.y * push.bins_x + pixel.x / push.bin_px.x;
    bool is_open = (open_bins[bin / 32] >> bin % 32 & 1) != 0;
    imageStore(image, ivec2(pixel), vec4(0.0, 0.0, 0.0, is_open ? UNIT : -UNIT));
}
