// A splat as the fast path stores it, in two or three elements of 16 bytes: with COMPACT, its colour is in 16-bit
// floats.
// Requires: frame.glsl, rules.glsl

layout(constant_id = 5) const bool COMPACT = false;
const uint SPLAT_WORDS = COMPACT ? 2 : 3;

// The first two elements hold mean, factor and colour. In place of the opacity, `y` of the second is the falloff beyond
// which the splat is not drawn, log2(opacity / ALPHA_MIN): it keeps its precision where the opacity is hardly above
// ALPHA_MIN.
uvec4 element(Splat splat, uint i) {
    if (i == 0) return floatBitsToUint(vec4(splat.mean_px, splat.factor.xy));
    if (i == 2) return uvec4(floatBitsToUint(splat.colour.b), 0, 0, 0);
    vec2 shape = vec2(splat.factor.z, log2(splat.opacity / ALPHA_MIN));
    if (COMPACT) {
        vec3 colour = min(splat.colour, vec3(65504.0));
        return uvec4(floatBitsToUint(shape), packHalf2x16(colour.rg), packHalf2x16(vec2(colour.b, 0.0)));
    }
    return floatBitsToUint(vec4(shape, splat.colour.rg));
}
