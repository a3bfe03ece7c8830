#version 460
#include "shared/workgroup.glsl"
// One invocation per node: a step of Adam's method, as `Descent::on_host` and `change` in src/lod/descent.rs.
// Before: `gradients` of the views of a round. After: `nodes` have moved, and `used` counts again from 0.

#include "fit/numbers.glsl"
#include "fit/node.glsl"
#include "fit/parameters.glsl"
#include "fit/rows.glsl"

layout(binding = 0, scalar) readonly buffer Gradients { FitGradient gradients[]; };  // [views nodes]
layout(binding = 1, scalar) buffer Nodes { FitNode nodes[]; };                       // [nodes]
layout(binding = 2, scalar) buffer States { FitState states[]; };                    // [nodes]
layout(binding = 3, scalar) buffer Used { FitUse used; };
layout(push_constant, scalar) uniform Push {
    uint nodes;
    uint views;
    vec3 low;
    vec3 high;
    vec2 replaced;  // the parts of the means of gradients and of squares that a round replaces
    vec2 filled;    // the parts that the rounds have filled
    float step_length;
    float least_gradient;
    float most_change;
} push;

// e^x up to x^2.
float growth(float x) {
    precise float factor = 1.0 + x + 0.5 * x * x;
    return factor;
}

float limited(float value, float merged) {
    precise float most = merged * push.most_change;
    return clamp(value, quotient(merged, push.most_change), most);
}

void main() {
    uint index = workgroup() * WORKGROUP + lane();
    if (index == 0) used.records = used.weights = 0;
    if (index >= push.nodes || states[index].is_fitted == 0.0) return;
    float steps[FIT_PARAMETERS];
    for (uint k = 0; k < FIT_PARAMETERS; k++) {
        precise float gradient = 0.0;
        for (uint view = 0; view < push.views; view++) gradient += gradients[view * push.nodes + index].by[k];
        precise float mean = states[index].gradient[k];
        precise float square = states[index].square[k];
        mean += push.replaced.x * (gradient - mean);
        square += push.replaced.y * (gradient * gradient - square);
        states[index].gradient[k] = mean;
        states[index].square[k] = square;
        precise float upper = -push.step_length * quotient(mean, push.filled.x);
        steps[k] = quotient(upper, max(root(quotient(square, push.filled.y)), push.least_gradient));
    }
    FitNode node = nodes[index];
    dvec4 old = turn_of(node);
    dvec3 axes[3] = columns_of(old);
    precise dvec3 half_turn = 0.5LF * dvec3(steps[6], steps[7], steps[8]);
    // The product of the old turn and a small one, half_turn and 1.
    precise dvec4 product_of_turns = dvec4(
        old.w * half_turn.x + old.x + old.y * half_turn.z - old.z * half_turn.y,
        old.w * half_turn.y - old.x * half_turn.z + old.y + old.z * half_turn.x,
        old.w * half_turn.z + old.x * half_turn.y - old.y * half_turn.x + old.z,
        old.w - old.x * half_turn.x - old.y * half_turn.y - old.z * half_turn.z);
    dvec4 turn = normalized(product_of_turns);
    precise dvec3 moved = scaled(scaled(axes[0], double(node.scale[0])), double(steps[0]));
    moved += scaled(scaled(axes[1], double(node.scale[1])), double(steps[1]));
    moved += scaled(scaled(axes[2], double(node.scale[2])), double(steps[2]));
    precise dvec3 centre = wide(node.mean) + moved;
    node.rotation = float[4](float(turn.w), float(turn.x), float(turn.y), float(turn.z));
    for (uint k = 0; k < 3; k++) {
        node.mean[k] = clamp(float(centre[k]), push.low[k], push.high[k]);
        precise float scale = node.scale[k] * growth(steps[3 + k]);
        node.scale[k] = limited(scale, states[index].merged_scale[k]);
        node.size = max(node.size, node.scale[k]);
        precise float colour = node.colour[k] + steps[10 + k];
        node.colour[k] = colour;
    }
    precise float opacity = node.opacity * growth(steps[9]);
    node.opacity = limited(opacity, states[index].merged_opacity);
    nodes[index] = node;
}
