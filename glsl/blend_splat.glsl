// What a splat does to a pixel: the arithmetic that all blends share, so that they agree bit for bit.
#include "rules.glsl"

// With HALF_ARITHMETIC, colours, alphas and transmittances are 16-bit floats; distances never are.
#ifdef HALF_ARITHMETIC
#extension GL_EXT_shader_explicit_arithmetic_types_float16 : require
#define real float16_t
#define real3 f16vec3
#define real4 f16vec4
#else
#define real float
#define real3 vec3
#define real4 vec4
#endif

layout(constant_id = 18) const float ALPHA_MAX = 0.99;
layout(constant_id = 19) const float TRANSMITTANCE_MIN = 1e-4;  // the splat that would take T below is not added
layout(constant_id = 20) const float STOP = 0.0;                // a pixel is finished once T is below

// -log2 of a weight over its opacity, as a sum of squares.
float falloff(vec3 factor, vec2 d) {
    precise float u = fma(factor.x, d.x, factor.y * d.y);
    precise float v = factor.z * d.y;
    precise float sum = fma(u, u, v * v);
    return sum;
}

// The falloff past which a splat of this opacity is not drawn.
float falloff_limit(float opacity) {
    float limit = log2(opacity / ALPHA_MIN);
    return EXTENT == EXTENT_THREE_SIGMA ? min(limit, 4.5 * LOG2_E) : limit;
}

// What a splat is blended with: its colour, and its limit.
real4 colour_and_limit(Splat splat) {
#ifdef HALF_ARITHMETIC
    // Far enough below the largest 16-bit float that no sum of shares rounds beyond it.
    splat.colour = min(splat.colour, vec3(32768.0));
#endif
    return real4(vec4(splat.colour, falloff_limit(splat.opacity)));
}

// Alpha where a splat of this opacity has this falloff, no more than its limit.
real alpha_at(float opacity, float fall) {
    precise real alpha = min(real(ALPHA_MAX), real(opacity * exp2(-fall)));
    return alpha;
}

// Blends a splat into a pixel; true if that ends the pixel. `weight`: factor, opacity; `look`: colour and limit.
bool blend_splat(vec2 mean, vec4 weight, real4 look, vec2 pixel, inout real3 colour, inout real transmittance) {
    float fall = falloff(weight.xyz, pixel - mean);
    if (!(fall <= float(look.w))) return false;
    real alpha = alpha_at(weight.w, fall);
    precise real rest = transmittance * (real(1.0) - alpha);
    if (rest < real(TRANSMITTANCE_MIN)) return true;
    precise real share = alpha * transmittance;
    precise real3 added = fma(look.rgb, real3(share), colour);
    colour = added;
    transmittance = rest;
    return STOP > 0.0 && rest < real(STOP);
}
