#version 460
#include "shared/workgroup.glsl"
// One group of FIT_LANES invocations per view and node: the gradient by its parameters, as src/lod/gradient.rs.
// Before: weights, slopes and colours of blend. After: `gradients`.

#include "fit/numbers.glsl"
#include "fit/node.glsl"
#include "fit/parameters.glsl"
#include "fit/rows.glsl"

layout(binding = 0, scalar) readonly buffer Views { FitView views[]; };
layout(binding = 1, scalar) readonly buffer Nodes { FitNode nodes[]; };              // [nodes]
layout(binding = 2, scalar) readonly buffer Splats { FitSplat splats[]; };           // [views nodes]
layout(binding = 3, scalar) readonly buffer Spans { FitSpan spans[]; };              // [views nodes]
layout(binding = 4, scalar) readonly buffer Rows { FitRow rows[]; };
layout(binding = 5, scalar) readonly buffer Weights { float weights[]; };
layout(binding = 6, scalar) readonly buffer Slopes { float slopes[]; };
layout(binding = 7, scalar) readonly buffer ByColours { float by_colours[]; };       // [3 pixels of the round]
layout(binding = 8, scalar) writeonly buffer Gradients { FitGradient gradients[]; };  // [views nodes]
layout(push_constant, scalar) uniform Push {
    uint nodes;
    uint first_view;
    uint views;
} push;

const uint SUMS = 9;
const uint LOADED = 4;
const uint SPLATS = WORKGROUP / FIT_LANES;
const double LEAST = 1e-24LF;
const double MIN_POSITIVE = 2.2250738585072014e-308LF;
const double C0 = 0.28209479177387814LF;
shared float parts[SUMS][WORKGROUP];

// Writes the gradient of a node from its sums over pixels.
void write(uint at, uint view, uint index, double sums[SUMS]) {
    FitNode node = nodes[index];
    FitSplat splat = splats[at];
    double a = splat.conic[0], b = splat.conic[1], c = splat.conic[2];
    double sum = sums[0], x = sums[1], y = sums[2], xx = sums[3], xy = sums[4], yy = sums[5];
    dvec3 right = doubles(views[view].right), down = doubles(views[view].down);
    double px = packDouble2x32(views[view].px);
    dvec3 scale = wide(node.scale);
    dvec3 axes[3] = columns_of(turn_of(node));
    dvec3 along_x, along_y;
    for (uint i = 0; i < 3; i++) {
        along_x[i] = product(axes[i], right) / px;
        along_y[i] = product(axes[i], down) / px;
    }
    precise dvec3 u = along_x * scale, v = along_y * scale;
    precise dvec3 by_mean = u * (a * x + b * y) + v * (b * x + c * y);
    precise double ax = a * xx + b * xy, ay = a * xy + b * yy, bx = b * xx + c * xy, by = b * xy + c * yy;
    precise double uu = ax * a + ay * b - sum * a, uv = ax * b + ay * c - sum * b, vv = bx * b + by * c - sum * c;
    dvec3 area = cross_product(u, v);
    precise dvec3 by_area = area * (sum / max(product(area, area), MIN_POSITIVE));
    precise dvec3 by_u = u * uu + v * uv + cross_product(v, by_area);
    precise dvec3 by_v = u * uv + v * vv + cross_product(by_area, u);
    precise dvec3 by_scale = u * by_u + v * by_v;
    precise dvec3 scaled_u = scale * by_u, scaled_v = scale * by_v;
    precise dvec3 by_turn = -(cross_product(along_x, scaled_u) + cross_product(along_y, scaled_v));
    double found[FIT_PARAMETERS];
    for (uint k = 0; k < 3; k++) {
        found[k] = by_mean[k];
        found[3 + k] = by_scale[k];
        found[6 + k] = by_turn[k];
        precise double by_colour = sums[6 + k] * C0;
        found[10 + k] = splat.colour[k] > 0.0 ? by_colour : 0.0LF;
    }
    found[9] = sum;
    for (uint k = 0; k < FIT_PARAMETERS; k++) gradients[at].by[k] = abs(found[k]) < LEAST ? 0.0 : float(found[k]);
}

void main() {
    uint groups = div_up(push.nodes, SPLATS);
    uint number = workgroup() / groups, index = workgroup() % groups * SPLATS + lane() / FIT_LANES;
    if (number >= push.views) return;
    uint view = push.first_view + number, at = number * push.nodes + index, own = lane() % FIT_LANES;
    precise float sums[SUMS];
    for (uint k = 0; k < SUMS; k++) sums[k] = 0.0;
    if (index < push.nodes) {
        FitSpan span = spans[at];
        uint width = views[view].width;
        uint first_pixel = views[view].first_pixel - views[push.first_view].first_pixel;
        for (uint row = span.end_row; row > span.first_row; row--) {
            FitRow record = rows[span.first_record + row - 1 - span.first_row];
            uint first = record.columns & 0xffff, end = record.columns >> 16;
            precise float y = float(row - 1) + 0.5 - splats[at].mean[1];
            precise float x0 = float(first) + 0.5 - splats[at].mean[0];
            precise float x = x0 + float(own);
            uint place = span.first_weight + record.pixels_above - first;
            // Several columns are loaded before they are added, so that the loads are waited for together.
            for (uint column = first + own; column < end; column += LOADED * FIT_LANES) {
                float weight[LOADED], slope[LOADED];
                vec3 by_colour[LOADED];
                for (uint i = 0; i < LOADED; i++) {
                    uint loaded = min(column + i * FIT_LANES, end - 1);
                    weight[i] = weights[place + loaded];
                    slope[i] = slopes[place + loaded];
                    uint at_pixel = 3 * (first_pixel + (row - 1) * width + loaded);
                    for (uint k = 0; k < 3; k++) by_colour[i][k] = by_colours[at_pixel + k];
                }
                for (uint i = 0; i < LOADED && column + i * FIT_LANES < end; i++) {
                    precise float by_x = slope[i] * x, by_y = slope[i] * y;
                    sums[0] += slope[i];
                    sums[1] += by_x;
                    sums[2] += by_y;
                    sums[3] += by_x * x;
                    sums[4] += by_x * y;
                    sums[5] += by_y * y;
                    for (uint k = 0; k < 3; k++) sums[6 + k] += by_colour[i][k] * weight[i];
                    x += float(FIT_LANES);
                }
            }
        }
    }
    for (uint k = 0; k < SUMS; k++) parts[k][lane()] = sums[k];
    barrier();
    if (own > 0 || index >= push.nodes) return;
    double all[SUMS];
    for (uint k = 0; k < SUMS; k++) {
        precise float total = parts[k][lane()];
        for (uint i = 1; i < FIT_LANES; i++) total += parts[k][lane() + i];
        all[k] = double(total);
    }
    // Nodes that are not drawn may have no splat.
    if (spans[at].first_row == spans[at].end_row) {
        for (uint k = 0; k < FIT_PARAMETERS; k++) gradients[at].by[k] = 0.0;
    } else {
        write(at, view, index, all);
    }
}
