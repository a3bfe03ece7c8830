#version 460
#define WORKGROUP_SIZE 128
layout(constant_id = 10) const uint BLOCK_HEIGHT = 8;  // px
#include "fast/blend_block.glsl"
// One workgroup per block of pixels of a bin with a long list: blends it front to back, a stretch per subgroup at a
// time.
// Before: as for blend. After: image is set in the bins that blend leaves out.
// Each subgroup blends its stretch as if nothing lay in front of it. The result is then weighted by the transmittance
// of the stretches in front. Where a pixel stops within a stretch, that stretch is blended once more, from the true
// transmittance. The result depends on the list alone.

shared float passed[WORKGROUP / SUBGROUP * BLOCK_PIXELS];  // transmittance through each subgroup's stretch
shared vec4 sums[BLOCK_PIXELS];

void main() {
    uint place = workgroup();
    if (place >= push.bins * BLOCKS) return;
    uint number = bin_order[place / BLOCKS], block = place % BLOCKS;
    Bin bin = bins[number];
    if (bin.count < LONG_LIST || !begin_block(number, block)) return;
    uint words = (bin.count + 31) / 32, stretch = BIN_STRETCH / 32;
    // Transmittance through all stretches so far, and where this subgroup stopped the pixel (-1 if it did not).
    float in_front[PIXELS], ended[PIXELS];
    vec3 total[PIXELS];
    for (uint k = 0; k < PIXELS; k++) {
        in_front[k] = is_inside(k) ? 1.0 : 0.0;
        ended[k] = -1.0;
        total[k] = vec3(0.0);
    }
    bool goes_on = true;
    for (uint round = 0; round < words && goes_on; round += stretch * gl_NumSubgroups) {
        uint begin = min(round + stretch * gl_SubgroupID, words), end = min(begin + stretch, words);
        for (uint k = 0; k < PIXELS; k++) begin_pixel(k, in_front[k] >= last_transmittance() ? 1.0 : 0.0);
        blend_words(bin, block, begin, end);
        float through[PIXELS];
        for (uint k = 0; k < PIXELS; k++) {
            through[k] = transmittance_of(live[k]);
            passed[gl_SubgroupID * BLOCK_PIXELS + k * SUBGROUP + gl_SubgroupInvocationID] = through[k];
        }
        barrier();
        float start[PIXELS];
        bool ends = false;
        for (uint k = 0; k < PIXELS; k++) {
            start[k] = in_front[k];
            for (uint s = 0; s < gl_NumSubgroups; s++) {
                if (s == gl_SubgroupID) start[k] = in_front[k];
                in_front[k] *= passed[s * BLOCK_PIXELS + k * SUBGROUP + gl_SubgroupInvocationID];
            }
            bool begins = start[k] >= last_transmittance(), ends_here = start[k] * through[k] < last_transmittance();
            if (begins && !ends_here) total[k] = fma(vec3(start[k]), colour[k], total[k]);
            if (!(begins && ends_here)) start[k] = 0.0;
            ends = ends || start[k] > 0.0;
        }
        if (subgroupAny(ends)) {
            for (uint k = 0; k < PIXELS; k++) begin_pixel(k, start[k]);
            blend_words(bin, block, begin, end);
            for (uint k = 0; k < PIXELS; k++) {
                total[k] += colour[k];
                if (start[k] > 0.0) ended[k] = final_transmittance(k);
            }
        }
        bool mine = false;
        for (uint k = 0; k < PIXELS; k++) mine = mine || in_front[k] >= last_transmittance();
        goes_on = subgroupAny(mine);  // the same in all subgroups
        barrier();  // all lanes have read `passed`
    }
    // The sums are taken in the order of the subgroups, so that they have the same bits in every run.
    for (uint s = 0; s < gl_NumSubgroups; s++) {
        for (uint k = 0; s == gl_SubgroupID && k < PIXELS; k++) {
            uint place = k * SUBGROUP + gl_SubgroupInvocationID;
            vec4 before = s == 0 ? vec4(vec3(0.0), in_front[k]) : sums[place];
            sums[place] = vec4(before.rgb + total[k], ended[k] >= 0.0 ? ended[k] : before.a);
        }
        barrier();
    }
    for (uint k = gl_SubgroupID; k < PIXELS; k += gl_NumSubgroups) {
        vec4 sum = sums[k * SUBGROUP + gl_SubgroupInvocationID];
        show(k, sum.rgb, sum.a);
    }
}
