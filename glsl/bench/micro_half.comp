#version 460
#extension GL_EXT_shader_explicit_arithmetic_types_float16 : require
#include "shared/workgroup.glsl"
#define VALUE f16vec2
#define FROM(number) f16vec2(vec2(number, 0.9 * (number)))
#define BITS(value) packFloat2x16(value)
layout(constant_id = 0) const uint OPERATION = 0;  // a case of applied
layout(constant_id = 1) const uint UNROLLED = 4;   // applications to each value in a round
#include "bench/chains.glsl"
// One invocation: applies an operation on pairs of 16-bit floats again and again.
// Before: numbers. After: results.

VALUE applied(VALUE a, VALUE b, VALUE c, uint address) {
    const VALUE NONE = VALUE(0.0), ALL = VALUE(1.0);
    VALUE changed = fma(a, b, c);
    VALUE next = a;
    switch (OPERATION) {
        case 0: next = changed; break;
        case 1: next = fma(a.xx, b, a.yy); break;
        case 2: next = max(a, -a) + b; break;
        case 3: next = a.yx + b; break;
        case 4: next = exp2(-a); break;
        // Three forms of a threshold: `changed` where it is at least b (or a constant), else 0.
        case 5: next = mix(NONE, changed, greaterThanEqual(changed, b)); break;
        case 6: next = step(b, changed) * changed; break;
        case 7: next = clamp(fma(changed, VALUE(256.0), VALUE(2048.0)), NONE, ALL) * changed; break;
    }
    return next;
}
