#version 460
#include "shared/workgroup.glsl"
// One workgroup per EXAMINED_GAUSSIANS Gaussians: counts those with values that need the host, and finds what the
// layout of the scene follows from.
// Before: `words` holds the arrays. After: `findings` has an element per workgroup, about Gaussians with an opacity
// over 0; doubles are in two words.

layout(constant_id = 3) const uint COEFFICIENTS = 16;
layout(binding = 0, scalar) readonly buffer Words { uint words[]; };  // [(11 + 3 COEFFICIENTS) gaussians]
struct Examined {
    uint flawed;           // Gaussians with values that the host has to judge; all else holds only if there are none
    uint kept;             // Gaussians with an opacity over 0
    uint high[3];          // largest coordinates of means, as ordered keys
    uint low[3];           // the complements of the keys of the smallest ones
    uint largest_scale;    // bits of a float
    uint smallest_scale;   // the complement of the bits of the smallest scale over 0; 0 if there is none
    uint flat_shapes;      // 1 if a scale is 0
    uint opacity;          // bits of the highest opacity
    uvec2 brightest;       // largest bound on a colour channel
    uvec2 widest;          // largest sum of the bounds of a channel
    uvec2 bounds[5];       // for each SH degree, the largest bound on its part of a channel
    uvec2 squares[5];      // for each SH degree, the sum of the mean squares of its parts
};
layout(binding = 1, scalar) writeonly buffer Findings { Examined findings[]; };  // [workgroups]
layout(push_constant, scalar) uniform Push {
    uint gaussians;
} push;

#include "shared/ordered.glsl"
#include "arrays/arrays.glsl"
#include "arrays/examined.glsl"

const uint DEGREES = 5;
const double BASIS_0 = 0.28209479177387814LF;  // the constant basis function
const double FOUR_PI = 12.566370614359172LF;

// What a lane or a workgroup found. Largest values: 0 to 2 high, 3 to 5 low, then as named in Examined.
const uint LARGEST_SCALE = 6, SMALLEST_SCALE = 7, FLAT_SHAPES = 8, OPACITY = 9, LARGEST = 10;
shared uint largest[LARGEST];
shared uint flawed, kept;
shared double parts[WORKGROUP];

// True if the host has to judge the mean, the rotation, a scale or the opacity.
bool is_shape_flawed(uint gaussian) {
    bool is_flawed = !(abs(uintBitsToFloat(given_opacity(gaussian)) - 0.5) <= 0.5 + ARRAYS_OPACITY_EXCESS);
    uint quaternion = 0;
    for (uint i = 0; i < 4; i++) {
        uint component = magnitude(quaternion_word(gaussian, i));
        is_flawed = is_flawed || component >= INFINITE;
        quaternion |= component;
    }
    for (uint i = 0; i < 3; i++) {
        // The bits of negative floats are larger.
        is_flawed = is_flawed || scale_word(gaussian, i) >= INFINITE;
        is_flawed = is_flawed || magnitude(mean_word(gaussian, i)) > floatBitsToUint(ARRAYS_MEAN);
    }
    return is_flawed || quaternion == 0;
}

// The largest of the values of all lanes. The whole workgroup must call it.
double largest_of_lanes(double value) {
    barrier();  // lanes may still read the parts of an earlier call
    parts[lane()] = value;
    for (uint step = WORKGROUP / 2; step > 0; step /= 2) {
        barrier();
        if (lane() < step) parts[lane()] = max(parts[lane()], parts[lane() + step]);
    }
    barrier();
    return parts[0];
}

// The sum of the values of all lanes, in a fixed order. The whole workgroup must call it.
double sum_of_lanes(double value) {
    barrier();  // lanes may still read the parts of an earlier call
    parts[lane()] = value;
    for (uint step = WORKGROUP / 2; step > 0; step /= 2) {
        barrier();
        if (lane() < step) parts[lane()] += parts[lane() + step];
    }
    barrier();
    return parts[0];
}

