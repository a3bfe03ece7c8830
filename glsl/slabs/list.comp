#version 460
#define WORKGROUP_SIZE 1024
#include "shared/workgroup.glsl"
#include "fast/frame.glsl"
// One workgroup per chunk of the splats: lists it as fast/list.comp, except in bins whose pixels have all stopped.
// Before: as for list; open_bins has a bit for every bin with a pixel that has not stopped. After: as for list.

layout(binding = 0, scalar) buffer CountersBlock { FastCounters counters; };
layout(binding = 1, scalar) readonly buffer SpanRanges { uvec2 span_ranges[]; };            // [visible_capacity]
layout(binding = 2, scalar) readonly buffer Spans { uint spans[]; };                        // [span_capacity]
layout(binding = 3, scalar) buffer ListedInBins { uint listed_in_bins[]; };                 // [bins]
layout(binding = 4, scalar) writeonly buffer ListStarts { uint list_starts[]; }; // [(bins + 1) * chunks]
layout(binding = 5, scalar) writeonly buffer Unsorted { uint unsorted[]; };                 // [entry_capacity]
layout(binding = 6, scalar) readonly buffer OpenBins { uint open_bins[]; };                 // [bins / 32] a bit per bin
layout(push_constant, scalar) uniform Push {
    uint bins_x;
    uint bins;
    uint visible_capacity;
    uint entry_capacity;
} push;

#define IS_LISTED(bin) ((open_bins[(bin) / 32] >> (bin) % 32 & 1) != 0)
#include "fast/list_chunk.glsl"
