#version 460
#include "shared/workgroup.glsl"
// One workgroup: computes terms that a compiler which treats floats as real numbers changes.
// Before: numbers. After: results has, for each number x, what remains of it after rounding to 16 bits, and one step of
// the transmittance of blend, with a constant so large that its square is infinite.

const float LARGEST = 3.336e35;  // 2^126 / 255

layout(binding = 0, scalar) readonly buffer Numbers { float numbers[]; };  // [WORKGROUP] from 0.5 to 1
layout(binding = 1, scalar) writeonly buffer Results { vec2 results[]; };  // [WORKGROUP]

void main() {
    float x = numbers[lane()];
    float rest = x - unpackHalf2x16(packHalf2x16(vec2(x, 0.0))).x;
    float weight = exp2(-125.0 - x) * LARGEST;
    results[lane()] = vec2(rest, fma(-LARGEST, weight, LARGEST));
}
