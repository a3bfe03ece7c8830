#version 460
#define WORKGROUP_SIZE 1024
#include "shared/workgroup.glsl"
#include "fast/frame.glsl"
// One workgroup in all: finds where the entries of each bin go, and sets the dispatches over runs, stretches and
// blocks.
// Before: listed_in_bins from count. After: bins, bin_order, run_bins, stretch_bins and the dispatches are set; totals
// has the entries, kept and demanded, and the longest list.

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
shared uint listed_high;
shared uint longest;

// The class of a list of this length. There are four classes for every power of two.
uint class_of(uint length) {
    uint high = findMSB(length | 4);
    return CLASSES - 1 - (length < 4 ? length : 4 * (high - 1) + (length >> high - 2 & 3));
}

void main() {
    if (workgroup() > 0) return;
    if (lane() == 0) {
        listed_high = totals.listed_high;
        longest = 0;
    }
    if (lane() < CLASSES) class_sizes[lane()] = 0;
    barrier();
    for (uint bin = lane(); bin < push.bins; bin += WORKGROUP) listed[bin] = listed_in_bins[bin];
    barrier();
    // Each lane handles consecutive bins, so that entries lie in the order of the bins.
    uint each = div_up(push.bins, WORKGROUP), begin = min(lane() * each, push.bins), end = min(begin + each, push.bins);
    uint mine = 0, overflows = 0;
    for (uint bin = begin; bin < end; bin++) {
        if (mine + listed[bin] < mine) overflows++;
        mine += listed[bin];
    }
    uint total;
    uint first = workgroup_exclusive_add(mine, total);
    // With 2^32 entries or more nothing is drawn, and the demand tells the host.
    if (overflows > 0 || first + mine < first) atomicAdd(listed_high, 1);  // a count: order does not matter
    barrier();
    bool fits = listed_high == 0;
    uint capacity = fits ? push.entry_capacity : 0;

    uint runs = 0, stretches = 0, start = first;
    for (uint bin = begin; bin < end; bin++) {
        uint count = min(listed[bin], capacity - min(start, capacity));
        start += listed[bin];
        runs += div_up(count, BIN_RUN);
        stretches += div_up(count, BIN_STRETCH);
    }
    uint all_runs, all_stretches;
    uint run = workgroup_exclusive_add(runs, all_runs);
    uint stretch = workgroup_exclusive_add(stretches, all_stretches);
    start = first;
    for (uint bin = begin; bin < end; bin++) {
        uint count = min(listed[bin], capacity - min(start, capacity));
        bins[bin] = Bin(start, count, run, stretch);
        start += listed[bin];
        uint own_runs = div_up(count, BIN_RUN), own_stretches = div_up(count, BIN_STRETCH);
        for (uint i = 0; i < own_runs; i++) run_bins[run + i] = bin;
        for (uint i = 0; i < own_stretches; i++) stretch_bins[stretch + i] = bin;
        run += own_runs;
        stretch += own_stretches;
        listed[bin] = count;
        atomicAdd(class_sizes[class_of(count)], 1);  // a count: order does not matter
        atomicMax(longest, count);                   // a maximum: order does not matter
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
        totals.listed_high = listed_high;
        totals.listed_low = total;
        totals.listed_kept = min(total, capacity);
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
