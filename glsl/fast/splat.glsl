// A splat as the fast path keeps it, in two or three elements: with COMPACT, its colour is in 16-bit floats.
// Behind frame.glsl and rules.glsl.

layout(constant_id = 5) const bool COMPACT = false;
const uint SPLAT_WORDS = COMPACT ? 2 : 3;

// The first two elements: mean and factor, and in `second.y` the falloff past which it is not drawn,
// log2(opacity / ALPHA_MIN), which keeps its digits where the opacity is hardly more than ALPHA_MIN.
uvec4 first_element(Splat splat) {
    return floatBitsToUint(vec4(splat.mean_px, splat.factor.xy));
}

uvec4 second_element(Splat splat) {
    vec2 shape = vec2(splat.factor.z, log2(splat.opacity / ALPHA_MIN));
    if (COMPACT) {
        vec3 colour = min(splat.colour, vec3(65504.0));
        return uvec4(floatBitsToUint(shape), packHalf2x16(colour.rg), packHalf2x16(vec2(colour.b, 0.0)));
    }
    return floatBitsToUint(vec4(shape, splat.colour.rg));
}

uvec4 third_element(Splat splat) {
    return uvec4(floatBitsToUint(splat.colour.b), 0, 0, 0);
}
