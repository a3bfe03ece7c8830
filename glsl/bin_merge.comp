#version 460
#include "workgroup.glsl"
#include "frame.glsl"
// One workgroup per run of a bin that has several: where each of its entries goes among all of the bin.
// Before: runs sorted by bin_sort. After: splat_ids of these bins are sorted by depth, then by Gaussian.
// An entry's place is the sum over all runs of the entries before it, found by bisection: no run waits for another, so a
// long list takes no more dispatches than a short one.

layout(binding = 0, scalar) readonly buffer RunBins { uint run_bins[]; };                   // [runs]
layout(binding = 1, scalar) readonly buffer Bins { Bin bins[]; };                           // [bins]
layout(binding = 2, scalar) readonly buffer Ids { uint gaussian_from_splat[]; };            // [visible_capacity]
layout(binding = 3, scalar) readonly buffer Entries { uvec2 entries[]; };                   // [entry_capacity]
layout(binding = 4, scalar) writeonly buffer SplatIds { uint splat_ids[]; };                // [entry_capacity]
layout(binding = 5, scalar) readonly buffer DispatchesBlock { BinDispatches dispatches; };

// Entries of [begin, begin + count) that come before `entry`, which is not among them.
uint entries_before(uvec2 entry, uint gaussian, uint begin, uint count) {
    uint low = 0, high = count;
    while (low < high) {
        uint middle = (low + high) / 2;
        uvec2 other = entries[begin + middle];
        bool is_before = other.x < entry.x || other.x == entry.x && gaussian_from_splat[other.y] < gaussian;
        if (is_before) low = middle + 1; else high = middle;
    }
    return low;
}

void main() {
    uint run = workgroup();
    if (run >= dispatches.over_runs.x * dispatches.over_runs.y) return;
    Bin bin = bins[run_bins[run]];
    uint begin = (run - bin.first_run) * BIN_RUN;
    if (run < bin.first_run || begin >= bin.count || bin.count <= BIN_RUN) return;
    uint count = min(bin.count - begin, BIN_RUN);
    for (uint i = lane(); i < count; i += WORKGROUP) {
        uvec2 entry = entries[bin.first + begin + i];
        uint gaussian = gaussian_from_splat[entry.y];
        uint place = i;
        for (uint other = 0; other < bin.count; other += BIN_RUN) {
            if (other == begin) continue;
            place += entries_before(entry, gaussian, bin.first + other, min(bin.count - other, BIN_RUN));
        }
        splat_ids[bin.first + place] = entry.y;
    }
}
