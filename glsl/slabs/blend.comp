#version 460
#define WORKGROUP_SIZE 128
#define IMAGE_ACCESS
layout(constant_id = 10) const uint BLOCK_HEIGHT = 8;  // px
const bool HAS_RING = false;
#include "fast/blend_block.glsl"
// One subgroup per block of pixels: blends one slab as fast/blend.comp, starting from the states of the previous slab.
// Before: bins, sorted splat_ids and masks of the slab; open_bins is 0. After: image has the state of every pixel,
// open_bins a bit for every bin with a pixel that has not stopped.
// The state of a pixel is its colour so far and its transmittance times UNIT, negated once the pixel has stopped.
// These are the values inside blend_block.glsl, so that the image has the bits of a frame without slabs.

layout(binding = 6, scalar) buffer OpenBins { uint open_bins[]; };                          // [bins / 32] a bit per bin

bool is_negative(float number) {
    return floatBitsToUint(number) >> 31 == 1;  // also for -0
}

void go_on(uint k) {
    begin_pixel(k, 0.0);
    if (!is_inside(k)) return;
    vec4 state = imageLoad(image, ivec2(pixel + uvec2(0, k * ROWS)));
    colour[k] = state.rgb;
    last[k] = abs(state.a);
    if (is_negative(state.a)) return;
    live[k] = state.a;
    limit[k] = UNIT * last_transmittance();
}

void keep(uint k) {
    vec4 state = vec4(colour[k], limit[k] < 0.0 ? -last[k] : live[k]);
    if (is_inside(k)) imageStore(image, ivec2(pixel + uvec2(0, k * ROWS)), state);
}

// True if a pixel of the block has not stopped.
bool is_open() {
    bool is_any = false;
    for (uint k = 0; k < PIXELS; k++) is_any = is_any || is_inside(k) && limit[k] >= 0.0;
    return subgroupAny(is_any);
}

void main() {
    uint place = workgroup() * gl_NumSubgroups + gl_SubgroupID;
    if (place >= push.bins * BLOCKS) return;
    uint number = bin_order[place / BLOCKS], block = place % BLOCKS;
    if (!begin_block(number, block)) return;
    Bin bin = bins[number];
    for (uint k = 0; k < PIXELS; k++) go_on(k);
    if (!is_open()) return;
    if (bin.count > 0) {
        uint stop_key = blend_entries(bin, block);
        if (HAS_STOP_KEYS && stop_key != NOT_STOPPED && subgroupElect()) stop_keys[number * BLOCKS + block] = stop_key;
        for (uint k = 0; k < PIXELS; k++) keep(k);
    }
    if (is_open() && subgroupElect()) {
        atomicOr(open_bins[number / 32], 1u << number % 32);  // sets bits: order does not matter
    }
}
