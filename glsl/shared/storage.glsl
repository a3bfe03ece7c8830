#extension GL_EXT_control_flow_attributes : require
// A Gaussian's attributes, unpacked from the words that they are stored in (src/packing/layout.rs).
// Requires: harmonics.glsl, shapes[], sh[], grids

#include "shared/formats.glsl"

// The value of a number that is stored in 8 bits; `grid` is (offset, step).
float on_grid(vec2 grid, uint number) {
    return fma(grid.y, float(number), grid.x);
}

// Component `i` of a packed rotation, in bits [10 i, 10 i + 10): a sign and nine bits of magnitude up to sqrt(1/2).
float small_component(uint packed, int i) {
    float magnitude = float(bitfieldExtract(packed, 10 * i, 9)) * (0.70710678118654752 / 511.0);
    return bitfieldExtract(packed, 10 * i + 9, 1) == 0 ? magnitude : -magnitude;
}

// Unpacks a unit quaternion (w, x, y, z), stored without its largest component, whose index is in the upper two bits.
vec4 unpack_rotation(uint packed) {
    vec3 others = vec3(small_component(packed, 2), small_component(packed, 1), small_component(packed, 0));
    float largest = sqrt(max(1.0 - dot(others, others), 0.0));
    switch (packed >> 30) {
        case 0: return vec4(largest, others);
        case 1: return vec4(others.x, largest, others.yz);
        case 2: return vec4(others.xy, largest, others.z);
        default: return vec4(others, largest);
    }
}

// Scales of 16 bits without sign: the upper bits of a 32-bit float, less a base; 0 stands for 0.
vec3 unpack_scale(uvec3 code) {
    return mix(uintBitsToFloat((code + uint(grids.scale_base)) << 13), vec3(0.0), equal(code, uvec3(0)));
}

void load_shape(uint gaussian, out vec4 rotation, out vec3 scale, out float opacity) {
    if (SHAPE_STORAGE == STORED_F32) {
        rotation = uintBitsToFloat(shapes[0].plane[gaussian]);
        vec4 rest = uintBitsToFloat(shapes[1].plane[gaussian]);
        scale = rest.xyz;
        opacity = rest.w;
    } else if (SHAPE_STORAGE == STORED_F16) {
        uvec4 words = shapes[0].plane[gaussian];
        rotation = normalize(vec4(unpackHalf2x16(words.x), unpackHalf2x16(words.y)));
        scale = unpack_scale(uvec3(words.z & 0xffff, words.z >> 16, words.w & 0xffff));
        opacity = unpackHalf2x16(words.w).y;
    } else {
        uvec4 two = shapes[0].plane[gaussian / 2];
        uvec2 words = gaussian % 2 == 0 ? two.xy : two.zw;
        for (int i = 0; i < 3; i++) scale[i] = exp2(on_grid(grids.log2_scale, bitfieldExtract(words.x, 8 * i, 8)));
        opacity = float(words.x >> 24) / 255.0;
        rotation = unpack_rotation(words.y);
    }
}

// An element that several Gaussians share, with the words of this Gaussian moved to the front.
uvec4 own_part(uvec4 element, uint gaussian) {
    if (SH_SHARE == 2) return gaussian % 2 == 0 ? element : element.zwxy;
    if (SH_SHARE == 4) return uvec4(element[gaussian % 4], 0, 0, 0);
    return element;
}

// Unpacks a word of four 8-bit numbers; `first` is the index of the first among the floats of the spherical harmonics.
vec4 unpack_bytes(uint word, uint first) {
    vec4 floats;
    for (uint k = 0; k < 4; k++) {
        floats[k] = on_grid(grids.sh[min((first + k) / 3, SH_FUNCTIONS - 1)], bitfieldExtract(word, int(8 * k), 8));
    }
    return floats;
}

// Loads the words of a Gaussian's spherical harmonics.
void fetch_sh(uint gaussian, out uvec4 stored[SH_VECTORS]) {
    // With literal indices everything stays in registers, and a scene with fewer planes loads fewer.
    if (SH_STORED_VECTORS <= SH_PLANES) {
#define LOAD(i) \
        if (i + 1 < SH_STORED_VECTORS) stored[i] = sh[i].plane[gaussian]; \
        if (i + 1 == SH_STORED_VECTORS) stored[i] = own_part(sh[i].plane[gaussian / SH_SHARE], gaussian);
        LOAD(0) LOAD(1) LOAD(2) LOAD(3) LOAD(4) LOAD(5) LOAD(6) LOAD(7) LOAD(8) LOAD(9) LOAD(10) LOAD(11)
#undef LOAD
    } else {
#define LOAD(i) \
        stored[2 * i] = sh[i].plane[2 * gaussian]; \
        stored[2 * i + 1] = sh[i].plane[2 * gaussian + 1];
        LOAD(0) LOAD(1) LOAD(2) LOAD(3) LOAD(4) LOAD(5) LOAD(6) LOAD(7) LOAD(8)
#undef LOAD
        stored[18] = sh[9].plane[gaussian];
    }
}

// Unpacks all coefficients without gaps; those of degrees that are not stored are 0.
void unpack_sh(uvec4 stored[SH_VECTORS], out vec4 floats[SH_VECTORS]) {
    for (uint i = 0; i < SH_VECTORS; i++) floats[i] = vec4(0.0);
#define UNPACK(i) \
    if (4 * i < SH_FLOATS) { \
        if (SH_STORAGE == STORED_F32) floats[i] = uintBitsToFloat(stored[i]); \
        if (SH_STORAGE == STORED_F16) { \
            floats[i] = vec4(unpackHalf2x16(stored[i / 2][2 * i % 4]), unpackHalf2x16(stored[i / 2][2 * i % 4 + 1])); \
        } \
        if (SH_STORAGE == STORED_U8) floats[i] = unpack_bytes(stored[i / 4][i % 4], 4 * i); \
    }
    UNPACK(0) UNPACK(1) UNPACK(2) UNPACK(3) UNPACK(4) UNPACK(5)
    UNPACK(6) UNPACK(7) UNPACK(8) UNPACK(9) UNPACK(10) UNPACK(11)
    UNPACK(12) UNPACK(13) UNPACK(14) UNPACK(15) UNPACK(16) UNPACK(17) UNPACK(18)
#undef UNPACK
}

void load_sh(uint gaussian, out vec4 floats[SH_VECTORS]) {
    uvec4 stored[SH_VECTORS];
    fetch_sh(gaussian, stored);
    unpack_sh(stored, floats);
}

// The colour seen in the unit direction `d`, from the words of `fetch_sh`.
vec3 stored_colour(uvec4 stored[SH_VECTORS], vec3 d) {
    if (SH_STORAGE != STORED_U8) {
        vec4 floats[SH_VECTORS];
        unpack_sh(stored, floats);
        return harmonics_colour(floats, SH_DEGREE, d);
    }
    // All channels of a coefficient have one grid, so it is multiplied into the basis function once.
    float basis[SH_FUNCTIONS] = harmonics_basis(SH_DEGREE, d);
    vec3 colour = NO_HARMONICS;
    [[unroll]] for (uint i = 0; i < SH_FLOATS / 3; i++) {
        vec3 numbers;
        [[unroll]] for (uint c = 0; c < 3; c++) {
            uint place = 3 * i + c;
            numbers[c] = float(bitfieldExtract(stored[place / 16][place / 4 % 4], int(8 * (place % 4)), 8));
        }
        colour += basis[i] * grids.sh[i].x + basis[i] * grids.sh[i].y * numbers;
    }
    return colour_of_sum(colour);
}
