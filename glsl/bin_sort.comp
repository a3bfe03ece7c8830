#version 460
#include "workgroup.glsl"
#include "ballot.glsl"
#include "frame.glsl"
#include "sort.glsl"
// One workgroup per run of up to 2048 entries of a bin: sorts them by depth, then by Gaussian.
// Before: entries from bin_fill. After: the only run of a bin is in splat_ids; others are sorted among the entries.
// A radix sort in workgroup memory by the bits in which the run's depths differ. No two entries of a bin are equal in
// both, so their order does not depend on how they came.

layout(constant_id = 1) const uint SUBGROUPS = 8;  // in a workgroup, at most

layout(binding = 0, scalar) readonly buffer RunBins { uint run_bins[]; };                   // [runs]
layout(binding = 1, scalar) readonly buffer Bins { Bin bins[]; };                           // [bins]
layout(binding = 2, scalar) readonly buffer Ids { uint gaussian_from_splat[]; };            // [visible_capacity]
layout(binding = 3, scalar) readonly buffer DepthKeys { uint depth_keys[]; };               // [visible_capacity]
layout(binding = 4, scalar) buffer Entries { uvec2 entries[]; };                            // [entry_capacity]
layout(binding = 5, scalar) writeonly buffer SplatIds { uint splat_ids[]; };                // [entry_capacity]
layout(binding = 6, scalar) readonly buffer DispatchesBlock { BinDispatches dispatches; };

#include "subgroup_rank.glsl"

const uint ITEMS = BIN_RUN / WORKGROUP;
const uint TIES_ALONE = 16;  // longer rows of equal depths are sorted by Gaussian first
shared uint keys[BIN_RUN];
shared uint values[BIN_RUN];
shared uint digit_counts[SUBGROUPS * DIGITS];
shared uint lowest, highest, has_long_ties;

// Sorts keys and values [0, count) stably by the bits from `shift` on, DIGIT_BITS of them.
void sort_by_digit(uint count, uint shift) {
    uint items = div_up(count, WORKGROUP), bits = min(DIGIT_BITS, 32 - shift);
    for (uint i = lane(); i < SUBGROUPS * DIGITS; i += WORKGROUP) digit_counts[i] = 0;
    barrier();
    // Each subgroup takes consecutive keys, so that (subgroup, item, lane) is their order.
    uint first = gl_SubgroupID * gl_SubgroupSize * items + gl_SubgroupInvocationID;
    uint mine = gl_SubgroupID * DIGITS;
    uint key[ITEMS], value[ITEMS], place[ITEMS];
    for (uint k = 0; k < ITEMS; k++) {
        if (k >= items) break;
        uint index = first + k * gl_SubgroupSize;
        // Past the end: the largest digit, behind every key that exists.
        key[k] = index < count ? keys[index] : 0xffffffff;
        value[k] = index < count ? values[index] : 0;
        uint digit = digit_of(key[k], shift, bits);
        uvec2 rank = rank_in(same_digit(digit));
        uint before = digit_counts[mine + digit];
        subgroupMemoryBarrierShared();
        subgroupBarrier();
        if (rank.x == 0) digit_counts[mine + digit] = before + rank.y;
        subgroupMemoryBarrierShared();
        subgroupBarrier();
        place[k] = before + rank.x;
    }
    barrier();
    // Lane d serves digit d: sums over the subgroups, then over the digits.
    uint sum = 0, total;
    if (lane() < DIGITS) {
        for (uint s = 0; s < gl_NumSubgroups; s++) {
            uint here = digit_counts[s * DIGITS + lane()];
            digit_counts[s * DIGITS + lane()] = sum;
            sum += here;
        }
    }
    uint before = workgroup_exclusive_add(sum, total);
    if (lane() < DIGITS) {
        for (uint s = 0; s < gl_NumSubgroups; s++) digit_counts[s * DIGITS + lane()] += before;
    }
    barrier();
    for (uint k = 0; k < ITEMS; k++) {
        if (k >= items) break;
        uint index = place[k] + digit_counts[mine + digit_of(key[k], shift, bits)];
        if (index < BIN_RUN) {
            keys[index] = key[k];
            values[index] = value[k];
        }
    }
    barrier();
}

// Sorts by all bits in which keys differ, which become differences from the lowest.
void sort_by_keys(uint count) {
    if (lane() == 0) {
        lowest = 0xffffffff;
        highest = 0;
    }
    barrier();
    uint low = 0xffffffff, high = 0;
    for (uint i = lane(); i < count; i += WORKGROUP) {
        low = min(low, keys[i]);
        high = max(high, keys[i]);
    }
    low = subgroupMin(low);
    high = subgroupMax(high);
    if (subgroupElect()) {
        atomicMin(lowest, low);
        atomicMax(highest, high);
    }
    barrier();
    low = lowest;
    uint bits = uint(findMSB(highest - low) + 1);
    for (uint i = lane(); i < count; i += WORKGROUP) keys[i] -= low;
    barrier();
    for (uint shift = 0; shift < bits; shift += DIGIT_BITS) sort_by_digit(count, shift);
}

// Entries in a row with the depth of sorted entry `i`, if that is the first of them; 0 if not.
uint ties_at(uint i, uint count) {
    if (i >= count || i > 0 && keys[i - 1] == keys[i]) return 0;
    uint ties = 1;
    while (ties <= TIES_ALONE && i + ties < count && keys[i + ties] == keys[i]) ties++;
    return ties;
}

// Sorts a few values from `first` on by Gaussian.
void sort_ties(uint first, uint ties) {
    for (uint i = 1; i < ties; i++) {
        uint value = values[first + i], gaussian = gaussian_from_splat[value], place = first + i;
        while (place > first && gaussian_from_splat[values[place - 1]] > gaussian) {
            values[place] = values[place - 1];
            place--;
        }
        values[place] = value;
    }
}

void main() {
    uint run = workgroup();
    // A folded dispatch may have more workgroups than there are runs: those have no bin.
    if (run >= dispatches.over_runs.x * dispatches.over_runs.y) return;
    Bin bin = bins[run_bins[run]];
    uint begin = (run - bin.first_run) * BIN_RUN;
    if (run < bin.first_run || begin >= bin.count) return;
    uint count = min(bin.count - begin, BIN_RUN);
    for (uint i = lane(); i < count; i += WORKGROUP) {
        uvec2 entry = entries[bin.first + begin + i];
        keys[i] = entry.x;
        values[i] = entry.y;
    }
    if (lane() == 0) has_long_ties = 0;
    barrier();
    sort_by_keys(count);
    for (uint i = lane(); i < count; i += WORKGROUP) {
        if (ties_at(i, count) > TIES_ALONE) has_long_ties = 1;
    }
    barrier();
    if (has_long_ties == 1) {
        for (uint i = lane(); i < count; i += WORKGROUP) keys[i] = gaussian_from_splat[values[i]];
        barrier();
        sort_by_keys(count);
        for (uint i = lane(); i < count; i += WORKGROUP) keys[i] = depth_keys[values[i]];
        barrier();
        sort_by_keys(count);
    } else {
        for (uint i = lane(); i < count; i += WORKGROUP) {
            uint ties = ties_at(i, count);
            if (ties > 1) sort_ties(i, ties);
        }
        barrier();
    }
    bool alone = bin.count <= BIN_RUN;
    for (uint i = lane(); i < count; i += WORKGROUP) {
        if (alone) {
            splat_ids[bin.first + i] = values[i];
        } else {
            entries[bin.first + begin + i] = uvec2(keys[i] + lowest, values[i]);
        }
    }
}
