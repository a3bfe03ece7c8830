#version 460
#define WORKGROUP_SIZE 1024
#include "shared/workgroup.glsl"
#extension GL_EXT_control_flow_attributes : require
#include "fast/frame.glsl"
#define NUMBER uvec4
#define SUMS subgroup_sums_of_four
#include "shared/workgroup_add.glsl"
// One workgroup in all: finds where the sorted entries of each bin go, and sets the dispatches over runs and segments.
// Before: counters and listed_in_bins from project and list. After: these are 0 again, for the next frame; bins,
// bin_order, run_bins, segment_bins, the dispatches and totals are set. If the demand exceeds the capacity, or a list
// is longer than the recorded merges sort, all lists are empty.

layout(binding = 0, scalar) writeonly buffer TotalsBlock { Totals totals; };
layout(binding = 1, scalar) buffer ListedInBins { uint listed_in_bins[]; };                 // [bins]
layout(binding = 2, scalar) writeonly buffer Bins { Bin bins[]; };                          // [bins]
layout(binding = 3, scalar) writeonly buffer BinOrder { uint bin_order[]; };                // [bins] longest first
layout(binding = 4, scalar) writeonly buffer RunBins { uint run_bins[]; };                  // [runs]
layout(binding = 5, scalar) writeonly buffer SegmentBins { uint segment_bins[]; };          // [segments]
layout(binding = 6, scalar) writeonly buffer DispatchesBlock { FastDispatches dispatches; };
layout(binding = 7, scalar) buffer CountersBlock { FastCounters counters; };
layout(push_constant, scalar) uniform Push {
    uint bins;
    uint visible_capacity;
    uint span_capacity;
    uint entry_capacity;
    uint longest_list;  // that the merges of this frame sort
} push;

const uint CLASSES = 124;  // classes of lists by their length, the longest first
const uint MAX_EACH = (MAX_BINS + WORKGROUP - 1) / WORKGROUP;  // most bins of a lane

shared uint class_sizes[CLASSES];
shared uint class_begins[CLASSES];
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
    FastCounters demand = counters;
    // Each lane handles consecutive bins, so that entries lie in the order of the bins.
    uint each = div_up(push.bins, WORKGROUP), begin = min(lane() * each, push.bins), own = min(each, push.bins - begin);
    uint counts[MAX_EACH], ranks[MAX_EACH];
    [[unroll]] for (uint k = 0; k < MAX_EACH; k++) counts[k] = k < own ? listed_in_bins[begin + k] : 0;
    [[unroll]] for (uint k = 0; k < MAX_EACH; k++) if (k < own) listed_in_bins[begin + k] = 0;
    memoryBarrierBuffer();  // all lanes have the counters before they are set to 0
    barrier();
    uint most = 0;
    [[unroll]] for (uint k = 0; k < MAX_EACH; k++) most = max(most, counts[k]);
    most = subgroupMax(most);
    if (subgroupElect()) atomicMax(longest, most);  // a maximum: order does not matter
    barrier();
    bool fits = demand.visible <= push.visible_capacity && demand.spans <= push.span_capacity
        && demand.listed_high == 0 && demand.listed_low <= push.entry_capacity && longest <= push.longest_list;
    uvec3 mine = uvec3(0);  // entries, runs, segments
    [[unroll]] for (uint k = 0; k < MAX_EACH; k++) {
        if (!fits) counts[k] = 0;
        mine += uvec3(counts[k], div_up(counts[k], BIN_RUN), div_up(counts[k], BIN_SEGMENT));
        // Any order within a class is right: it decides when a bin is drawn, not what it shows.
        if (k < own) ranks[k] = atomicAdd(class_sizes[class_of(counts[k])], 1);
    }
    barrier();
    uvec4 all, before = workgroup_exclusive_add(uvec4(mine, lane() < CLASSES ? class_sizes[lane()] : 0), all);
    if (lane() < CLASSES) class_begins[lane()] = before.w;
    barrier();
    if (lane() == 0) {
        dispatches.over_runs = folded(all.y);
        dispatches.over_segments = folded(all.z);
        dispatches.runs = all.y;
        dispatches.segments = all.z;
        dispatches.chunks = bin_chunks(min(demand.visible, push.visible_capacity), push.bins);
        totals.visible = demand.visible;
        totals.visible_kept = min(demand.visible, push.visible_capacity);
        totals.spans = demand.spans;
        totals.listed_low = demand.listed_low;
        totals.listed_high = demand.listed_high;
        totals.listed_kept = all.x;
        totals.longest_list = longest;
        counters = FastCounters(0, 0, 0, 0);
    }
    [[unroll]] for (uint k = 0; k < MAX_EACH; k++) {
        if (k >= own) continue;
        uint bin = begin + k, count = counts[k];
        bins[bin] = Bin(before.x, count, before.y, before.z);
        bin_order[class_begins[class_of(count)] + ranks[k]] = bin;
        uvec3 end = before.xyz + uvec3(count, div_up(count, BIN_RUN), div_up(count, BIN_SEGMENT));
        for (uint run = before.y; run < end.y; run++) run_bins[run] = bin;
        for (uint segment = before.z; segment < end.z; segment++) segment_bins[segment] = bin;
        before.xyz = end;
    }
}
