// A ray splat as the fast path stores it, in three or four elements of 16 bytes: with COMPACT, its colour is in 16-bit
// floats.
// Requires: rays/splat.glsl

layout(constant_id = 5) const bool COMPACT = false;
const uint SPLAT_WORDS = COMPACT ? 3 : 4;

// The words are those of RayForm in rays/form.glsl.
struct RayRecord {
    vec3 centre;
    float limit;   // the falloff beyond which the splat is not drawn, log2(opacity / ALPHA_MIN)
    vec3 factor;
    vec2 gamma;
    float kappa;
    vec3 colour;
    float chord;   // is not stored
};

uvec4 element(RayRecord splat, uint i) {
    if (i == 0) return floatBitsToUint(vec4(splat.centre, splat.limit));
    if (i == 1) return floatBitsToUint(vec4(splat.factor, splat.gamma.x));
    if (i == 3) return uvec4(floatBitsToUint(splat.colour.b), 0, 0, 0);
    uvec2 shape = floatBitsToUint(vec2(splat.gamma.y, splat.kappa));
    vec3 half_range = min(splat.colour, vec3(65504.0));
    return uvec4(shape, COMPACT ? uvec2(packHalf2x16(half_range.rg), packHalf2x16(vec2(half_range.b, 0.0)))
                                : floatBitsToUint(splat.colour.rg));
}

// A record without its colour.
RayRecord record_of(uvec4 first, uvec4 second, uvec4 third) {
    RayRecord record;
    record.centre = uintBitsToFloat(first.xyz);
    record.limit = uintBitsToFloat(first.w);
    record.factor = uintBitsToFloat(second.xyz);
    record.gamma = uintBitsToFloat(uvec2(second.w, third.x));
    record.kappa = uintBitsToFloat(third.y);
    record.colour = vec3(0.0);
    record.chord = 0.0;
    return record;
}

// The axes u and v of a splat, and q, for splats of a central or a parallel lens.
struct RayAxes {
    vec3 u;
    vec3 v;
    vec3 q;
};

RayAxes axes_of(RayRecord record, bool is_parallel) {
    Across of = across(is_parallel ? vec3(0.0, 0.0, 1.0) : record.centre);
    return RayAxes(axis_u(of, record.factor), axis_v(of, record.factor), depth_axis(of, record.gamma));
}
