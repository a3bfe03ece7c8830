#version 460
#include "shared/workgroup.glsl"
// One group of FIT_LANES invocations per view and node: sums over the pixels of the node of its weight times VALUES
// values, as `weighted_sums` in src/lod/fit.rs.
// Before: spans, rows, weights and values. After: `sums`; 0 for nodes that are not drawn.

layout(constant_id = 3) const uint VALUES = 5;  // at most FIT_RESIDUALS

#include "fit/numbers.glsl"
#include "fit/node.glsl"
#include "fit/rows.glsl"

layout(binding = 0, scalar) readonly buffer Views { FitView views[]; };
layout(binding = 1, scalar) readonly buffer Spans { FitSpan spans[]; };       // [views nodes]
layout(binding = 2, scalar) readonly buffer Rows { FitRow rows[]; };
layout(binding = 3, scalar) readonly buffer Weights { float weights[]; };
layout(binding = 4, scalar) readonly buffer Values { float values[]; };       // [VALUES pixels]
layout(binding = 5, scalar) writeonly buffer Sums { float sums[]; };          // [VALUES views nodes]
layout(push_constant, scalar) uniform Push {
    uint nodes;
    uint first_view;
    uint views;
} push;

const uint SPLATS = WORKGROUP / FIT_LANES;
shared float parts[FIT_RESIDUALS][WORKGROUP];

void main() {
    uint groups = div_up(push.nodes, SPLATS);
    uint number = workgroup() / groups, index = workgroup() % groups * SPLATS + lane() / FIT_LANES;
    if (number >= push.views) return;
    uint view = push.first_view + number, at = number * push.nodes + index, own = lane() % FIT_LANES;
    precise float found[FIT_RESIDUALS];
    for (uint k = 0; k < VALUES; k++) found[k] = 0.0;
    if (index < push.nodes) {
        FitSpan span = spans[at];
        uint width = views[view].width;
        uint first_pixel = views[view].first_pixel - views[push.first_view].first_pixel;
        for (uint row = span.first_row; row < span.end_row; row++) {
            FitRow record = rows[span.first_record + row - span.first_row];
            uint first = record.columns & 0xffff, end = record.columns >> 16;
            for (uint column = first + own; column < end; column += FIT_LANES) {
                float weight = weights[span.first_weight + record.pixels_above + column - first];
                uint at_value = VALUES * (first_pixel + row * width + column);
                for (uint k = 0; k < VALUES; k++) found[k] += values[at_value + k] * weight;
            }
        }
    }
    for (uint k = 0; k < VALUES; k++) parts[k][lane()] = found[k];
    barrier();
    if (own > 0 || index >= push.nodes) return;
    for (uint k = 0; k < VALUES; k++) {
        precise float total = parts[k][lane()];
        for (uint i = 1; i < FIT_LANES; i++) total += parts[k][lane() + i];
        sums[VALUES * at + k] = abs(total) < FIT_LEAST ? 0.0 : total;
    }
}
