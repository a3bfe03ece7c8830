#version 460
#define WORKGROUP_SIZE 512
#include "shared/workgroup.glsl"
#extension GL_EXT_control_flow_attributes : require
#include "fast/frame.glsl"
// One workgroup per run of a list of several merge inputs: moves each of its entries to its place among up to 16.
// Before: inputs of `input_length` entries are sorted, by sort or by an earlier merge. After: 16 times as many entries
// are sorted by depth, then by Gaussian; where these are the whole list, its splat_ids are set instead.
// An entry's place is the number of entries before it, summed over the inputs and found by binary search in workgroup
// memory. No workgroup waits for another, and a list of less than 32,768 entries takes one dispatch.

layout(binding = 0, scalar) readonly buffer RunBins { uint run_bins[]; };                   // [runs]
layout(binding = 1, scalar) readonly buffer Bins { Bin bins[]; };                           // [bins]
layout(binding = 2, scalar) readonly buffer Ids { uint gaussian_from_splat[]; };            // [visible_capacity]
layout(binding = 3, scalar) readonly buffer Entries { uvec2 entries[]; };                   // [entry_capacity]
layout(binding = 4, scalar) writeonly buffer SplatIds { uint splat_ids[]; };                // [entry_capacity]
layout(binding = 5, scalar) readonly buffer DispatchesBlock { FastDispatches dispatches; };
layout(binding = 6, scalar) writeonly buffer Merged { uvec2 merged[]; };      // [entry_capacity] if any list is longer
layout(push_constant, scalar) uniform Push {
    uint input_length;
} push;

layout(constant_id = 0) const bool OF_RUNS = true;  // inputs are runs, and each is searched as a whole
const uint ITEMS = BIN_RUN / WORKGROUP;
const uint NONE = 0xffffffff;  // after every depth key
shared uint other_keys[BIN_RUN];
shared uvec2 windows[MERGE_INPUTS];  // for every input, the range of its entries that this run may lie among

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

uint input_length() {
    return OF_RUNS ? BIN_RUN : push.input_length;
}

// The first of the sorted entries [begin, end) whose key is at least `key`; with `after`, the first whose key is above.
uint bound(uint begin, uint end, uint key, bool after) {
    while (begin < end) {
        uint middle = (begin + end) / 2, other = entries[middle].x;
        if (other < key || after && other == key) begin = middle + 1; else end = middle;
    }
    return begin;
}

// The range of the entries of the input at `other` whose keys lie between the first and the last of the run at `begin`.
uvec2 window(Bin bin, uint other, uint group_end, uint begin, uint count) {
    if (other >= group_end) return uvec2(0);
    uint first = bin.first + other, end = bin.first + min(other + input_length(), group_end);
    uint from = bound(first, end, entries[bin.first + begin].x, false);
    return uvec2(from, bound(from, end, entries[bin.first + begin + count - 1].x, true));
}

void main() {
    uint run = workgroup();
    if (IS_SURPLUS(dispatches.runs)) return;
    Bin bin = bins[run_bins[run]];
    if (bin.count <= input_length()) return;
    uint begin = (run - bin.first_run) * BIN_RUN;
    uint count = min(bin.count - begin, BIN_RUN);
    uint own = begin / input_length() * input_length();
    uint group = begin / MERGE_INPUTS / input_length() * MERGE_INPUTS * input_length();
    uint group_end = min(bin.count, group + MERGE_INPUTS * input_length());
    uvec2 entry[ITEMS];
    uint place[ITEMS];
    [[unroll]] for (uint k = 0; k < ITEMS; k++) {
        uint i = k * WORKGROUP + lane();
        entry[k] = i < count ? entries[bin.first + begin + i] : uvec2(0);
        place[k] = group + begin - own + i;
    }
    if (!OF_RUNS) {
        if (lane() < MERGE_INPUTS) {
            windows[lane()] = window(bin, group + lane() * input_length(), group_end, begin, count);
        }
        barrier();
    }
    for (uint other = group; other < group_end; other += input_length()) {
        if (other == own) continue;
        uint from = bin.first + other, to = bin.first + min(other + input_length(), group_end);
        if (!OF_RUNS) {
            uvec2 window = windows[(other - group) / input_length()];
            [[unroll]] for (uint k = 0; k < ITEMS; k++) place[k] += window.x - from;
            from = window.x;
            to = window.y;
        }
        do {
            uint others = min(to - from, BIN_RUN);
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
            from += BIN_RUN;
        } while (!OF_RUNS && from < to);
    }
    bool is_all = bin.count <= MERGE_INPUTS * input_length();
    [[unroll]] for (uint k = 0; k < ITEMS; k++) {
        if (k * WORKGROUP + lane() >= count) continue;
        if (is_all) splat_ids[bin.first + place[k]] = entry[k].y; else merged[bin.first + place[k]] = entry[k];
    }
}
