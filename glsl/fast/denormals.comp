#version 460
#include "shared/workgroup.glsl"
// One workgroup: computes powers of two, which show whether the device flushes denormal numbers.
// Before: exponents. After: powers has their exp2.
// The exponents come from a buffer, since a compiler evaluates exp2 of a constant by the rules of the host.

layout(binding = 0, scalar) readonly buffer Exponents { float exponents[]; };  // [WORKGROUP]
layout(binding = 1, scalar) writeonly buffer Powers { float powers[]; };       // [WORKGROUP]

void main() {
    powers[lane()] = exp2(exponents[lane()]);
}
