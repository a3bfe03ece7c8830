#version 460
#include "shared/workgroup.glsl"
#define VALUE float
#define FROM(number) (number)
#define BITS(value) floatBitsToUint(value)
layout(constant_id = 0) const uint OPERATION = 0;  // a case of applied
layout(constant_id = 1) const uint UNROLLED = 4;   // applications to each value in a round
#include "bench/chains.glsl"
// One invocation: applies an operation on 32-bit numbers again and again.
// Before: numbers. After: results.

VALUE applied(VALUE a, VALUE b, VALUE c, uint address) {
    float exponent = fma(a, b, -c);
    vec2 unpacked = unpackHalf2x16(floatBitsToUint(a));
    vec4 loaded = shared_values[address];
    uint neighbour = (gl_SubgroupInvocationID * 7 + floatBitsToUint(c)) % gl_SubgroupSize;
    VALUE next = a;
    switch (OPERATION) {
        case 0: next = fma(a, b, c); break;
        case 1: next = exp2(-a); break;
        case 2: next = exp2(exponent); break;
        case 3: next = exponent >= -1.0 ? exp2(exponent) : 0.0; break;
        case 4: next = uintBitsToFloat(packHalf2x16(vec2(a, b))); break;
        case 5: next = unpacked.x + unpacked.y; break;
        case 6: next = subgroupShuffleXor(a, 1) * b; break;
        case 7: next = subgroupShuffle(a, neighbour) * b; break;
        case 8: next = subgroupAny(a > b) ? a * b : c; break;
        case 9: next = a + loaded.x; break;
        case 10: next = fma(a, loaded.x, loaded.y); break;
        case 11: next = fma(a, loaded.x, loaded.y) + loaded.z * loaded.w; break;
    }
    return next;
}
