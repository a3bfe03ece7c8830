// The exact ellipse-tile test: where the ellipse alpha = ALPHA_MIN of a splat meets the pixel centres of each tile row.
// Rows meet a convex set in an interval, whose ends lie at the set's extreme points or at the row's borders
// (the idea of AccuTile, Hanson et al. 2024). Sums of squares and clamped roots: needles and huge splats need no care.

// Behind the declaration of LISTED, the width and height in px of the tiles that splats are listed in.
#include "shared/rules.glsl"


struct Ellipse {
    vec2 mean_px;
    vec2 extent;        // px, half width and half height; negative for an ellipse without a point
    float slope;        // b / c: the ellipse's chords in y are centred on x = slope * y
    float width_scale;  // det / c: the half width of the chord at y is sqrt((level - y^2 / c) * width_scale)
    float inverse_c;
    float level;        // Mahalanobis distance squared of the border: 2 ln(opacity / ALPHA_MIN), if not cut
    float rightmost_y;  // px, height of the rightmost point above the mean
};

const Ellipse EMPTY_ELLIPSE = Ellipse(vec2(0.0), vec2(-1.0), 0.0, 0.0, 0.0, 0.0, 0.0);

// `covariance`: (a, b, c, determinant) in units of `unit_px`.
Ellipse ellipse_of(vec2 mean_px, vec4 covariance, float unit_px, float opacity) {
    if (!(opacity >= ALPHA_MIN)) return EMPTY_ELLIPSE;
    float a = covariance.x, b = covariance.y, c = covariance.z;
    Ellipse e;
    e.mean_px = mean_px;
    // 1e-4 over the true level: blend's f32 weights may pass ALPHA_MIN by their rounding, and no tile may miss that.
    e.level = 2.0 * log(opacity / ALPHA_MIN) + 1e-4;
    if (EXTENT == EXTENT_THREE_SIGMA) e.level = min(e.level, 9.0 + 1e-4);
    e.extent = unit_px * sqrt(e.level * vec2(a, c));
    e.slope = b / c;
    e.width_scale = unit_px * unit_px * (covariance.w / c);
    e.inverse_c = 1.0 / c / unit_px / unit_px;
    e.rightmost_y = unit_px * b * sqrt(e.level / a);
    if (EXTENT == EXTENT_THREE_SIGMA_SQUARES) {
        // The larger eigenvalue, with the original's floor under the root.
        float floor_px4 = 0.1 / (unit_px * unit_px) / (unit_px * unit_px);
        float longest = 0.5 * (a + c) + sqrt(max(0.25 * (a - c) * (a - c) + b * b, floor_px4));
        e.extent = vec2(ceil(3.0 * unit_px * sqrt(longest)));
    }
    return e;
}

Ellipse broadcast_ellipse(Ellipse e, uint from) {
    return Ellipse(
        subgroupBroadcast(e.mean_px, from), subgroupBroadcast(e.extent, from), subgroupBroadcast(e.slope, from),
        subgroupBroadcast(e.width_scale, from), subgroupBroadcast(e.inverse_c, from), subgroupBroadcast(e.level, from),
        subgroupBroadcast(e.rightmost_y, from));
}

// Tiles [first, last + 1) along one axis whose pixel centres the interval [low, high] px meets, as (first, count).
uvec2 tiles_between(float low, float high, uint size_px, uint side_px) {
    uint tiles = (size_px + side_px - 1) / side_px;
    float side = float(side_px);
    // Tile t has centres from side t + 0.5 to side t + side - 0.5.
    float first = ceil((low - (side - 0.5)) / side);
    float end = floor((high - 0.5) / side) + 1.0;
    if (EXTENT == EXTENT_THREE_SIGMA_SQUARES) {
        // The original's, whose pixel centres are integers: lower on one side, and not the same on both.
        first = floor((low - 0.5) / side);
        end = floor((high - 0.5 + side - 1.0) / side);
    }
    // Clamped as floats: casts out of range are undefined.
    first = clamp(first, 0.0, float(tiles));
    end = clamp(end, 0.0, float(tiles));
    // Positive phrasing: NaN gives no tile.
    return end > first && low <= high ? uvec2(uint(first), uint(end) - uint(first)) : uvec2(0);
}

// Tile rows that the ellipse may meet, as (first, count); no row if it misses the image sideways, or lies between pixel
// centres, as the many splats do whose opacity is hardly more than ALPHA_MIN.
uvec2 tile_rows(Ellipse e, uvec2 size_px) {
    if (!(e.extent.x >= 0.0)) return uvec2(0);
    // What is rounded generously elsewhere has the original's tiles here.
    vec2 reach = e.extent + (EXTENT == EXTENT_THREE_SIGMA_SQUARES ? vec2(0.0) : 1e-6 * abs(e.mean_px));
    vec2 low = e.mean_px - reach, high = e.mean_px + reach;
    bool between_centres = any(greaterThan(ceil(low - 0.5), floor(high - 0.5)));
    if (between_centres && EXTENT != EXTENT_THREE_SIGMA_SQUARES) return uvec2(0);
    if (tiles_between(low.x, high.x, size_px.x, LISTED.x).y == 0) return uvec2(0);
    return tiles_between(low.y, high.y, size_px.y, LISTED.y);
}

// Half width of the chord at y (px, relative to the mean), and its centre.
vec2 chord(Ellipse e, float y) {
    return vec2(e.slope * y, sqrt(max(0.0, (e.level - y * y * e.inverse_c) * e.width_scale)));
}

// The tiles of one row that the ellipse meets, packed as first | end << 16.
uint tile_span(Ellipse e, uint row, uvec2 size_px) {
    if (EXTENT == EXTENT_THREE_SIGMA_SQUARES) {
        uvec2 columns = tiles_between(e.mean_px.x - e.extent.x, e.mean_px.x + e.extent.x, size_px.x, LISTED.x);
        return columns.x | (columns.x + columns.y) << 16;
    }
    float low = max(float(row * LISTED.y) + 0.5 - e.mean_px.y, -e.extent.y);
    float high = min(float(min(row * LISTED.y + LISTED.y, size_px.y)) - 0.5 - e.mean_px.y, e.extent.y);
    if (!(low <= high)) return 0;
    vec2 right = chord(e, clamp(e.rightmost_y, low, high));
    vec2 left = chord(e, clamp(-e.rightmost_y, low, high));
    // Rounding grows with the distances it comes from; blend weighs the same distances in f32.
    float slack = 1e-6 * (abs(right.x) + abs(left.x) + right.y + left.y + abs(e.mean_px.x)) + 1e-4;
    float first_px = e.mean_px.x + left.x - left.y - slack;
    float last_px = e.mean_px.x + right.x + right.y + slack;
    uvec2 tiles = tiles_between(first_px, last_px, size_px.x, LISTED.x);
    return tiles.x | (tiles.x + tiles.y) << 16;
}

uint span_length(uint span) {
    return (span >> 16) - (span & 0xffff);
}
