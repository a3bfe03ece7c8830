#version 460
#define WORKGROUP_SIZE 512
#include "shared/workgroup.glsl"
#extension GL_EXT_control_flow_attributes : require
#include "fast/frame.glsl"
// One workgroup per run of a list of several runs, at most MERGE_RUNS: moves its entries to their places in the list.
// Before: each run in `entries` is sorted. After: splat_ids of these lists are sorted by depth, then by Gaussian.
// An entry's place is the number of entries before it, summed over the runs and found by binary search in workgroup
// memory. No workgroup waits for another.

layout(binding = 0, scalar) readonly buffer RunBins { uint run_bins[]; };                   // [runs]
layout(binding = 1, scalar) readonly buffer Bins { Bin bins[]; };                           // [bins]
layout(binding = 2, scalar) readonly buffer Ids { uint gaussian_from_splat[]; };            // [visible_capacity]
layout(binding = 3, scalar) readonly buffer Entries { uvec2 entries[]; };                   // [entry_capacity]
layout(binding = 4, scalar) writeonly buffer SplatIds { uint splat_ids[]; };                // [entry_capacity]
layout(binding = 5, scalar) readonly buffer DispatchesBlock { FastDispatches dispatches; };
const uint ITEMS = BIN_RUN / WORKGROUP;
const uint NONE = 0xffffffff;  // after every depth key
shared uint other_keys[BIN_RUN];

// Counts those of `other_keys` that are below `key`.
uint keys_below(uint key) {
    uint below = 0;
    [[unroll]] for (uint step = BIN_RUN / 2; step > 0; step /= 2) {
        if (other_keys[below + step - 1] < key) below += step;
    }
    return below + uint(other_keys[below] < key);
}

// Among the other entries with the depth key of `entry`, which start at `below`, counts those with a smaller Gaussian
// index, by binary search.
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
    if (IS_SURPLUS(dispatches.runs)) return;
    Bin bin = bins[run_bins[run]];
    if (bin.count <= BIN_RUN) return;
    uint begin = (run - bin.first_run) * BIN_RUN;
    uint count = min(bin.count - begin, BIN_RUN);
    uvec2 entry[ITEMS];
    uint place[ITEMS];
    [[unroll]] for (uint k = 0; k < ITEMS; k++) {
        uint i = k * WORKGROUP + lane();
        entry[k] = i < count ? entries[bin.first + begin + i] : uvec2(0);
        place[k] = i;
    }
    for (uint other = 0; other < bin.count; other += BIN_RUN) {
        if (other == begin) continue;
        uint from = bin.first + other, others = min(bin.count - other, BIN_RUN);
        barrier();  // all lanes are done with the previous keys
        [[unroll]] for (uint k = 0; k < ITEMS; k++) {
            uint i = k * WORKGROUP + lane();
            other_keys[i] = i < others ? entries[from + i].x : NONE;
        }
        barrier();
        [[unroll]] for (uint k = 0; k < ITEMS; k++) {
            uint below = keys_below(entry[k].x);
            place[k] += below;
            // Equal depths, which are rare.
            if (below < others && other_keys[below] == entry[k].x && k * WORKGROUP + lane() < count) {
                place[k] += ties_before(from, below, others, entry[k]);
            }
        }
    }
    [[unroll]] for (uint k = 0; k < ITEMS; k++) {
        if (k * WORKGROUP + lane() < count) splat_ids[bin.first + place[k]] = entry[k].y;
    }
}
