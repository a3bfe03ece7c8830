#version 460
#include "shared/workgroup.glsl"
#include "portable/frame.glsl"
layout(constant_id = 0) const uint DIGIT_BITS = 8;  // bits of a key that one pass sorts by
#include "shared/digits.glsl"
// One workgroup per chunk of 2048 keys: counts the keys of each digit.
// Before: keys[0 .. length]. After: sums[digit * chunks + chunk] is set.

layout(binding = 0, scalar) readonly buffer Lengths { uint lengths[]; };
layout(binding = 1, scalar) readonly buffer Keys { uint keys[]; };                          // [capacity]
layout(binding = 2, scalar) writeonly buffer Sums { uint sums[]; };                         // [digits * chunks]
layout(push_constant, scalar) uniform Push {
    uint length_index;
    uint shift;
    uint bits;
} push;

shared uint counts[DIGITS];

void main() {
    uint length = lengths[push.length_index];
    uint chunk = workgroup(), chunks = div_up(length, SORT_CHUNK);
    if (chunk >= chunks) return;
    if (lane() < DIGITS) counts[lane()] = 0;
    barrier();
    for (uint i = lane(); i < SORT_CHUNK; i += WORKGROUP) {
        uint index = chunk * SORT_CHUNK + i;
        if (index < length) {
            atomicAdd(counts[digit_of(keys[index], push.shift, push.bits)], 1);  // a count: order does not matter
        }
    }
    barrier();
    if (lane() < DIGITS) sums[lane() * chunks + chunk] = counts[lane()];
}
