#version 460
#include "shared/workgroup.glsl"
#extension GL_KHR_shader_subgroup_shuffle : require
#extension GL_EXT_control_flow_attributes : require
#include "fast_rays/frame.glsl"
#include "fast_rays/record.glsl"
#include "fast/subgroup_owner.glsl"
// One workgroup per segment of 1024 entries of a bin, as fast/masks.comp: marks which of the bin's 32 blocks have a ray
// that each entry meets.
// Before: sorted splat_ids. After: masks has 32 words for every segment and block, with a bit per entry.

layout(binding = 0, scalar) readonly buffer SegmentBins { uint segment_bins[]; };           // [segments]
layout(binding = 1, scalar) readonly buffer Bins { Bin bins[]; };                           // [bins]
layout(binding = 2, scalar) readonly buffer SplatIds { uint splat_ids[]; };                 // [entry_capacity]
layout(binding = 3, scalar) readonly buffer Splats { uvec4 splats[]; };              // [SPLAT_WORDS * visible_capacity]
layout(binding = 4, scalar) writeonly buffer Masks { uint masks[]; };                       // [segments * BLOCKS * 32]
layout(binding = 5, scalar) readonly buffer DispatchesBlock { FastDispatches dispatches; };
layout(binding = 6, scalar) readonly buffer LensTable { uvec4 lens_table[]; };              // fast_rays/frame.glsl
layout(push_constant, scalar) uniform Push {
    uint block_height;  // px
    uint is_parallel;
    uvec2 size_px;
} push;

#include "fast/blocks_reached.glsl"

// The rays of the bin are affine in px, but for `off`. So the rays that the splat meets are in an ellipse, if w is
// bounded by its largest value in the bin.
uint mask_of(uint splat, uint bin) {
    uint first = splat * SPLAT_WORDS;
    RayRecord record = record_of(splats[first], splats[first + 1], splats[first + 2]);
    RayAxes axes = axes_of(record, push.is_parallel == 1);
    uint of_bin = HEAD + bin * BIN_RAYS;
    vec4 middle = uintBitsToFloat(lens_table[of_bin]), along_x = uintBitsToFloat(lens_table[of_bin + 1]);
    vec3 along_y = uintBitsToFloat(lens_table[of_bin + 2].xyz);
    float off = along_x.w;
    vec3 e = middle.xyz - record.centre;
    vec2 s = vec2(dot(axes.u, e), dot(axes.v, e));
    vec2 by_x = vec2(dot(axes.u, along_x.xyz), dot(axes.v, along_x.xyz));
    vec2 by_y = vec2(dot(axes.u, along_y), dot(axes.v, along_y));
    vec2 half_px = 0.5 * vec2(BIN_COLUMNS * BLOCK_WIDTH, BIN_ROWS * push.block_height);
    vec2 w_by = abs(vec2(dot(axes.q, along_x.xyz), dot(axes.q, along_y)));
    float w = dot(axes.q, middle.xyz) + dot(w_by, half_px + off);
    float slope = slope_of(record.kappa, record.limit + 1e-3);
    if (off > 1e6 || slope < 0.0) return 0xffffffff;
    if (!(w > 0.0)) return 0;
    // (s, t) is turned so that only s depends on x.
    float length_x = length(by_x);
    vec2 turn = by_x / length_x;
    vec3 factor = vec3(length_x, dot(turn, by_y), turn.x * by_y.y - turn.y * by_y.x);
    float t = turn.x * s.y - turn.y * s.x;
    // A picture of the splat may be mirrored; its ellipse is the same for the other sign of t.
    vec2 centre;
    centre.y = -t / factor.z;
    centre.x = -(dot(turn, s) + factor.y * centre.y) / factor.x;
    factor.z = abs(factor.z);
    return blocks_reached(-half_px - centre, factor, slope * w, float(push.size_px.x), off);
}

#include "fast/mask_segment.glsl"
