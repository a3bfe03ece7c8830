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

#include "shared/storage.glsl"

// `Attribute` in src/render/inspect/inspector.rs documents the attributes and their units.

// The shortest axis in world space, turned to the camera; the first one if several are equally short.
vec3 normal_of(vec4 rotation, vec3 scale, vec3 from_camera) {
    uint shortest = scale.y < scale.x ? 1 : 0;
    if (scale.z < scale[shortest]) shortest = 2;
    vec3 normal = rotation_matrix(rotation)[shortest];
    return dot(normal, from_camera) > 0.0 ? -normal : normal;
}

// log2 of a length; a length of 0 counts as the smallest normal float.
float log2_length(float length) {
    return log2(max(length, 1.17549435e-38));
}

// A colour unrelated to those of neighbouring numbers (the permutation of PCG, O'Neill 2014), and not too dark.
vec3 colour_of_number(uint number) {
    uint state = number * 747796405u + 2891336453u;
    uint word = ((state >> ((state >> 28) + 4)) ^ state) * 277803737u;
    uint hash = (word >> 22) ^ word;
    return 0.2 + 0.8 / 255.0 * vec3(hash & 0xff, hash >> 8 & 0xff, hash >> 16 & 0xff);
}

vec3 attribute_of(uint gaussian) {
    vec3 mean = uintBitsToFloat(bounds[gaussian].xyz);
    vec4 rotation;
    vec3 scale;
    float opacity;
    load_shape(gaussian, rotation, scale, opacity);
    float longest = max(scale.x, max(scale.y, scale.z)), shortest = min(scale.x, min(scale.y, scale.z));
    switch (ATTRIBUTE) {
        case ATTRIBUTE_DEPTH: return vec3(depth_of(mean, push.view));
        case ATTRIBUTE_NORMAL: return 0.5 + 0.5 * normal_of(rotation, scale, mean - push.view.position_high);
        case ATTRIBUTE_OPACITY: return vec3(opacity);
        case ATTRIBUTE_SIZE: return vec3(log2_length(longest));
        case ATTRIBUTE_ANISOTROPY: return vec3(log2_length(longest) - log2_length(shortest));
        case ATTRIBUTE_BASE_COLOUR: {
            vec4 planes[SH_PLANES];
            load_sh(gaussian, planes);
            return harmonics_colour(planes, 0, vec3(0.0));
        }
        default: return colour_of_number(gaussian);
    }
}

void main() {
    uint index = workgroup() * WORKGROUP + lane();
    if (index < totals.visible_kept) splats[index].colour = attribute_of(gaussian_from_splat[index]);
}
