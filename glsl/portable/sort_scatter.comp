#version 460
#include "shared/workgroup.glsl"
#include "shared/ballot.glsl"
#include "portable/frame.glsl"
layout(constant_id = 0) const uint DIGIT_BITS = 8;  // bits of a key that one pass sorts by
#include "shared/digits.glsl"
// One workgroup per chunk of 2048 keys: moves them and their values to their places.
// Before: sums and digit_totals from sort_offsets. After: keys_out and values_out are sorted by this digit, stably.
// Ranks come from ballots: lanes of a subgroup with the same digit find each other, for every subgroup size.

layout(constant_id = 1) const uint SUBGROUPS = 8;  // in a workgroup, at most

layout(binding = 0, scalar) readonly buffer Lengths { uint lengths[]; };
layout(binding = 1, scalar) readonly buffer KeysIn { uint keys_in[]; };                     // [capacity]
layout(binding = 2, scalar) readonly buffer ValuesIn { uint values_in[]; };                 // [capacity]
layout(binding = 3, scalar) readonly buffer Sums { uint sums[]; };                          // [digits * chunks]
layout(binding = 4, scalar) readonly buffer DigitTotals { uint digit_totals[]; };           // [digits]
layout(binding = 5, scalar) writeonly buffer KeysOut { uint keys_out[]; };                  // [capacity]
layout(binding = 6, scalar) writeonly buffer ValuesOut { uint values_out[]; };              // [capacity]
layout(push_constant, scalar) uniform Push {
    uint length_index;
    uint shift;
    uint bits;
    uint values_are_indices;  // 1 in a first pass: the value of a key is its index, and values_in is not read
} push;

#include "shared/subgroup_rank.glsl"

const uint ITEMS = SORT_CHUNK / WORKGROUP;
shared uint counts[SUBGROUPS * DIGITS];  // keys per subgroup and digit; later the subgroup's first place for it
shared uint destinations[DIGITS];        // destination of the chunk's sorted element i of this digit, minus i
shared uint staged[SORT_CHUNK];

void main() {
    uint length = lengths[push.length_index];
    uint chunk = workgroup(), chunks = div_up(length, SORT_CHUNK);
    if (chunk >= chunks) return;
    for (uint i = lane(); i < SUBGROUPS * DIGITS; i += WORKGROUP) counts[i] = 0;
    barrier();

    // Each subgroup takes consecutive keys, so that (subgroup, item, lane) is the order of the input.
    uint first = chunk * SORT_CHUNK + gl_SubgroupID * gl_SubgroupSize * ITEMS + gl_SubgroupInvocationID;
    uint mine = gl_SubgroupID * DIGITS;
    uint keys[ITEMS], ranks[ITEMS];
    for (uint k = 0; k < ITEMS; k++) {
        uint index = first + k * gl_SubgroupSize;
        // Lanes past the end take the largest digit: it comes after every key that exists.
        keys[k] = index < length ? keys_in[index] : 0xffffffff;
        uint digit = digit_of(keys[k], push.shift, push.bits);
        uvec2 rank = rank_in(same_digit(digit));
        uint before = counts[mine + digit];
        subgroupMemoryBarrierShared();
        subgroupBarrier();
        if (rank.x == 0) counts[mine + digit] = before + rank.y;
        subgroupMemoryBarrierShared();
        subgroupBarrier();
        ranks[k] = before + rank.x;
    }
    barrier();

    // Lane d handles digit d: it adds up the counts of the subgroups, then those of the digits before.
    uint in_chunk = 0, total;
    if (lane() < DIGITS) {
        for (uint s = 0; s < gl_NumSubgroups; s++) {
            uint count = counts[s * DIGITS + lane()];
            counts[s * DIGITS + lane()] = in_chunk;
            in_chunk += count;
        }
    }
    uint local = workgroup_exclusive_add(in_chunk, total);
    uint run = workgroup_exclusive_add(lane() < DIGITS ? digit_totals[lane()] : 0, total);
    if (lane() < DIGITS) {
        destinations[lane()] = run + sums[lane() * chunks + chunk] - local;
        for (uint s = 0; s < gl_NumSubgroups; s++) counts[s * DIGITS + lane()] += local;
    }
    barrier();

    // Keys are sorted in workgroup memory first, so that neighbouring lanes store to neighbouring places.
    for (uint k = 0; k < ITEMS; k++) {
        ranks[k] += counts[mine + digit_of(keys[k], push.shift, push.bits)];
        staged[ranks[k]] = keys[k];
    }
    barrier();
    uint places[ITEMS];
    uint here = min(length - chunk * SORT_CHUNK, SORT_CHUNK);
    for (uint k = 0; k < ITEMS; k++) {
        uint i = k * WORKGROUP + lane();
        places[k] = destinations[digit_of(staged[i], push.shift, push.bits)] + i;
        if (i < here) keys_out[places[k]] = staged[i];
    }
    barrier();
    for (uint k = 0; k < ITEMS; k++) {
        uint index = first + k * gl_SubgroupSize;
        if (index < length) staged[ranks[k]] = push.values_are_indices == 1 ? index : values_in[index];
    }
    barrier();
    for (uint k = 0; k < ITEMS; k++) {
        uint i = k * WORKGROUP + lane();
        if (i < here) values_out[places[k]] = staged[i];
    }
}
