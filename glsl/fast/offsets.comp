#version 460
#define WORKGROUP_SIZE 1024
#include "shared/workgroup.glsl"
#include "fast/frame.glsl"
// One workgroup in all: finds where the sorted entries of each bin go, and sets the dispatches over runs, stretches and
// blocks.
// Before: totals.listed_* and listed_in_bins from list. After: bins, bin_order, run_bins, stretch_bins and the
// dispatches are set; totals has the entries that are kept and the longest list. If the demand exceeds the capacity, all
// lists are empty.

layout(binding = 0, scalar) buffer TotalsBlock { Totals totals; };
layout(binding = 1, scalar) readonly buffer ListedInBins { uint listed_in_bins[]; };        // [bins]
layout(binding = 2, scalar) writeonly buffer Bins { Bin bins[]; };                          // [bins]
layout(binding = 3, scalar) writeonly buffer BinOrder { uint bin_order[]; };                // [bins] longest first
layout(binding = 4, scalar) writeonly buffer RunBins { uint run_bins[]; };                  // [runs]
layout(binding = 5, scalar) writeonly buffer StretchBins { uint stretch_bins[]; };          // [stretches]
layout(binding = 6, scalar) writeonly buffer DispatchesBlock { FastDispatches dispatches; };
layout(push_constant, scalar) uniform Push {
    uint bins;
    uint visible_capacity;
    uint entry_capacity;
} push;

const uint CLASSES = 124;  // classes of lists by their length, the longest first

shared uint listed[MAX_BINS];
shared uint class_sizes[CLASSES];
shared uint longest;

// The class of a list of this length. There are four classes for every power of two.
uint class_of(uint length) {
    uint high = findMSB(length | 4);
    return CLASSES - 1 - (length < 4 ? length : 4 * (high - 1) + (length >> high - 2 & 3));
}

void main() {
    if (workgroup() > 0) return;
    if (lane() == 0) longest = 0;
    if (lane() < CLASSES) class_sizes[lane()] = 0;
    bool fits = totals.listed_high == 0 && totals.listed_low <= push.entry_capacity;
    barrier();
    for (uint bin = lane(); bin < push.bins; bin += WORKGROUP) {
        uint count = listed_in_bins[bin];
        atomicMax(longest, count);  // a maximum: order does not matter
        listed[bin] = fits ? count : 0;
    }
    barrier();
    // Each lane handles consecutive bins, so that entries lie in the order of the bins.
    uint each = div_up(push.bins, WORKGROUP), begin = min(lane() * each, push.bins), end = min(begin + each, push.bins);
    uint mine = 0, total;
    for (uint bin = begin; bin < end; bin++) mine += listed[bin];
    uint start = workgroup_exclusive_add(mine, total);

    uint runs = 0, stretches = 0;
    for (uint bin = begin; bin < end; bin++) {
        runs += div_up(listed[bin], BIN_RUN);
        stretches += div_up(listed[bin], BIN_STRETCH);
    }
    uint all_runs, all_stretches;
    uint run = workgroup_exclusive_add(runs, all_runs);
    uint stretch = workgroup_exclusive_add(stretches, all_stretches);
    for (uint bin = begin; bin < end; bin++) {
        uint count = listed[bin];
        bins[bin] = Bin(start, count, run, stretch);
        start += count;
        uint own_runs = div_up(count, BIN_RUN), own_stretches = div_up(count, BIN_STRETCH);
        for (uint i = 0; i < own_runs; i++) run_bins[run + i] = bin;
        for (uint i = 0; i < own_stretches; i++) stretch_bins[stretch + i] = bin;
        run += own_runs;
        stretch += own_stretches;
        atomicAdd(class_sizes[class_of(count)], 1);  // a count: order does not matter
    }
    barrier();
    uint all_bins;
    uint class_begin = workgroup_exclusive_add(lane() < CLASSES ? class_sizes[lane()] : 0, all_bins);
    if (lane() < CLASSES) class_sizes[lane()] = class_begin;
    barrier();
    if (lane() == 0) {
        // LONG_LIST is a power of two, where a class begins: the classes up to its own have exactly the long lists.
        dispatches.over_long_blocks = folded(class_sizes[class_of(LONG_LIST) + 1] * BLOCKS);
        totals.visible_kept = min(totals.visible, push.visible_capacity);
        totals.listed_kept = total;
        totals.longest_list = longest;
        dispatches.over_runs = folded(all_runs);
        dispatches.over_stretches = folded(all_stretches);
    }
    barrier();
    for (uint bin = lane(); bin < push.bins; bin += WORKGROUP) {
        // Any order within a class is right: it decides when a bin is drawn, not what it shows.
        bin_order[atomicAdd(class_sizes[class_of(listed[bin])], 1)] = bin;
    }
}
