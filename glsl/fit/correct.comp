#version 460
#include "shared/workgroup.glsl"
// One invocation per node: moves its opacity and its colour towards the pictures of the children, as `correct` in
// src/lod/fit.rs.
// Before: `sums` of the views of a round. After: `nodes` and the limits in `states` have moved, and `used` counts again
// from 0.

#include "fit/numbers.glsl"
#include "fit/node.glsl"
#include "fit/parameters.glsl"
#include "fit/rows.glsl"

layout(binding = 0, scalar) readonly buffer Sums { float sums[]; };   // [views nodes FIT_RESIDUALS]
layout(binding = 1, scalar) buffer Nodes { FitNode nodes[]; };        // [nodes]
layout(binding = 2, scalar) buffer States { FitState states[]; };     // [nodes]
layout(binding = 3, scalar) buffer Used { FitUse used; };
layout(push_constant, scalar) uniform Push {
    uint nodes;
    uint views;
    float most_factor;
} push;

const float C0 = 0.28209479177387814;

void main() {
    uint index = workgroup() * WORKGROUP + lane();
    if (index == 0) used.records = used.weights = 0;
    if (index >= push.nodes || states[index].is_fitted == 0.0) return;
    precise double all[FIT_RESIDUALS];
    for (uint k = 0; k < FIT_RESIDUALS; k++) {
        all[k] = 0.0LF;
        for (uint view = 0; view < push.views; view++) {
            all[k] += double(sums[FIT_RESIDUALS * (view * push.nodes + index) + k]);
        }
    }
    if (all[1] <= 0.0LF) return;
    double most = double(push.most_factor);
    precise float opacity = nodes[index].opacity * float(clamp(all[0] / all[1], 1.0LF / most, most));
    nodes[index].opacity = opacity;
    states[index].merged_opacity = opacity;
    for (uint k = 0; k < 3; k++) {
        precise float colour = nodes[index].colour[k] + quotient(float(all[2 + k] / all[1]), C0);
        nodes[index].colour[k] = colour;
    }
}
