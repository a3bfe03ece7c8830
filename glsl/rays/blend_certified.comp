#version 460
#include "shared/workgroup.glsl"
#include "rays/frame.glsl"
#include "portable/blend_splat.glsl"
// One workgroup per 16x16 tile, one invocation per pixel: blends the tile's list front to back as rays/blend.comp
// does, bit for bit, with a bound on the error of every pixel; 0 where a pixel has no ray.
// Before: ranges and sorted splat_ids, of splats that are listed wherever their alpha reaches the listing threshold.
// After: image = (colour over the background, 1 - T), certificate = the bound on every channel. Between the passes of a
// long list, image holds what it holds in blend.comp, and certificate (sum, brightest colour, number of terms so far).

layout(constant_id = 1) const bool RESUME = false;  // not the first pass

layout(binding = 0, scalar) readonly buffer Ranges { uvec2 ranges[]; };                     // [tiles]
layout(binding = 1, scalar) readonly buffer SplatIds { uint splat_ids[]; };                 // [instance_capacity]
layout(binding = 2, scalar) readonly buffer Splats { RaySplat splats[]; };                  // [visible_capacity]
layout(binding = 3, scalar) buffer TotalsBlock { Totals totals; };
layout(binding = 4, rgba32f) uniform image2D image;
layout(binding = 5, rgba32f) uniform image2D certificate;
layout(binding = 6, scalar) readonly buffer Rays { vec3 rays[]; };                          // [pixels] 0 if none
layout(push_constant, scalar) uniform Push {
    uvec2 size_px;
    uint tiles;
    vec3 background;
    uint pass_begin;   // instances of each list that earlier passes blended
    uint pass_limit;   // instances of a list that this pass may blend
    uint last_pass;    // 1: finish the pixels
    float unlisted;    // upper bound on the sum of all contributions below the listing threshold
} push;

#include "rays/staged.glsl"

const float ULP = 1.1920929e-7;  // of 1.0

// Upper bound on the error of an alpha by f32 rounding. Rays, centres and the entries of u, v, q and kappa are off by a
// few units in the last place, so |s| and w of falloff_along lie in intervals. `fall` may be that of a ray that leads
// away from the splat, by rounding alone.
float rounding(uint i, PLACE ray, float fall, float alpha) {
    RaySplat splat = staged[i];
    vec3 e = ray - splat.centre;
    float s = dot(splat.u, e), t = dot(splat.v, e), w = dot(splat.q, ray), far = length(vec2(s, t));
    float shift = 16.0 * ULP * (length(ray) + length(splat.centre));
    float around = 16.0 * ULP * (dot(abs(splat.u), abs(e)) + dot(abs(splat.v), abs(e)));
    float moved = around + (length(splat.u) + length(splat.v)) * shift, along = length(splat.q) * shift;
    float nearest = max(far - moved, 0.0), farthest = far + moved;
    float least = falloff_of(nearest * nearest, w + along, splat.kappa * (1.0 + 16.0 * ULP));
    float most = falloff_of(farthest * farthest, w - along, splat.kappa * (1.0 - 16.0 * ULP));
    float high = min(ALPHA_MAX, splat.opacity * exp2(-least)), low = min(ALPHA_MAX, splat.opacity * exp2(-most));
    return max(high - alpha, alpha - low) + (6.0 + 6.0 * min(least, 100.0)) * ULP * high;
}

#include "portable/certify_tile.glsl"
