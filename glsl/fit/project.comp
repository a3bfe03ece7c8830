#version 460
#include "shared/workgroup.glsl"
// One invocation per view and node: the node in the picture, as `Splats::of` and the rows of `draw` in
// src/lod/raster.rs.
// Before: `nodes`, `sh` and `views`. After: splats, spans and rows of each node in each view, and the keys of depths;
// `used` counts the row records and the weights. Nodes for which there is no room have no rows.

layout(constant_id = 3) const bool KEEPS_WEIGHTS = true;

#include "shared/ordered.glsl"
#include "fit/numbers.glsl"
#include "fit/node.glsl"
#include "fit/rows.glsl"

layout(binding = 0, scalar) readonly buffer Views { FitView views[]; };
layout(binding = 1, scalar) readonly buffer Nodes { FitNode nodes[]; };        // [nodes]
layout(binding = 2, scalar) readonly buffer Sh { float sh[]; };                // [3 coefficients nodes]
layout(binding = 3, scalar) writeonly buffer Splats { FitSplat splats[]; };    // [views nodes]
layout(binding = 4, scalar) writeonly buffer Spans { FitSpan spans[]; };       // [views nodes]
layout(binding = 5, scalar) writeonly buffer Depths { uint depths[]; };        // [views nodes]
layout(binding = 6, scalar) writeonly buffer Rows { FitRow rows[]; };          // [record_capacity]
layout(binding = 7, scalar) buffer Used { FitUse used; };
layout(push_constant, scalar) uniform Push {
    uint nodes;
    uint coefficients;  // of the harmonics of a node
    uint first_view;
    uint views;
    uint record_capacity;
    uint weight_capacity;
} push;

const double LOW_PASS = 0.300000011920928955078125LF;

// Pixels from x to y, without y, whose centres lie within `reach` of `middle`, of `count`.
uvec2 centres_within(float middle, float reach, uint count) {
    precise float low = middle - reach - 0.5;
    precise float high = middle + reach + 0.5;
    uint begin = uint(clamp(low, 0.0, 65536.0));
    if (low > float(begin)) begin++;
    uint end = min(uint(clamp(high, 0.0, 65536.0)), count);
    return uvec2(min(begin, end), end);
}

struct Ellipse {
    vec2 mean;
    vec3 conic;
    float edge;
    float per_a;
};

// The columns of a row.
uvec2 columns_in(Ellipse ellipse, uint row, uint width) {
    float a = ellipse.conic.x, b = ellipse.conic.y, c = ellipse.conic.z;
    precise float y = float(row) + 0.5 - ellipse.mean.y;
    precise float by = b * y;
    precise float squared = by * by - a * (c * y * y - ellipse.edge);
    if (!(squared > 0.0)) return uvec2(0);
    precise float middle = ellipse.mean.x - by * ellipse.per_a;
    precise float reach = root(squared) * ellipse.per_a;
    return centres_within(middle, reach, width);
}

void main() {
    uint groups = div_up(push.nodes, WORKGROUP);
    uint number = workgroup() / groups, index = workgroup() % groups * WORKGROUP + lane();
    if (number >= push.views || index >= push.nodes) return;
    uint view = push.first_view + number, at = number * push.nodes + index;
    FitNode node = nodes[index];
    dvec3 centre = wide(node.mean);
    dvec3 right = doubles(views[view].right), down = doubles(views[view].down);
    double px = packDouble2x32(views[view].px);
    uvec2 size = uvec2(views[view].width, views[view].height);

    spans[at] = FitSpan(0, 0, 0, 0, 0, 0);
    depths[at] = ~0u;
    dvec2 origin = dvec2(packDouble2x32(views[view].origin[0]), packDouble2x32(views[view].origin[1]));
    precise dvec2 mean = (dvec2(product(right, centre), product(down, centre)) - origin) / px;
    float largest = max(max(node.scale[0], node.scale[1]), node.scale[2]);
    precise double cull_reach = double(FIT_MOST_DEVIATIONS) * (double(largest) / px + sqrt(LOW_PASS));
    if (any(lessThan(mean, dvec2(-cull_reach))) || any(greaterThan(mean, dvec2(size) + cull_reach))) return;
    float depth = float(product(doubles(views[view].forward), centre));
    depths[at] = ordered(floatBitsToUint(depth));

    dvec3 axes[3] = columns_of(turn_of(node));
    dvec3 u, v;
    for (uint i = 0; i < 3; i++) {
        dvec3 axis = scaled(axes[i], double(node.scale[i]));
        u[i] = product(axis, right) / px;
        v[i] = product(axis, down) / px;
    }
    dvec3 normal = cross_product(u, v);
    double sharp = product(normal, normal);
    precise double a = product(u, u) + LOW_PASS, b = product(u, v), c = product(v, v) + LOW_PASS;
    precise double determinant = a * c - b * b;
    precise double compensation = sqrt(sharp / determinant);
    float opacity = float(double(node.opacity) * compensation);
    precise vec3 conic = vec3(float(c / determinant), float(-b / determinant), float(a / determinant));

    FitSplat splat;
    for (uint k = 0; k < 3; k++) {
        precise double higher = 0.0LF;
        for (uint i = 1; i < push.coefficients; i++) {
            higher += double(sh[3 * (push.coefficients * index + i) + k]) * packDouble2x32(views[view].basis[i]);
        }
        precise double colour = 0.5LF + double(node.colour[k]) * packDouble2x32(views[view].basis[0]) + higher;
        splat.colour[k] = float(max(colour, 0.0LF));
        splat.conic[k] = conic[k];
    }
    vec2 mean_px = vec2(mean);
    splat.mean = float[2](mean_px.x, mean_px.y);
    splat.opacity = opacity;
    splat.is_new = node.is_new;
    splats[at] = splat;
    if (!(opacity > FIT_ALPHA_MIN)) return;

    precise float ratio = opacity * FIT_PER_ALPHA_MIN;
    precise float edge = 2.0 * LN_2 * logarithm_to_two(ratio);
    precise double reach = sqrt(double(edge) * c);
    uvec2 all = centres_within(mean_px.y, float(reach), size.y);
    Ellipse ellipse = Ellipse(mean_px, conic, edge, quotient(1.0, conic.x));
    uint pixels = 0, first_column = ~0u, end_column = 0;
    for (uint row = all.x; row < all.y; row++) {
        uvec2 columns = columns_in(ellipse, row, size.x);
        if (columns.x == columns.y) continue;
        pixels += columns.y - columns.x;
        first_column = min(first_column, columns.x);
        end_column = max(end_column, columns.y);
    }
    if (pixels == 0) return;
    uint records = all.y - all.x;
    uint first_record = atomicAdd(used.records, records);
    uint first_weight = KEEPS_WEIGHTS ? atomicAdd(used.weights, pixels) : 0;
    if (first_record + records > push.record_capacity || first_weight + pixels > push.weight_capacity) {
        used.is_full = 1;
        return;
    }
    spans[at] = FitSpan(all.x, all.y, first_column, end_column, first_record, first_weight);
    uint above = 0;
    for (uint row = all.x; row < all.y; row++) {
        uvec2 columns = columns_in(ellipse, row, size.x);
        rows[first_record + row - all.x] = FitRow(columns.x | columns.y << 16, above);
        above += columns.y - columns.x;
    }
}
