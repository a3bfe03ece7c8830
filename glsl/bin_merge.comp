#version 460
#define WORKGROUP_SIZE 512
#include "workgroup.glsl"
#extension GL_EXT_control_flow_attributes : require
#include "frame.glsl"
// One workgroup per run of a bin that has several: where each of its entries goes among all of the bin.
// Before: runs sorted by bin_sort. After: splat_ids of these bins are sorted by depth, then by Gaussian.
// An entry's place is the sum over all runs of the entries before it, found by bisection in workgroup memory: no run waits
// for another, so that a long list takes no more dispatches than a short one.

layout(binding = 0, scalar) readonly buffer RunBins { uint run_bins[]; };                   // [runs]
layout(binding = 1, scalar) readonly buffer Bins { Bin bins[]; };                           // [bins]
layout(binding = 2, scalar) readonly buffer Ids { uint gaussian_from_splat[]; };            // [visible_capacity]
layout(binding = 3, scalar) readonly buffer Entries { uvec2 entries[]; };                   // [entry_capacity]
layout(binding = 4, scalar) writeonly buffer SplatIds { uint splat_ids[]; };                // [entry_capacity]
layout(binding = 5, scalar) readonly buffer DispatchesBlock { BinDispatches dispatches; };

const uint ITEMS = BIN_RUN / WORKGROUP;
const uint NONE = 0xffffffff;  // behind every depth key
shared uint other_keys[BIN_RUN];

// Of the other run at hand: keys below `key`.
uint keys_below(uint key) {
    uint below = 0;
    [[unroll]] for (uint step = BIN_RUN / 2; step > 0; step /= 2) {
        if (other_keys[below + step - 1] < key) below += step;
    }
    return below + uint(other_keys[below] < key);
}

// Of the other run's entries of this depth, from `below` on: those of Gaussians before this one, found by bisection.
uint ties_before(uint first, uint below, uint others, uvec2 entry) {
    uint gaussian = gaussian_from_splat[entry.y];
    uint low = below, high = others;
    while (low < high) {
        uint middle = (low + high) / 2;
        bool is_before = other_keys[middle] == entry.x && gaussian_from_splat[entries[first + middle].y] < gaussian;
        if (is_before) low = middle + 1; else high = middle;
    }
    return low - below;
}

void main() {
    uint run = workgroup();
    // A folded dispatch may have more workgroups than there are runs.
    if (run >= dispatches.over_runs.x * dispatches.over_runs.y) return;
    Bin bin = bins[run_bins[run]];
    uint begin = (run - bin.first_run) * BIN_RUN;
    if (run < bin.first_run || begin >= bin.count || bin.count <= BIN_RUN) return;
    uint count = min(bin.count - begin, BIN_RUN);
    uvec2 entry[ITEMS];
    uint place[ITEMS];
    [[unroll]] for (uint k = 0; k < ITEMS; k++) {
        place[k] = k * WORKGROUP + lane();
        entry[k] = place[k] < count ? entries[bin.first + begin + place[k]] : uvec2(0);
    }
    for (uint other = 0; other < bin.count; other += BIN_RUN) {
        if (other == begin) continue;
        uint first = bin.first + other, others = min(bin.count - other, BIN_RUN);
        barrier();  // all are done with the run before
        [[unroll]] for (uint k = 0; k < ITEMS; k++) {
            uint i = k * WORKGROUP + lane();
            other_keys[i] = i < others ? entries[first + i].x : NONE;
        }
        barrier();
        [[unroll]] for (uint k = 0; k < ITEMS; k++) {
            uint below = keys_below(entry[k].x);
            place[k] += below;
            // Equal depths, which are rare.
            if (below < others && other_keys[below] == entry[k].x && k * WORKGROUP + lane() < count) {
                place[k] += ties_before(first, below, others, entry[k]);
            }
        }
    }
    [[unroll]] for (uint k = 0; k < ITEMS; k++) {
        if (k * WORKGROUP + lane() < count) splat_ids[bin.first + place[k]] = entry[k].y;
    }
}
