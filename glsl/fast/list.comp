#version 460
#define WORKGROUP_SIZE 1024
#include "shared/workgroup.glsl"
#include "fast/frame.glsl"
// One workgroup per chunk of the splats: counts the splats of the chunk that each bin lists, then
// writes each of them, bin by bin, into a region of `unsorted` that is the chunk's own. The entries of a chunk in one
// bin are a chunk list.
// Before: counters.visible, span_ranges and spans from project; listed_in_bins is 0.
// After: counters.listed_* is the demand; listed_in_bins has the sums over all chunks. If the demand fits, unsorted has
// the splat of every entry, in any order within a chunk list, and list_starts, bin by bin, the begin of each chunk
// list, which is the end of the chunk's list in the bin before.

layout(binding = 0, scalar) buffer CountersBlock { FastCounters counters; };
layout(binding = 1, scalar) readonly buffer SpanRanges { uvec2 span_ranges[]; };            // [visible_capacity]
layout(binding = 2, scalar) readonly buffer Spans { uint spans[]; };                        // [span_capacity]
layout(binding = 3, scalar) buffer ListedInBins { uint listed_in_bins[]; };                 // [bins]
layout(binding = 4, scalar) writeonly buffer ListStarts { uint list_starts[]; }; // [(bins + 1) * chunks]
layout(binding = 5, scalar) writeonly buffer Unsorted { uint unsorted[]; };                 // [entry_capacity]
layout(push_constant, scalar) uniform Push {
    uint bins_x;
    uint bins;
    uint visible_capacity;
    uint entry_capacity;
} push;

#define IS_LISTED(bin) true
#include "fast/list_chunk.glsl"
