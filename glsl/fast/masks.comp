#version 460
#include "shared/workgroup.glsl"
#extension GL_KHR_shader_subgroup_shuffle : require
#extension GL_EXT_control_flow_attributes : require
#include "fast/frame.glsl"
#include "shared/rules.glsl"
#include "fast/splat.glsl"
#include "fast/subgroup_owner.glsl"
// One workgroup per segment of 1024 entries of a bin: marks which of the bin's 32 blocks each entry reaches.
// Before: sorted splat_ids. After: masks has 32 words for every segment and block, with a bit per entry.
// A row of blocks meets an ellipse in an interval (the idea of AccuTile, Hanson et al. 2024). The test is a bound: a
// block with a pixel that the splat is drawn on is never left out.

layout(binding = 0, scalar) readonly buffer SegmentBins { uint segment_bins[]; };           // [segments]
layout(binding = 1, scalar) readonly buffer Bins { Bin bins[]; };                           // [bins]
layout(binding = 2, scalar) readonly buffer SplatIds { uint splat_ids[]; };                 // [entry_capacity]
layout(binding = 3, scalar) readonly buffer Splats { uvec4 splats[]; };              // [SPLAT_WORDS * visible_capacity]
layout(binding = 4, scalar) writeonly buffer Masks { uint masks[]; };                       // [segments * BLOCKS * 32]
layout(binding = 5, scalar) readonly buffer DispatchesBlock { FastDispatches dispatches; };
layout(push_constant, scalar) uniform Push {
    uint bins_x;
    uint block_height;  // px
} push;

shared uint reached[BIN_SEGMENT];                   // the blocks that each entry reaches, a bit each
shared uint rows[BLOCKS * (BIN_SEGMENT / 32 + 1)];  // the words of each block, padded against bank conflicts

// The blocks of a bin whose pixel centres the ellipse meets, a bit each. `corner`: of the bin, relative to the mean,
// px.
uint blocks_reached(vec2 corner, vec3 factor, float limit, vec2 mean) {
    // Slightly beyond the true border: f32 weights of the blend may reach ALPHA_MIN by rounding.
    float border = sqrt(max(limit, 0.0) + 1e-3);
    float half_height = border / factor.z, per_x = 1.0 / factor.x, slope = factor.y * per_x;
    float rightmost_y = -factor.y * half_height * inversesqrt(factor.y * factor.y + factor.z * factor.z);
    float height = float(push.block_height);
    vec2 far = abs(corner) + vec2(BIN_COLUMNS * BLOCK_WIDTH, BIN_ROWS * height);
    float slack = 1e-6 * (abs(mean.x) + far.x + abs(slope) * far.y) + 1e-3;
    uint mask = 0;
    [[unroll]] for (uint row = 0; row < BIN_ROWS; row++) {
        float low = max(corner.y + float(row) * height + 0.5, -half_height);
        float high = min(corner.y + float(row + 1) * height - 0.5, half_height);
        float right_y = clamp(rightmost_y, low, high), left_y = clamp(-rightmost_y, low, high);
        float right_v = factor.z * right_y, left_v = factor.z * left_y;
        float right = sqrt(max(border * border - right_v * right_v, 0.0)) * per_x - slope * right_y + slack;
        float left = -sqrt(max(border * border - left_v * left_v, 0.0)) * per_x - slope * left_y - slack;
        // The pixel centres of block c lie from 8 c + 0.5 to 8 c + 7.5.
        float first = ceil((left - corner.x - (float(BLOCK_WIDTH) - 0.5)) / float(BLOCK_WIDTH));
        float end = floor((right - corner.x - 0.5) / float(BLOCK_WIDTH)) + 1.0;
        // The comparisons are written so that NaN reaches every block.
        uint from = first > 0.0 ? uint(min(first, 8.0)) : 0;
        uint to = end < 8.0 ? uint(max(end, 0.0)) : 8;
        if (from < to && !(low > high + slack)) mask |= ((1u << to) - (1u << from)) << 8 * row;
    }
    return mask;
}

// Turns 32 words with a bit per block, one per lane, into 32 words with a bit per lane: a 32x32 bit transpose.
uint transposed(uint word) {
    [[unroll]] for (uint step = 16; step > 0; step /= 2) {
        uint low = 0xffffffff / ((1u << step) + 1);  // 0x0000ffff, 0x00ff00ff, ..., 0x55555555
        uint other = subgroupShuffleXor(word, step);
        word = (gl_SubgroupInvocationID & step) == 0 ? word & low | (other & low) << step
                                                     : word & ~low | (other & ~low) >> step;
    }
    return word;
}

void main() {
    uint segment = workgroup();
    if (IS_SURPLUS(dispatches.segments)) return;
    uint number = segment_bins[segment];
    Bin bin = bins[number];
    uint begin = (segment - bin.first_segment) * BIN_SEGMENT;
    uvec2 bin_px = uvec2(BIN_COLUMNS, BIN_ROWS) * uvec2(BLOCK_WIDTH, push.block_height);
    vec2 corner = vec2(uvec2(number % push.bins_x, number / push.bins_x) * bin_px);
    for (uint i = lane(); i < BIN_SEGMENT; i += WORKGROUP) {
        uint mask = 0;
        if (begin + i < bin.count) {
            uint splat = splat_ids[bin.first + begin + i];
            vec4 a = uintBitsToFloat(splats[splat * SPLAT_WORDS]);
            vec2 b = uintBitsToFloat(splats[splat * SPLAT_WORDS + 1].xy);
            mask = blocks_reached(corner - a.xy, vec3(a.zw, b.x), b.y, a.xy);
        }
        if (SUBGROUP == 32) {
            rows[gl_SubgroupInvocationID * 33 + i / 32] = transposed(mask);
        } else {
            reached[i] = mask;
        }
    }
    barrier();
    uint block = lane() / 32, word = lane() % 32;
    for (; block < BLOCKS; block += WORKGROUP / 32) {
        uint bits = 0;
        if (SUBGROUP == 32) {
            bits = rows[block * 33 + word];
        } else {
            for (uint i = 0; i < 32; i++) bits |= (reached[32 * word + i] >> block & 1) << i;
        }
        masks[(segment * BLOCKS + block) * 32 + word] = bits;
    }
}
