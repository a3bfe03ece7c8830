#version 460
#include "shared/workgroup.glsl"
#include "portable/frame.glsl"
layout(constant_id = 0) const uint DIGIT_BITS = 8;  // bits of a key that one pass sorts by
#include "shared/digits.glsl"
// One workgroup per digit: finds where the keys of each chunk go among all keys of the digit.
// Before: `sums` from sort_histogram. After: each digit's row has exclusive sums, and digit_totals its total.

layout(binding = 0, scalar) readonly buffer Lengths { uint lengths[]; };
layout(binding = 1, scalar) buffer Sums { uint sums[]; };                                   // [digits * chunks]
layout(binding = 2, scalar) writeonly buffer DigitTotals { uint digit_totals[]; };          // [digits]
layout(push_constant, scalar) uniform Push {
    uint length_index;
} push;

#include "portable/scan_in_place.glsl"

void main() {
    uint digit = workgroup();
    if (digit >= DIGITS) return;
    uint chunks = div_up(lengths[push.length_index], SORT_CHUNK);
    uint total = scan_in_place(digit * chunks, chunks);
    if (lane() == 0) digit_totals[digit] = total;
}
