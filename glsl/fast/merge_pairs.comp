#version 460
#define WORKGROUP_SIZE 512
#include "shared/workgroup.glsl"
#extension GL_EXT_control_flow_attributes : require
#include "fast/frame.glsl"
// One workgroup per run of a list of several sorted inputs: makes the run of the output that two inputs become.
// Before: inputs of `input_length` entries are sorted, by sort or by an earlier merge. After: twice as many entries are
// sorted by depth, then by Gaussian; where these are the whole list, its splat_ids are set instead.
// How many entries of the first input are in an output's beginning is found by search (the merge path of Green,
// McColl and Bader, 2012): by a subgroup for the run, then by each lane for its part of the run. No workgroup waits for
// another.

layout(binding = 0, scalar) readonly buffer RunBins { uint run_bins[]; };                   // [runs]
layout(binding = 1, scalar) readonly buffer Bins { Bin bins[]; };                           // [bins]
layout(binding = 2, scalar) readonly buffer Ids { uint gaussian_from_splat[]; };            // [visible_capacity]
layout(binding = 3, scalar) readonly buffer Entries { uvec2 entries[]; };                   // [entry_capacity]
layout(binding = 4, scalar) writeonly buffer SplatIds { uint splat_ids[]; };                // [entry_capacity]
layout(binding = 5, scalar) readonly buffer DispatchesBlock { FastDispatches dispatches; };
layout(binding = 6, scalar) writeonly buffer Merged { uvec2 merged[]; };      // [entry_capacity]
layout(push_constant, scalar) uniform Push {
    uint input_length;
} push;

const uint ITEMS = BIN_RUN / WORKGROUP;  // of the run, each lane merges as many
shared uint keys[BIN_RUN];   // of the entries that the run consists of, input after input; then the order of these
shared uint splits[2];       // entries of the first input before the run, and before its end

// True if an entry comes before another. Equal depths, which are rare, are ordered by Gaussian.
bool is_before(uint one_key, uint one, uint other_key, uint other) {
    if (one_key != other_key) return one_key < other_key;
    return gaussian_from_splat[entries[one].y] < gaussian_from_splat[entries[other].y];
}

// The number of entries of the first input, of `inputs.x` entries from `first.x` on, among the first `outputs` of both
// inputs together. The lanes of a subgroup probe that many places at once.
uint split_at(uint outputs, uvec2 first, uvec2 inputs) {
    uint low = max(outputs, inputs.y) - inputs.y, high = min(outputs, inputs.x);
    while (low < high) {
        uint width = high - low, each = div_up(width, gl_SubgroupSize);
        uint probe = low + min((gl_SubgroupInvocationID + 1) * each, width) - 1;
        uint one = first.x + probe, other = first.y + outputs - 1 - probe;
        bool is_in = gl_SubgroupInvocationID * each < width && is_before(entries[one].x, one, entries[other].x, other);
        uint passed = subgroupBallotBitCount(subgroupBallot(is_in)) * each;
        high = passed < width ? low + min(passed + each, width) - 1 : high;
        low += min(passed, width);
    }
    return low;
}

void main() {
    uint run = workgroup();
    if (IS_SURPLUS(dispatches.runs)) return;
    Bin bin = bins[run_bins[run]];
    if (bin.count <= push.input_length) return;
    uint begin = (run - bin.first_run) * BIN_RUN, count = min(bin.count - begin, BIN_RUN);
    uint group = begin / (2 * push.input_length) * (2 * push.input_length);
    // The last input of a list may be shorter, and may have no other beside it.
    uvec2 inputs = min(uvec2(push.input_length), bin.count - min(uvec2(group, group + push.input_length), bin.count));
    uvec2 first = bin.first + uvec2(group, group + push.input_length);
    uint before = begin - group;
    for (uint end = gl_SubgroupID; end < 2; end += gl_NumSubgroups) {
        uint split = split_at(before + end * count, first, inputs);
        if (subgroupElect()) splits[end] = split;
    }
    barrier();
    first += uvec2(splits[0], before - splits[0]);
    uvec2 parts;  // entries of the run from each input
    parts.x = splits[1] - splits[0];
    parts.y = count - parts.x;
    for (uint i = lane(); i < count; i += WORKGROUP) {
        keys[i] = entries[i < parts.x ? first.x + i : first.y + i - parts.x].x;
    }
    barrier();
    // Each lane merges ITEMS entries of the run, from `output` on.
    uint output_begin = min(lane() * ITEMS, count), low = max(output_begin, parts.y) - parts.y;
    uint high = min(output_begin, parts.x);
    while (low < high) {
        uint middle = (low + high) / 2, other = output_begin - 1 - middle;
        bool is_in = is_before(keys[middle], first.x + middle, keys[parts.x + other], first.y + other);
        if (is_in) low = middle + 1; else high = middle;
    }
    uvec2 next = uvec2(low, output_begin - low);
    uint order[ITEMS];
    [[unroll]] for (uint k = 0; k < ITEMS; k++) {
        bool has_first = next.x < parts.x, has_second = next.y < parts.y;
        bool takes_first = has_first;
        if (has_first && has_second) {
            takes_first = is_before(keys[next.x], first.x + next.x, keys[parts.x + next.y], first.y + next.y);
        }
        order[k] = takes_first ? next.x : parts.x + next.y;
        next += takes_first ? uvec2(1, 0) : uvec2(0, 1);
    }
    barrier();
    [[unroll]] for (uint k = 0; k < ITEMS; k++) if (output_begin + k < count) keys[output_begin + k] = order[k];
    barrier();
    // Neighbouring lanes write neighbouring entries.
    bool is_all = bin.count <= 2 * push.input_length;
    for (uint i = lane(); i < count; i += WORKGROUP) {
        uint source = keys[i];
        uvec2 entry = entries[source < parts.x ? first.x + source : first.y + source - parts.x];
        if (is_all) splat_ids[bin.first + begin + i] = entry.y; else merged[bin.first + begin + i] = entry;
    }
}
