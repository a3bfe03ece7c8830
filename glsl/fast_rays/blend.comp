#version 460
#define WORKGROUP_SIZE 128
layout(constant_id = 10) const uint BLOCK_HEIGHT = 8;  // px
layout(constant_id = 11) const bool HAS_RING = false;  // in small pictures
#define RAYS
#include "fast/blend_block.glsl"
// One subgroup per block of pixels, as fast/blend.comp: blends the splats that reach it front to back along the rays of
// its pixels.
// Before: bins, sorted splat_ids and masks. After: image = (colour over the background, 1 - T); 0 where a pixel has no
// ray.

void main() {
    uint place = workgroup() * gl_NumSubgroups + gl_SubgroupID;
    if (place >= push.bins * BLOCKS) return;
    uint number = bin_order[place / BLOCKS], block = place % BLOCKS;
    Bin bin = bins[number];
    if (!begin_block(number, block)) return;
    for (uint k = 0; k < PIXELS; k++) begin_pixel(k, has_ray[k] ? 1.0 : 0.0);
    blend_entries(bin, block);
    for (uint k = 0; k < PIXELS; k++) {
        if (has_ray[k]) {
            show(k, colour[k], final_transmittance(k));
        } else if (is_inside(k)) {
            imageStore(image, ivec2(pixel + uvec2(0, k * ROWS)), vec4(0.0));
        }
    }
}
