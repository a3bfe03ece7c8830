// The effect of a splat on a pixel: the arithmetic that all blends of this path share, so that they agree bit for bit.
// Requires: frame.glsl
#include "shared/rules.glsl"
#include "shared/blend_rules.glsl"

// -log2(weight / opacity) at the offset `d` from the mean (px), as a sum of squares.
float falloff(vec3 factor, vec2 d) {
    precise float u = fma(factor.x, d.x, factor.y * d.y);
    precise float v = factor.z * d.y;
    precise float sum = fma(u, u, v * v);
    return sum;
}

// The falloff beyond which a splat of this opacity is not drawn.
float falloff_limit(float opacity) {
    float limit = log2(opacity / ALPHA_MIN);
    return EXTENT == EXTENT_THREE_SIGMA ? min(limit, 4.5 * LOG2_E) : limit;
}

// (colour, falloff limit) of a splat.
vec4 colour_and_limit(Splat splat) {
    return vec4(splat.colour, falloff_limit(splat.opacity));
}

// Alpha of a splat of this opacity at this falloff, which is at most its limit.
float alpha_at(float opacity, float fall) {
    precise float alpha = min(ALPHA_MAX, opacity * exp2(-fall));
    return alpha;
}

// Blends a splat with this falloff into a pixel. Returns true if the pixel stops. `look`: colour and falloff limit.
bool blend_falloff(float fall, float opacity, vec4 look, inout vec3 colour, inout float transmittance) {
    if (!(fall <= look.w)) return false;
    float alpha = alpha_at(opacity, fall);
    precise float rest = transmittance * (1.0 - alpha);
    if (rest < TRANSMITTANCE_MIN) return true;
    precise float share = alpha * transmittance;
    precise vec3 added = fma(look.rgb, vec3(share), colour);
    colour = added;
    transmittance = rest;
    return STOP > 0.0 && rest < STOP;
}

// Blends a splat into a pixel, likewise. `weight`: factor, opacity.
bool blend_splat(vec2 mean, vec4 weight, vec4 look, vec2 pixel, inout vec3 colour, inout float transmittance) {
    return blend_falloff(falloff(weight.xyz, pixel - mean), weight.w, look, colour, transmittance);
}
