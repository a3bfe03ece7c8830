// The exact ellipse-tile test: finds the tiles whose pixel centres a splat's ellipse alpha = ALPHA_MIN meets, by rows.
// Requires: frame.glsl, and LISTED, the width and height in px of what splats are listed in
// That is a tile of the portable path or a bin of the fast path; this file calls both a tile.
// A row meets a convex set in an interval, whose ends lie at the set's extreme points or at the row's borders (the idea
// of AccuTile, Hanson et al. 2024). Sums of squares and clamped roots make special cases for needles unnecessary.
#include "shared/rules.glsl"

struct Ellipse {
    vec2 mean_px;
    vec2 extent;        // px, half width and half height; negative for an empty ellipse
    float slope;        // b / c: the horizontal chord at y is centred on x = slope * y
    float width_scale;  // det / c: the half width of the chord at y is sqrt((level - y^2 / c) * width_scale)
    float inverse_c;
    float level;        // squared Mahalanobis distance of the border: 2 ln(opacity / ALPHA_MIN) or less
    float rightmost_y;  // px, y of the rightmost point relative to the mean
};

const Ellipse EMPTY_ELLIPSE = Ellipse(vec2(0.0), vec2(-1.0), 0.0, 0.0, 0.0, 0.0, 0.0);

// `covariance`: (a, b, c, determinant) in units of `unit_px`.
Ellipse ellipse_at(vec2 mean_px, vec4 covariance, float unit_px, float level) {
    float a = covariance.x, b = covariance.y, c = covariance.z;
    Ellipse e;
    e.mean_px = mean_px;
    e.level = level;
    e.extent = unit_px * sqrt(e.level * vec2(a, c));
    e.slope = b / c;
    e.width_scale = unit_px * unit_px * (covariance.w / c);
    e.inverse_c = 1.0 / c / unit_px / unit_px;
    e.rightmost_y = unit_px * b * sqrt(e.level / a);
    if (EXTENT == EXTENT_THREE_SIGMA_SQUARES) {
        // The larger eigenvalue; the floor under the root is that of the original.
        float floor_px4 = 0.1 / (unit_px * unit_px) / (unit_px * unit_px);
        float longest = 0.5 * (a + c) + sqrt(max(0.25 * (a - c) * (a - c) + b * b, floor_px4));
        e.extent = vec2(ceil(3.0 * unit_px * sqrt(longest)));
    }
    return e;
}

// The ellipse on which a splat of this opacity has the alpha ALPHA_MIN.
Ellipse ellipse_of(vec2 mean_px, vec4 covariance, float unit_px, float opacity) {
    if (!(opacity >= ALPHA_MIN)) return EMPTY_ELLIPSE;
    // 1e-4 above the true level: f32 weights of the blend may reach ALPHA_MIN by rounding, and no tile may miss that.
    float level = 2.0 * log(opacity / ALPHA_MIN) + 1e-4;
    if (EXTENT == EXTENT_THREE_SIGMA) level = min(level, 9.0 + 1e-4);
    return ellipse_at(mean_px, covariance, unit_px, level);
}

Ellipse broadcast_ellipse(Ellipse e, uint from) {
    return Ellipse(
        subgroupBroadcast(e.mean_px, from), subgroupBroadcast(e.extent, from), subgroupBroadcast(e.slope, from),
        subgroupBroadcast(e.width_scale, from), subgroupBroadcast(e.inverse_c, from), subgroupBroadcast(e.level, from),
        subgroupBroadcast(e.rightmost_y, from));
}

// The tiles of the pixels from `range.x` to `range.y` along one axis whose pixel centres the interval [low, high] (px)
// meets, as (first, count). A tile begins at `range.x`.
uvec2 tiles_between(float low, float high, uvec2 range, uint side_px) {
    float least = float(range.x / side_px), most = float((range.y + side_px - 1) / side_px);
    float side = float(side_px);
    // The pixel centres of tile t lie from side * t + 0.5 to side * t + side - 0.5.
    float first = ceil((low - (side - 0.5)) / side);
    float end = floor((high - 0.5) / side) + 1.0;
    if (EXTENT == EXTENT_THREE_SIGMA_SQUARES) {
        // The original has pixel centres at integers, and rounds the two ends differently.
        first = floor((low - 0.5) / side);
        end = floor((high - 0.5 + side - 1.0) / side);
    }
    // Clamped as floats, because casts out of range are undefined.
    first = clamp(first, least, most);
    end = clamp(end, least, most);
    // The comparisons are false for NaN, which gives no tile.
    return end > first && low <= high ? uvec2(uint(first), uint(end) - uint(first)) : uvec2(0);
}

// The tile rows of the view that the ellipse may meet, as (first, count). There is no row if the ellipse misses the
// image to the left or right, or lies between pixel centres, as many splats do whose opacity is hardly above ALPHA_MIN.
uvec2 tile_rows(Ellipse e, View view) {
    if (!(e.extent.x >= 0.0)) return uvec2(0);
    // EXTENT_THREE_SIGMA_SQUARES has the tiles of the original, without an allowance for rounding.
    vec2 reach = e.extent + (EXTENT == EXTENT_THREE_SIGMA_SQUARES ? vec2(0.0) : 1e-6 * abs(e.mean_px));
    vec2 low = e.mean_px - reach, high = e.mean_px + reach;
    bool between_centres = any(greaterThan(ceil(low - 0.5), floor(high - 0.5)));
    if (between_centres && EXTENT != EXTENT_THREE_SIGMA_SQUARES) return uvec2(0);
    if (tiles_between(low.x, high.x, uvec2(0, view.size_px.x), LISTED.x).y == 0) return uvec2(0);
    return tiles_between(low.y, high.y, rows_of(view.band), LISTED.y);
}

// The horizontal chord at y (px, relative to the mean), as (x of its centre, half width).
vec2 chord(Ellipse e, float y) {
    return vec2(e.slope * y, sqrt(max(0.0, (e.level - y * y * e.inverse_c) * e.width_scale)));
}

// The tiles of one row that the ellipse meets, packed as first | end << 16.
uint tile_span(Ellipse e, uint row, uvec2 size_px) {
    if (EXTENT == EXTENT_THREE_SIGMA_SQUARES) {
        uvec2 columns = tiles_between(
            e.mean_px.x - e.extent.x, e.mean_px.x + e.extent.x, uvec2(0, size_px.x), LISTED.x);
        return columns.x | (columns.x + columns.y) << 16;
    }
    float low = max(float(row * LISTED.y) + 0.5 - e.mean_px.y, -e.extent.y);
    float high = min(float(min(row * LISTED.y + LISTED.y, size_px.y)) - 0.5 - e.mean_px.y, e.extent.y);
    if (!(low <= high)) return 0;
    vec2 right = chord(e, clamp(e.rightmost_y, low, high));
    vec2 left = chord(e, clamp(-e.rightmost_y, low, high));
    // px: rounding grows with these distances, and the blend computes with them in f32.
    float slack = 1e-6 * (abs(right.x) + abs(left.x) + right.y + left.y + abs(e.mean_px.x)) + 1e-4;
    float first_px = e.mean_px.x + left.x - left.y - slack;
    float last_px = e.mean_px.x + right.x + right.y + slack;
    uvec2 tiles = tiles_between(first_px, last_px, uvec2(0, size_px.x), LISTED.x);
    return tiles.x | (tiles.x + tiles.y) << 16;
}

// The row among those that are drawn of a tile row of the picture.
uint drawn_row(uint row, View view) {
    return row - rows_of(view.band).x / LISTED.y;
}

uint span_length(uint span) {
    return (span >> 16) - (span & 0xffff);
}
