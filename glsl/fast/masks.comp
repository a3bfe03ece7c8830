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

layout(binding = 0, scalar) readonly buffer SegmentBins { uint segment_bins[]; };           // [segments]
layout(binding = 1, scalar) readonly buffer Bins { Bin bins[]; };                           // [bins]
layout(binding = 2, scalar) readonly buffer SplatIds { uint splat_ids[]; };                 // [entry_capacity]
layout(binding = 3, scalar) readonly buffer Splats { uvec4 splats[]; };              // [SPLAT_WORDS * visible_capacity]
layout(binding = 4, scalar) writeonly buffer Masks { uint masks[]; };                       // [segments * BLOCKS * 32]
layout(binding = 5, scalar) readonly buffer DispatchesBlock { FastDispatches dispatches; };
layout(push_constant, scalar) uniform Push {
    uint bins_x;
    uint block_height;  // px
    uint top_px;  // first row of the picture that is drawn
} push;

#include "fast/blocks_reached.glsl"

uint mask_of(uint splat, uint bin) {
    uvec2 bin_px = uvec2(BIN_COLUMNS, BIN_ROWS) * uvec2(BLOCK_WIDTH, push.block_height);
    vec2 corner = vec2(uvec2(bin % push.bins_x, bin / push.bins_x) * bin_px + uvec2(0, push.top_px));
    vec4 a = uintBitsToFloat(splats[splat * SPLAT_WORDS]);
    vec2 b = uintBitsToFloat(splats[splat * SPLAT_WORDS + 1].xy);
    return blocks_reached(corner - a.xy, vec3(a.zw, b.x), border_of(b.y), abs(a.x), 0.0);
}

#include "fast/mask_segment.glsl"
