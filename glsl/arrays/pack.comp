#version 460
#include "shared/workgroup.glsl"
// One invocation per Gaussian: packs its canonical values, in 32-bit or 16-bit floats.
// Before: `words` holds the arrays, in which `examine` found no flaw; planes of spherical harmonics that the layout
// does not have repeat the last one. After: the planes hold the words of src/packing/planes.rs. A Gaussian with the
// opacity 0 has a reach below 0, with which it is never drawn.

layout(constant_id = 3) const uint COEFFICIENTS = 16;
#include "shared/harmonics.glsl"
#include "shared/formats.glsl"
layout(binding = 0, scalar) readonly buffer Words { uint words[]; };     // [(11 + 3 COEFFICIENTS) gaussians]
layout(binding = 1, scalar) writeonly buffer Bounds { uvec4 bounds[]; };  // [gaussians]
layout(binding = 2, scalar) writeonly buffer Shapes { uvec4 plane[]; } shapes[2];
layout(binding = 3, scalar) writeonly buffer Sh { uvec4 plane[]; } sh[SH_PLANES];
layout(push_constant, scalar) uniform Push {
    uint gaussians;
    float alpha_min;  // Gaussians with lower opacities may be culled
    uint scale_base;  // of 16-bit scales
} push;

#include "arrays/arrays.glsl"

// The natural logarithm of a number of at least 1. GLSL has none in 64 bits.
double logarithm(double x) {
    const double LN_2 = 0.69314718055994530942LF, ROOT_2 = 1.41421356237309504880LF;
    uvec2 bits = unpackDouble2x32(x);
    int exponent = int(bits.y >> 20) - 1023;
    double mantissa = packDouble2x32(uvec2(bits.x, bits.y & 0xfffffu | 0x3ff00000u));
    if (mantissa > ROOT_2) {
        mantissa *= 0.5LF;
        exponent++;
    }
    // ln m = 2 artanh((m - 1) / (m + 1)); |s| < 0.172, and the first term that is left out is below 2^-60 of the sum.
    double s = (mantissa - 1.0LF) / (mantissa + 1.0LF), square = s * s, sum = 0.0LF;
    for (int k = 23; k > 0; k -= 2) sum = sum * square + 1.0LF / double(k);
    return double(exponent) * LN_2 + 2.0LF * s * sum;
}

// The bits of the least bfloat16 that is not less than `value`, which is not negative.
uint upper_half(double value) {
    uint bits = floatBitsToUint(float(value * (1.0LF + 1e-6LF)));
    return div_up(bits, 1 << 16);
}

// Two bfloat16, rounded up: `reach` in src/packing/planes.rs.
uint reach(uint longest, double opacity) {
    double alpha_min = wide(floatBitsToUint(push.alpha_min));
    if (opacity < alpha_min) return floatBitsToUint(-1.0);
    precise double deviations = sqrt(2.0LF * logarithm(opacity / alpha_min));
    precise double world = deviations * wide(longest);
    return upper_half(world) << 16 | upper_half(deviations);
}

// The nearest finite 16-bit float, ties to even.
uint half_bits(uint bits) {
    uint most = 0x477fe000u;  // 65504.0
    uint size = min(magnitude(bits), most), sign = (bits & SIGN) >> 16;
    if (size >= 0x38800000u) return sign | (size - 0x38000000u + 0xfff + (size >> 13 & 1)) >> 13;
    if (size <= 0x33000000u) return sign;  // at most half of the smallest one
    uint shift = 126 - (size >> 23), mantissa = size & 0x7fffffu | 0x800000u;
    return sign | (mantissa + (1 << (shift - 1)) - 1 + (mantissa >> shift & 1)) >> shift;
}

uint halves(uint low, uint high) {
    return half_bits(low) | half_bits(high) << 16;
}

double half_value(uint bits) {
    return bits >= 0x400u ? double(unpackHalf2x16(bits).x) : double(bits) * 5.9604644775390625e-8LF;  // 2^-24
}

// Scales of 16 bits: `scale_code` in src/packing/halves.rs.
uint scale_code(uint bits) {
    uint upper = min((bits + 0xfff + (bits >> 13 & 1)) >> 13, 0x7f7fffffu >> 13);
    return upper - min(upper, push.scale_base);
}

