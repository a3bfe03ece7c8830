#version 460
#define WORKGROUP_SIZE 128
layout(constant_id = 10) const uint BLOCK_HEIGHT = 8;  // px
layout(constant_id = 11) const bool HAS_RING = false;  // in small pictures
#include "fast/blend_block.glsl"
// One subgroup per block of pixels: blends the splats that reach it front to back, and ends when all its pixels have
// stopped.
// Before: bins, sorted splat_ids and masks. After: image = (colour over the background, 1 - T). No subgroup waits for
// another. What a pixel shows depends on the order of its splats alone, not on the lengths of lists.

void main() {
    uint place = workgroup() * gl_NumSubgroups + gl_SubgroupID;
    if (place >= push.bins * BLOCKS) return;
    uint number = bin_order[place / BLOCKS], block = place % BLOCKS;
    Bin bin = bins[number];
    if (!begin_block(number, block)) return;
    for (uint k = 0; k < PIXELS; k++) begin_pixel(k, is_inside(k) ? 1.0 : 0.0);
    uint stop_key = blend_entries(bin, block);
    if (HAS_STOP_KEYS && subgroupElect()) stop_keys[number * BLOCKS + block] = stop_key;
    for (uint k = 0; k < PIXELS; k++) show(k, colour[k], final_transmittance(k));
}
