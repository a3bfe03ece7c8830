#version 460
#define WORKGROUP_SIZE 1024
#include "shared/workgroup.glsl"
#include "fast/frame.glsl"
// One workgroup per chunk of the splats, BIN_CHUNKS in all: counts the splats of the chunk that each bin lists.
// Before: totals.visible, span_ranges and spans from project; listed_in_bins is 0. After: listed_in_bins has the sums
// over all chunks; chunk_places has, for every chunk and bin with entries, where these begin in the list of the bin.

layout(binding = 0, scalar) readonly buffer TotalsBlock { Totals totals; };
layout(binding = 1, scalar) readonly buffer SpanRanges { uvec2 span_ranges[]; };            // [visible_capacity]
layout(binding = 2, scalar) readonly buffer Spans { uint spans[]; };                        // [span_capacity]
layout(binding = 3, scalar) buffer ListedInBins { uint listed_in_bins[]; };                 // [bins]
layout(binding = 4, scalar) writeonly buffer ChunkPlaces { uint chunk_places[]; };          // [BIN_CHUNKS * bins]
layout(push_constant, scalar) uniform Push {
    uint bins_x;
    uint bins;
    uint visible_capacity;
} push;

shared uint listed[MAX_BINS];

void visit(uint bin, uint splat) {
    atomicAdd(listed[bin], 1);  // a count: order does not matter
}

#include "fast/walk_bins.glsl"

void main() {
    uint chunk = workgroup();
    if (chunk >= BIN_CHUNKS) return;
    for (uint bin = lane(); bin < push.bins; bin += WORKGROUP) listed[bin] = 0;
    barrier();
    visit_chunk(chunk);
    barrier();
    for (uint bin = lane(); bin < push.bins; bin += WORKGROUP) {
        // Any order of the chunks is right: sort orders the entries.
        if (listed[bin] > 0) chunk_places[chunk * push.bins + bin] = atomicAdd(listed_in_bins[bin], listed[bin]);
    }
}
