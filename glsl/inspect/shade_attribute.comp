#version 460
#include "shared/workgroup.glsl"
#include "portable/frame.glsl"
#include "inspect/codes.glsl"
#include "shared/depth.glsl"
#include "shared/harmonics.glsl"
#include "shared/grids.glsl"
#include "shared/rotation.glsl"
// One invocation per visible Gaussian: writes one of its attributes as the colour of its splat.
// Before: splats from project. After: the colour of each splat is the attribute, which may be negative and is finite.

layout(constant_id = 3) const uint ATTRIBUTE = 0;

layout(binding = 0, scalar) readonly buffer TotalsBlock { Totals totals; };
layout(binding = 1, scalar) readonly buffer Ids { uint gaussian_from_splat[]; };            // [visible_capacity]
layout(binding = 2, scalar) readonly buffer Bounds { uvec4 bounds[]; };                     // [gaussians] mean, reach
layout(binding = 3, scalar) readonly buffer GridsBlock { Grids grids; };
layout(binding = 4, scalar) readonly buffer Shapes { uvec4 plane[]; } shapes[2];            // [gaussians] at most each
layout(binding = 5, scalar) readonly buffer Sh { uvec4 plane[]; } sh[SH_PLANES];            // [gaussians] at most each
layout(binding = 6, scalar) writeonly buffer Splats { Splat splats[]; };                    // [visible_capacity]
layout(push_constant, scalar) uniform Push {
    View view;
} push;

float depth_by_rule(vec3 mean) {
    return depth_of(mean, push.view);
}

#include "inspect/shade_splats.glsl"