// The bits of the unit quaternion: `unit` in src/scene/stored.rs.
uvec4 rotation_bits(uint gaussian) {
    uvec4 given;
    dvec4 q;
    for (uint i = 0; i < 4; i++) {
        given[i] = quaternion_word(gaussian, i);
        q[i] = wide(given[i]);
    }
    precise double squares = q.x * q.x + q.y * q.y + q.z * q.z + q.w * q.w;
    if (abs(squares - 1.0LF) < 2.4e-7LF) return given;
    dvec4 sizes = abs(q);
    precise dvec4 scaled = q / max(max(sizes.x, sizes.y), max(sizes.z, sizes.w));
    precise double length = scaled.x * scaled.x + scaled.y * scaled.y + scaled.z * scaled.z + scaled.w * scaled.w;
    return floatBitsToUint(vec4(scaled / sqrt(length)));
}

void pack_shape(uint gaussian) {
    uvec3 mean = uvec3(mean_word(gaussian, 0), mean_word(gaussian, 1), mean_word(gaussian, 2));
    uvec3 scale = uvec3(scale_word(gaussian, 0), scale_word(gaussian, 1), scale_word(gaussian, 2));
    uvec4 rotation = rotation_bits(gaussian);
    uint opacity = opacity_bits(gaussian);
    double drawn = wide(opacity);
    if (SHAPE_STORAGE == STORED_F32) {
        shapes[0].plane[gaussian] = rotation;
        shapes[1].plane[gaussian] = uvec4(scale, opacity);
    } else {
        uvec3 code = uvec3(scale_code(scale.x), scale_code(scale.y), scale_code(scale.z));
        uint stored = half_bits(opacity);
        shapes[0].plane[gaussian] = uvec4(
            halves(rotation.x, rotation.y), halves(rotation.z, rotation.w),
            code.x | code.y << 16, code.z | stored << 16);
        scale = mix((code + push.scale_base) << 13, uvec3(0), equal(code, uvec3(0)));
        // A Gaussian that is too faint to be drawn stays so.
        if (drawn >= wide(floatBitsToUint(push.alpha_min))) drawn = half_value(stored);
    }
    bounds[gaussian] = uvec4(mean, reach(max(scale.x, max(scale.y, scale.z)), drawn));
}

// Word `i` of the packed spherical harmonics.
uint packed_word(uint gaussian, uint i) {
    if (i >= SH_WORDS || gaussian >= push.gaussians) return 0;
    if (SH_STORAGE == STORED_F32) return sh_word(gaussian, i);
    return halves(sh_word(gaussian, 2 * i), 2 * i + 1 < SH_FLOATS ? sh_word(gaussian, 2 * i + 1) : 0);
}

uvec4 packed_vector(uint gaussian, uint i) {
    return uvec4(
        packed_word(gaussian, 4 * i), packed_word(gaussian, 4 * i + 1),
        packed_word(gaussian, 4 * i + 2), packed_word(gaussian, 4 * i + 3));
}

// The last vector; the first of two Gaussians that share an element packs both.
void pack_last(uint gaussian, out uvec4 element, out bool is_own) {
    element = packed_vector(gaussian, SH_STORED_VECTORS - 1);
    is_own = SH_SHARE == 1 || gaussian % 2 == 0;
    if (SH_SHARE == 2) {
        element.zw = uvec2(packed_word(gaussian + 1, SH_WORDS - 2), packed_word(gaussian + 1, SH_WORDS - 1));
    }
}

void pack_sh(uint gaussian) {
    uvec4 last;
    bool is_own;
    pack_last(gaussian, last, is_own);
    // With literal indices a scene with fewer planes needs no others.
    if (SH_STORED_VECTORS <= SH_PLANES) {
#define STORE(i) \
        if (i + 1 < SH_STORED_VECTORS) sh[i].plane[gaussian] = packed_vector(gaussian, i); \
        if (i + 1 == SH_STORED_VECTORS && is_own) sh[i].plane[gaussian / SH_SHARE] = last;
        STORE(0) STORE(1) STORE(2) STORE(3) STORE(4) STORE(5)
        STORE(6) STORE(7) STORE(8) STORE(9) STORE(10) STORE(11)
#undef STORE
    } else {
#define STORE(i) \
        sh[i].plane[2 * gaussian] = packed_vector(gaussian, 2 * i); \
        sh[i].plane[2 * gaussian + 1] = packed_vector(gaussian, 2 * i + 1);
        STORE(0) STORE(1) STORE(2) STORE(3) STORE(4) STORE(5) STORE(6) STORE(7) STORE(8)
#undef STORE
        sh[9].plane[gaussian] = last;
    }
}

void main() {
    uint gaussian = workgroup() * WORKGROUP + lane();
    if (gaussian >= push.gaussians) return;
    pack_shape(gaussian);
    pack_sh(gaussian);
}
