#version 460
#include "shared/workgroup.glsl"
// One workgroup per tile of FIT_TILE x FIT_TILE px of a view: compares the pictures of the children and of the parents,
// as src/lod/fit.rs and src/lod/difference.rs.
// Before: `expected` and `drawn`, and with MEASURES `covered`. After: `values` of each pixel: FIT_RESIDUALS, or with
// MEASURES what a new node has of the squared difference by its weight; then the sums of the tile are in `tiles`, too.

layout(constant_id = 3) const bool MEASURES = true;

#include "fit/numbers.glsl"
#include "fit/node.glsl"
#include "fit/rows.glsl"

// Sums of squared differences, doubles in two words, with pixels of 1 x 1, 2 x 2 and 4 x 4 px.
struct FitTile {
    uvec2 sums[3];
};

layout(binding = 0, scalar) readonly buffer Views { FitView views[]; };
layout(binding = 1, scalar) readonly buffer Expected { vec4 expected[]; };   // [pixels]: colour, transmittance
layout(binding = 2, scalar) readonly buffer Drawn { vec4 drawn[]; };         // [pixels]
layout(binding = 3, scalar) readonly buffer Covered { float covered[]; };    // [pixels]
layout(binding = 4, scalar) writeonly buffer Values { float values[]; };     // [pixels] or [FIT_RESIDUALS pixels]
layout(binding = 5, scalar) writeonly buffer Tiles { FitTile tiles[]; };     // [views tiles]
layout(push_constant, scalar) uniform Push {
    uint first_view;
    uint views;
    uint tiles;  // most tiles of a view
    float least_alpha;
    float least_covered;
} push;

shared vec4 differences[WORKGROUP];
shared double squares[WORKGROUP];
shared double squares_of_2[WORKGROUP / 4];
shared double squares_of_4[WORKGROUP / 16];

// As `mean_square` in src/lod/difference.rs.
float mean_square(vec4 difference) {
    precise vec3 black = difference.xyz * difference.xyz;
    precise vec3 on_white = difference.xyz + difference.w;
    precise vec3 white = on_white * on_white;
    precise float mean = 0.5 * ((black.x + black.y + black.z) + (white.x + white.y + white.z));
    return mean < FIT_LEAST ? 0.0 : mean;
}

// The square of a block of `side` x `side` differences, times its pixels, of which `part` is the inverse.
double square_of_block(uint side, float part) {
    uint blocks = FIT_TILE / side, first = lane() / blocks * side * FIT_TILE + lane() % blocks * side;
    precise vec4 sum = vec4(0.0);
    for (uint y = 0; y < side; y++) {
        for (uint x = 0; x < side; x++) sum += differences[first + y * FIT_TILE + x];
    }
    precise vec4 mean = sum * part;
    return double(mean_square(mean)) * double(side * side);
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
    bool exists = pixel.x < width && pixel.y < height;
    uint at = views[view].first_pixel + pixel.y * width + pixel.x;
    uint at_value = at - views[push.first_view].first_pixel;
    vec4 child = exists ? expected[at] : vec4(0.0), own = exists ? drawn[at] : vec4(0.0);

    if (!MEASURES) {
        if (!exists) return;
        precise float alpha = 1.0 - child.w, own_alpha = 1.0 - own.w;
        precise vec3 missing = child.xyz * quotient(own_alpha, alpha) - own.xyz;
        values[FIT_RESIDUALS * at_value] = alpha;
        values[FIT_RESIDUALS * at_value + 1] = own_alpha;
        for (uint k = 0; k < 3; k++) {
            values[FIT_RESIDUALS * at_value + 2 + k] = alpha > push.least_alpha ? missing[k] : 0.0;
        }
        return;
    }

    precise vec4 difference = child - own;
    float squared = mean_square(difference);
    if (exists) values[at_value] = quotient(squared, max(covered[at], push.least_covered));
    differences[lane()] = difference;
    squares[lane()] = double(squared);
    barrier();
    if (lane() < WORKGROUP / 4) squares_of_2[lane()] = square_of_block(2, 0.25);
    if (lane() < WORKGROUP / 16) squares_of_4[lane()] = square_of_block(4, 0.0625);
    for (uint left = WORKGROUP / 2; left > 0; left /= 2) {
        barrier();
        if (lane() < left) {
            precise double sum = squares[lane()] + squares[lane() + left];
            squares[lane()] = sum;
        }
        if (lane() < left && left <= WORKGROUP / 8) {
            precise double sum = squares_of_2[lane()] + squares_of_2[lane() + left];
            squares_of_2[lane()] = sum;
        }
        if (lane() < left && left <= WORKGROUP / 32) {
            precise double sum = squares_of_4[lane()] + squares_of_4[lane() + left];
            squares_of_4[lane()] = sum;
        }
    }
    if (lane() > 0) return;
    uvec2 sums[3] = uvec2[3](
        unpackDouble2x32(squares[0]), unpackDouble2x32(squares_of_2[0]), unpackDouble2x32(squares_of_4[0]));
    tiles[number * push.tiles + tile_index] = FitTile(sums);
}
