#version 460
#include "shared/workgroup.glsl"
// One workgroup: tests whether exp2 returns 0 instead of a denormal number.
// After: powers has the exp2 of exponents. They come from a buffer, since a compiler evaluates exp2 of a constant by the
// rules of the host.

layout(binding = 0, scalar) readonly buffer Exponents { float exponents[]; };  // [WORKGROUP]
layout(binding = 1, scalar) writeonly buffer Powers { float powers[]; };       // [WORKGROUP]

void main() {
    powers[lane()] = exp2(exponents[lane()]);
}
