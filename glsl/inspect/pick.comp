#version 460
#include "shared/workgroup.glsl"
#include "portable/frame.glsl"
#include "shared/depth.glsl"
#include "portable/blend_splat.glsl"
#include "inspect/evidence.glsl"
// One invocation per instance of one tile's list: computes the depth, alpha and colour of its splat at one pixel.
// Before: the lists of a complete frame. After: gaussians and evidence of all `count` instances, front to back.

layout(binding = 0, scalar) readonly buffer SplatIds { uint splat_ids[]; };                 // [instance_capacity]
layout(binding = 1, scalar) readonly buffer Splats { Splat splats[]; };                     // [visible_capacity]
layout(binding = 2, scalar) readonly buffer Ids { uint gaussian_from_splat[]; };            // [visible_capacity]
layout(binding = 3, scalar) readonly buffer Bounds { uvec4 bounds[]; };                     // [gaussians] mean, reach
layout(binding = 4, scalar) writeonly buffer GaussianIds { uint gaussians[]; };             // [count]
layout(binding = 5, scalar) writeonly buffer EvidenceBlock { Evidence evidence[]; };        // [count]
layout(push_constant, scalar) uniform Push {
    View view;
    uint first;   // index of the list's first instance
    uint count;   // instances in the list
    uvec2 pixel;
} push;

#define SPLAT Splat

float falloff_here(SPLAT splat) {
    return falloff(splat.factor, vec2(push.pixel) + 0.5 - splat.mean_px);
}

float depth_by_rule(vec3 mean) {
    return depth_of(mean, push.view);
}

#include "inspect/pick_list.glsl"
