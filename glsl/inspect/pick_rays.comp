#version 460
#include "shared/workgroup.glsl"
#include "rays/frame.glsl"
#include "shared/depth.glsl"
#include "portable/blend_splat.glsl"
#include "inspect/evidence.glsl"
// One invocation per instance of one tile's list: computes the depth, alpha and colour of its splat along the ray of
// one pixel.
// Before: the lists of a complete frame. After: gaussians and evidence of all `count` instances, front to back.

layout(binding = 0, scalar) readonly buffer SplatIds { uint splat_ids[]; };                 // [instance_capacity]
layout(binding = 1, scalar) readonly buffer Splats { RaySplat splats[]; };                  // [visible_capacity]
layout(binding = 2, scalar) readonly buffer Ids { uint gaussian_from_splat[]; };            // [visible_capacity]
layout(binding = 3, scalar) readonly buffer Bounds { uvec4 bounds[]; };                     // [gaussians] mean, reach
layout(binding = 4, scalar) writeonly buffer GaussianIds { uint gaussians[]; };             // [count]
layout(binding = 5, scalar) writeonly buffer EvidenceBlock { Evidence evidence[]; };        // [count]
layout(binding = 6, scalar) readonly buffer Rays { vec3 rays[]; };                          // [pixels] 0 if none
layout(push_constant, scalar) uniform Push {
    View view;
    uint first;   // index of the list's first instance
    uint count;   // instances in the list
    uint pixel;   // index in `rays`
    uint is_parallel;
} push;

#define IS_PARALLEL (push.is_parallel == 1)
#include "rays/view.glsl"
#define SPLAT RaySplat

float falloff_here(SPLAT splat) {
    vec3 ray = rays[push.pixel];
    return ray == vec3(0.0) ? EVERYWHERE : falloff_along(splat, ray);
}

float depth_by_rule(vec3 mean) {
    return far_of(mean);
}

#include "inspect/pick_list.glsl"
