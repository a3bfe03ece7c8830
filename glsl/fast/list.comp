#version 460
#define WORKGROUP_SIZE 1024
#include "shared/workgroup.glsl"
#include "fast/frame.glsl"
// One workgroup per chunk of the splats, BIN_CHUNKS in all: counts the splats of the chunk that each bin lists, then
// writes each of them, bin by bin, into a segment of `unsorted` that is the chunk's own. What a chunk lists in one bin
// is a share of the bin's list.
// Before: counters.visible, span_ranges and spans from project; listed_in_bins is 0.
// After: counters.listed_* is the demand; listed_in_bins has the sums over all chunks. If the demand fits, unsorted has
// the splat of every entry, in any order within a share, and share_starts has where each share begins; it ends where
// the next one begins.

layout(binding = 0, scalar) buffer CountersBlock { FastCounters counters; };
layout(binding = 1, scalar) readonly buffer SpanRanges { uvec2 span_ranges[]; };            // [visible_capacity]
layout(binding = 2, scalar) readonly buffer Spans { uint spans[]; };                        // [span_capacity]
layout(binding = 3, scalar) buffer ListedInBins { uint listed_in_bins[]; };                 // [bins]
layout(binding = 4, scalar) writeonly buffer ShareStarts { uint share_starts[]; };          // [BIN_CHUNKS * (bins + 1)]
layout(binding = 5, scalar) writeonly buffer Unsorted { uint unsorted[]; };                 // [entry_capacity]
layout(push_constant, scalar) uniform Push {
    uint bins_x;
    uint bins;
    uint visible_capacity;
    uint entry_capacity;
} push;

shared uint next[MAX_BINS];  // the entries counted in each bin; then the next one to write
shared uint segment;         // the first entry of the chunk

void visit(uint bin, uint splat, bool writes) {
    uint entry = atomicAdd(next[bin], 1);  // any order is right: sort orders the entries
    if (writes) unsorted[entry] = splat;
}

#include "fast/walk_bins.glsl"

void main() {
    uint chunk = workgroup();
    if (chunk >= BIN_CHUNKS) return;
    for (uint bin = lane(); bin < push.bins; bin += WORKGROUP) next[bin] = 0;
    barrier();
    visit_chunk(chunk, false);
    barrier();
    // Each lane handles consecutive bins, so that shares lie in the order of the bins.
    uint each = div_up(push.bins, WORKGROUP), begin = min(lane() * each, push.bins), end = min(begin + each, push.bins);
    uint mine = 0, all;
    for (uint bin = begin; bin < end; bin++) mine += next[bin];
    uint start = workgroup_exclusive_add(mine, all);
    // Counts, here and below: order does not matter, and neither does the order of the segments.
    if (start + mine < start) atomicAdd(counters.listed_high, 1);
    if (lane() == 0) {
        segment = atomicAdd(counters.listed_low, all);
        if (segment + all < segment) atomicAdd(counters.listed_high, 1);
    }
    barrier();
    uint row = chunk * (push.bins + 1);
    start += segment;
    for (uint bin = begin; bin < end; bin++) {
        uint listed = next[bin];
        if (listed > 0) atomicAdd(listed_in_bins[bin], listed);
        share_starts[row + bin] = next[bin] = start;
        start += listed;
    }
    if (lane() == 0) share_starts[row + push.bins] = segment + all;
    // A frame that needs more entries is drawn again.
    if (segment > push.entry_capacity || all > push.entry_capacity - segment) return;
    barrier();
    visit_chunk(chunk, true);
}
