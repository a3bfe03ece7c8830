#version 460
#define WORKGROUP_SIZE 512
#include "workgroup.glsl"
#include "ballot.glsl"
#include "frame.glsl"
// One workgroup per part of the splats, BIN_CHUNKS in all: how many of them does each bin list?
// Before: totals.visible, span_ranges and spans from bin_project. After: all [BIN_CHUNKS * bins] counts are set.

layout(binding = 0, scalar) readonly buffer TotalsBlock { Totals totals; };
layout(binding = 1, scalar) readonly buffer SpanRanges { uvec2 span_ranges[]; };            // [visible_capacity]
layout(binding = 2, scalar) readonly buffer Spans { uint spans[]; };                        // [span_capacity]
layout(binding = 3, scalar) writeonly buffer Counts { uint counts[]; };                     // [BIN_CHUNKS * bins]
layout(push_constant, scalar) uniform Push {
    uint bins_x;
    uint bins;
    uint visible_capacity;
} push;

shared uint listed[MAX_BINS];

void visit(uint bin, uint splat) {
    atomicAdd(listed[bin], 1);  // a count: order does not matter
}

#include "bin_walk.glsl"

void main() {
    uint chunk = workgroup();
    if (chunk >= BIN_CHUNKS) return;
    for (uint bin = lane(); bin < push.bins; bin += WORKGROUP) listed[bin] = 0;
    barrier();
    visit_chunk(chunk);
    barrier();
    for (uint bin = lane(); bin < push.bins; bin += WORKGROUP) counts[chunk * push.bins + bin] = listed[bin];
}
