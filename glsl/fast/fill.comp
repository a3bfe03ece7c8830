#version 460
#define WORKGROUP_SIZE 1024
#include "shared/workgroup.glsl"
#include "fast/frame.glsl"
// One workgroup per chunk of the splats, the same chunks as in count: writes the splats into the lists of their bins.
// Before: bins from offsets, chunk_places from count. After: entries are (depth key, splat), in any order within a bin.

layout(binding = 0, scalar) readonly buffer TotalsBlock { Totals totals; };
layout(binding = 1, scalar) readonly buffer SpanRanges { uvec2 span_ranges[]; };            // [visible_capacity]
layout(binding = 2, scalar) readonly buffer Spans { uint spans[]; };                        // [span_capacity]
layout(binding = 3, scalar) readonly buffer ChunkPlaces { uint chunk_places[]; };           // [BIN_CHUNKS * bins]
layout(binding = 4, scalar) readonly buffer Bins { Bin bins[]; };                           // [bins]
layout(binding = 5, scalar) readonly buffer DepthKeys { uint depth_keys[]; };               // [visible_capacity]
layout(binding = 6, scalar) writeonly buffer Entries { uvec2 entries[]; };                  // [entry_capacity]
layout(push_constant, scalar) uniform Push {
    uint bins_x;
    uint bins;
    uint visible_capacity;
    uint entry_capacity;
} push;

shared uint next[MAX_BINS];  // next entry to write in each bin

void visit(uint bin, uint splat) {
    uint entry = atomicAdd(next[bin], 1);  // any order is right: sort orders the entries
    if (entry < push.entry_capacity) entries[entry] = uvec2(depth_keys[splat], splat);
}

#include "fast/walk_bins.glsl"

void main() {
    uint chunk = workgroup();
    if (chunk >= BIN_CHUNKS || totals.listed_kept == 0) return;
    for (uint bin = lane(); bin < push.bins; bin += WORKGROUP) {
        next[bin] = bins[bin].first + chunk_places[chunk * push.bins + bin];
    }
    barrier();
    visit_chunk(chunk);
}
