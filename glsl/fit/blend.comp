#version 460
#include "shared/workgroup.glsl"
// One workgroup per tile of FIT_TILE x FIT_TILE px of a view: blends the nodes front to back, as `draw` in
// src/lod/raster.rs. With WALKS_BACK, it walks the nodes from back to front, too, and writes what src/lod/gradient.rs
// sums up over the pixels of a node.
// Before: splats, spans, rows and order; with WALKS_BACK the `pictures` of the children. After: `pictures`; with
// KEEPS_WEIGHTS `covered` and `weights`, too; with WALKS_BACK `weights`, `slopes` and `by_colours`.

layout(constant_id = 3) const bool KEEPS_WEIGHTS = true;
layout(constant_id = 4) const bool WALKS_BACK = true;  // only with KEEPS_WEIGHTS

#include "fit/numbers.glsl"
#include "fit/node.glsl"
#include "fit/rows.glsl"

layout(binding = 0, scalar) readonly buffer Views { FitView views[]; };
layout(binding = 1, scalar) readonly buffer Splats { FitSplat splats[]; };   // [views nodes]
layout(binding = 2, scalar) readonly buffer Spans { FitSpan spans[]; };      // [views nodes]
layout(binding = 3, scalar) readonly buffer Rows { FitRow rows[]; };
layout(binding = 4, scalar) readonly buffer Order { uint order[]; };         // [views nodes]
layout(binding = 5, scalar) buffer Pictures { vec4 pictures[]; };            // [pixels]: colour, transmittance
layout(binding = 6, scalar) buffer Weights { float weights[]; };             // [weight_capacity]
layout(binding = 7, scalar) writeonly buffer Slopes { float slopes[]; };     // [weight_capacity]: by the log of alpha
layout(binding = 8, scalar) writeonly buffer ByColours { float by_colours[]; };  // [3 pixels of the round]
layout(binding = 9, scalar) writeonly buffer Covered { float covered[]; };   // [pixels]: weights of new nodes
layout(push_constant, scalar) uniform Push {
    uint nodes;
    uint first_view;
    uint views;
    uint tiles;  // most tiles of a view
    float alpha_max;
    float clamped;  // larger alphas are clamped ones
} push;

// The near nodes: those of WORKGROUP nodes of the order that touch the tile.
shared FitSplat near_splats[WORKGROUP];
shared FitSpan near_spans[WORKGROUP];

// Loads the near nodes of the order from `begin` on. Returns their number. The whole workgroup must call it.
uint load_near(uint number, uint begin, uvec2 tile) {
    uint place = begin + lane();
    bool touches = false;
    uint at = 0;
    FitSpan span;
    if (place < push.nodes) {
        at = number * push.nodes + order[number * push.nodes + place];
        span = spans[at];
        touches = span.first_row < tile.y + FIT_TILE && span.end_row > tile.y && span.first_column < tile.x + FIT_TILE
            && span.end_column > tile.x;
    }
    uint total;
    uint before = workgroup_exclusive_add(uint(touches), total);  // begins with a barrier
    if (touches) {
        near_splats[before] = splats[at];
        near_spans[before] = span;
    }
    barrier();
    return total;
}

// The rows of the tile in STAGED near nodes: the columns, and the place of the weight of the first one. Each invocation
// loads some of them together, so that the loads are waited for together.
const uint LOADED = 4;
const uint STAGED = LOADED * WORKGROUP / FIT_TILE;
shared uvec2 staged[STAGED][FIT_TILE];

// Loads the rows of STAGED near nodes from `first` on, of `near`. The whole workgroup must call it.
void stage_rows(uint first, uint near, uint tile_y) {
    uint node = lane() / FIT_TILE, row = tile_y + lane() % FIT_TILE;
    uvec2 found[LOADED];
    for (uint i = 0; i < LOADED; i++) {
        uint index = first + node + i * (STAGED / LOADED);
        FitSpan span = near_spans[min(index, WORKGROUP - 1)];
        bool has_row = index < near && row >= span.first_row && row < span.end_row;
        FitRow record = rows[has_row ? span.first_record + row - span.first_row : 0];
        found[i] = has_row ? uvec2(record.columns, span.first_weight + record.pixels_above) : uvec2(0);
    }
    barrier();  // lanes may still read the rows of an earlier call
    for (uint i = 0; i < LOADED; i++) staged[node + i * (STAGED / LOADED)][lane() % FIT_TILE] = found[i];
    barrier();
}

