#version 460
#include "shared/workgroup.glsl"
#include "rays/frame.glsl"
#include "shared/depth.glsl"
// One workgroup per chunk of 1024 Gaussians: marks those that may touch the image.
// Before: nothing. After: visible_masks has a bit per Gaussian, chunk_counts the number of bits set in each chunk.
// The test is a bound: a Gaussian that touches a ray is never dropped, some that do not are kept.

layout(binding = 0, scalar) readonly buffer Bounds { uvec4 bounds[]; };                     // [gaussians] mean, reach
layout(binding = 1, scalar) writeonly buffer VisibleMasks { uint visible_masks[]; };        // [chunks * 32]
layout(binding = 2, scalar) writeonly buffer ChunkCounts { uint chunk_counts[]; };          // [chunks]
layout(binding = 3, scalar) readonly buffer Cones { Cone cones[]; };                        // [cones]
layout(push_constant, scalar) uniform Push {
    View view;
    uint gaussians;
    uint is_parallel;
    float widest;  // of all footprints: the root of the sum of their variances
    uint cones;
} push;

#define IS_PARALLEL (push.is_parallel == 1)
#include "shared/marks.glsl"
#include "rays/view.glsl"

// The words of `bound` are those of shared/cull_test.glsl.
bool may_be_visible(uvec4 bound) {
    vec3 mean = uintBitsToFloat(bound.xyz);
    vec2 sizes = reach_and_deviations(bound.w);
    float reach = sizes.x, deviations = sizes.y;
    if (is_never_drawn(bound.w) || !(far_of(mean) > VIEW.near)) return false;
    vec3 p = view_axes(mean);
    float angle = 1.00001 * reach / unit_of(p) + deviations * sqrt(LOW_PASS) * push.widest;
    vec3 centre = centre_of(p);
    float chord = chord_of(angle);
    // Cones of so few cones are not opened.
    uint few = push.cones / 64;
    for (uint cone = 0; cone < push.cones;) {
        Cone c = cones[cone];
        vec4 sphere = uintBitsToFloat(c.sphere);
        bool is_met = distance(sphere.xyz, centre) <= chord + sphere.w;
        if (is_met && c.next - cone <= few + 1) return true;
        cone = is_met ? cone + 1 : c.next;
    }
    return false;
}

#include "portable/cull_chunk.glsl"