void main() {
    if (lane() < LARGEST) largest[lane()] = 0;
    if (lane() == 0) flawed = kept = 0;
    barrier();
    uint found[LARGEST];
    for (uint i = 0; i < LARGEST; i++) found[i] = 0;
    double bounds[DEGREES], squares[DEGREES];
    for (uint l = 0; l < DEGREES; l++) bounds[l] = squares[l] = 0.0LF;
    double brightest = 0.0LF, widest = 0.0LF;
    uint first = workgroup() * EXAMINED_GAUSSIANS;
    for (uint part = 0; part < EXAMINED_GAUSSIANS / WORKGROUP; part++) {
        uint gaussian = first + part * WORKGROUP + lane();
        if (gaussian >= push.gaussians) break;
        bool is_flawed = is_shape_flawed(gaussian);
        uint opacity = opacity_bits(gaussian);
        precise dvec3 channel = dvec3(0.5LF);
        dvec3 sums = dvec3(0.0LF), higher = dvec3(0.0LF);
        for (uint l = 0; l * l < COEFFICIENTS; l++) {
            precise dvec3 lengths = dvec3(0.0LF);
            for (uint i = l * l; i < (l + 1) * (l + 1); i++) {
                dvec3 value;
                for (uint c = 0; c < 3; c++) {
                    uint bits = sh_word(gaussian, 3 * i + c);
                    is_flawed = is_flawed || magnitude(bits) >= floatBitsToUint(ARRAYS_SH);
                    value[c] = wide(bits);
                }
                if (i == 0) channel += BASIS_0 * value;
                lengths += value * value;
            }
            // The bound is that of `bands` in src/scene/requirements.rs, and the mean square that of `of_channel`.
            dvec3 bound = sqrt(lengths * double(2 * l + 1) / FOUR_PI);
            sums += bound;
            if (l > 0) higher += bound;
            if (opacity > 0) {
                bounds[l] = max(bounds[l], max(bound.x, max(bound.y, bound.z)));
                squares[l] += dot(bound, bound) / double(2 * l + 1);
            }
        }
        if (is_flawed) atomicAdd(flawed, 1);
        if (opacity == 0) continue;
        atomicAdd(kept, 1);
        channel += higher;
        brightest = max(brightest, max(channel.x, max(channel.y, channel.z)));
        widest = max(widest, max(sums.x, max(sums.y, sums.z)));
        found[OPACITY] = max(found[OPACITY], opacity);
        for (uint i = 0; i < 3; i++) {
            uint key = ordered(mean_word(gaussian, i)), scale = scale_word(gaussian, i);
            found[i] = max(found[i], key);
            found[3 + i] = max(found[3 + i], ~key);
            found[LARGEST_SCALE] = max(found[LARGEST_SCALE], scale);
            if (scale > 0) found[SMALLEST_SCALE] = max(found[SMALLEST_SCALE], ~scale);
            if (scale == 0) found[FLAT_SHAPES] = 1;
        }
    }
    // The largest of some numbers does not depend on their order.
    for (uint i = 0; i < LARGEST; i++) atomicMax(largest[i], found[i]);
    Examined all;
    all.brightest = unpackDouble2x32(largest_of_lanes(brightest));
    all.widest = unpackDouble2x32(largest_of_lanes(widest));
    for (uint l = 0; l < DEGREES; l++) {
        all.bounds[l] = unpackDouble2x32(largest_of_lanes(bounds[l]));
        all.squares[l] = unpackDouble2x32(sum_of_lanes(squares[l]));
    }
    if (lane() > 0 || IS_SURPLUS(div_up(push.gaussians, EXAMINED_GAUSSIANS))) return;
    all.flawed = flawed;
    all.kept = kept;
    for (uint i = 0; i < 3; i++) {
        all.high[i] = largest[i];
        all.low[i] = largest[3 + i];
    }
    all.largest_scale = largest[LARGEST_SCALE];
    all.smallest_scale = largest[SMALLEST_SCALE];
    all.flat_shapes = largest[FLAT_SHAPES];
    all.opacity = largest[OPACITY];
    findings[workgroup()] = all;
}