// The alpha of a node in a column of the row.
float alpha_at(FitSplat splat, float y, uint first_column, uint column) {
    const float LOG_2 = -0.5 * LOG_2_E;
    float a = splat.conic[0], b = splat.conic[1], c = splat.conic[2];
    precise float x0 = float(first_column) + 0.5 - splat.mean[0];
    precise float x = x0 + float(column - first_column);
    precise float squared = LOG_2 * a;
    precise float linear = LOG_2 * 2.0 * b * y;
    precise float constant = LOG_2 * c * y * y;
    precise float exponent = constant + x * (linear + x * squared);
    precise float alpha = min(splat.opacity * power_of_two(exponent), push.alpha_max);
    return alpha;
}

void main() {
    uint number = workgroup() / push.tiles, tile_index = workgroup() % push.tiles;
    if (number >= push.views) return;
    uint view = push.first_view + number;
    uint width = views[view].width, height = views[view].height;
    uint columns = div_up(width, FIT_TILE);
    if (tile_index >= columns * div_up(height, FIT_TILE)) return;
    uvec2 tile = uvec2(tile_index % columns, tile_index / columns) * FIT_TILE;
    uvec2 pixel = tile + uvec2(lane() % FIT_TILE, lane() / FIT_TILE);

    vec4 drawn = vec4(0.0, 0.0, 0.0, 1.0);
    precise float of_new = 0.0;
    for (uint begin = 0; begin < push.nodes; begin += WORKGROUP) {
        uint near = load_near(number, begin, tile);
        for (uint first = 0; first < near; first += STAGED) {
            stage_rows(first, near, tile.y);
            for (uint i = first; i < min(first + STAGED, near); i++) {
                uvec2 row = staged[i - first][pixel.y - tile.y];
                uint begin_column = row.x & 0xffff;
                if (pixel.x < begin_column || pixel.x >= row.x >> 16) continue;
                FitSplat splat = near_splats[i];
                precise float y = float(pixel.y) + 0.5 - splat.mean[1];
                precise float weight = alpha_at(splat, y, begin_column, pixel.x) * drawn.w;
                precise vec4 sum = drawn
                    + vec4(splat.colour[0] * weight, splat.colour[1] * weight, splat.colour[2] * weight, -weight);
                drawn = sum;
                if (KEEPS_WEIGHTS) weights[row.y + pixel.x - begin_column] = weight;
                if (KEEPS_WEIGHTS && splat.is_new > 0.0) of_new += weight;
            }
        }
    }
    bool exists = pixel.x < width && pixel.y < height;
    uint at = views[view].first_pixel + pixel.y * width + pixel.x;
    if (!WALKS_BACK) {
        if (exists) pictures[at] = drawn;
        if (KEEPS_WEIGHTS && exists) covered[at] = of_new;
        return;
    }

    // As `Backward::begin`.
    precise vec4 on_black = drawn - (exists ? pictures[at] : drawn);
    precise vec3 on_white = on_black.xyz + on_black.w;
    precise vec3 by_colour = on_black.xyz + on_white;
    precise float by_passing = on_white.x + on_white.y + on_white.z;
    uint first_value = 3 * (at - views[push.first_view].first_pixel);
    for (uint k = 0; exists && k < 3; k++) by_colours[first_value + k] = by_colour[k];
    // As `add` in src/lod/gradient.rs.
    vec4 behind = vec4(0.0, 0.0, 0.0, 1.0);
    float passing = drawn.w;
    for (uint part = div_up(push.nodes, WORKGROUP); part > 0; part--) {
        uint near = load_near(number, (part - 1) * WORKGROUP, tile);
        for (uint end = div_up(near, STAGED) * STAGED; end > 0; end -= STAGED) {
            uint first = end - STAGED;
            stage_rows(first, near, tile.y);
            for (uint i = min(end, near); i > first; i--) {
                uvec2 row = staged[i - 1 - first][pixel.y - tile.y];
                uint begin_column = row.x & 0xffff;
                if (pixel.x < begin_column || pixel.x >= row.x >> 16) continue;
                FitSplat splat = near_splats[i - 1];
                uint place = row.y + pixel.x - begin_column;
                float weight = weights[place];
                precise vec3 apart = vec3(splat.colour[0], splat.colour[1], splat.colour[2]) - behind.xyz;
                precise float before = passing + weight;
                float alpha = quotient(weight, max(before, 1e-12));
                precise float through_colour =
                    by_colour.x * apart.x + by_colour.y * apart.y + by_colour.z * apart.z;
                precise float by_weight = through_colour - by_passing * behind.w;
                precise float slope = weight * by_weight;
                if (alpha >= push.clamped) slope = 0.0;
                slopes[place] = slope;
                precise vec4 all = behind + vec4(alpha * apart, -(alpha * behind.w));
                behind = all;
                passing = before;
            }
        }
    }
}
