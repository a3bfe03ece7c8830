// The types that the stages of both paths share: the view, the counts, the splat.

const uint TILE_CLASSES = 6;  // classes of tiles by the length of their list: tile_order.comp

// The camera. `right`, `down` and `forward` are the rows of the world-to-view rotation. Vectors that decide a depth are
// sums of two f32, a high and a low part, which together keep 48 bits of the f64 value.
struct View {
    vec3 right;
    vec3 down;
    vec3 forward;
    vec3 forward_low;
    vec3 position_high;  // world
    vec3 position_low;
    vec2 focal_px;
    vec2 centre_px;
    uvec2 size_px;
    uint band;  // the rows of the picture that are drawn: the first, and in the upper half their number less 1
    float near;
};

// The first row of pixels of a band, and one past the last.
uvec2 rows_of(uint band) {
    uint top = band & 0xffff;
    return uvec2(top, top + (band >> 16) + 1);
}

// The counts of a frame. A cell is what splats are listed in: a tile of the portable path, a bin of the fast path.
// Demands may exceed the capacity of the frame's buffers; the host then enlarges them and draws the frame again.
struct Totals {
    uint visible;          // demand: Gaussians that passed the cull
    uint visible_kept;
    uint spans;            // demand: rows of cells touched, over all splats
    uint listed_low;       // demand: cells touched, over all splats, 64 bits
    uint listed_high;
    uint listed_kept;
    uint longest_list;     // splats in the fullest cell
    // Only the portable path sets the rest: the first six if its blend counts its work, the classes always.
    uint evaluations_low;  // alphas computed for pixels that had not stopped, 64 bits
    uint evaluations_high;
    uint walked_low;       // the same, counted for all lanes of their subgroups, stopped or not, 64 bits
    uint walked_high;
    uint stopped_pixels;   // pixels that stopped before their list ended
    uint listed_tiles;     // tiles whose list is not empty
    uint tiles_in_class[TILE_CLASSES];
};

// A projected Gaussian. Its weight at an offset d (px, pixel minus mean) is
// opacity * exp2(-(u*u + v*v)) with u = factor.x * d.x + factor.y * d.y, v = factor.z * d.y:
// the Cholesky factor of the conic, times sqrt(log2(e) / 2). A sum of squares cannot turn negative.
struct Splat {
    vec2 mean_px;
    vec3 factor;
    float opacity;
    vec3 colour;
};

const float LOW_PASS = 0.3;  // px^2, the original's dilation of the 2D covariance

// The view that the shared code draws: that of the push constants, where a shader has not defined another.
#ifndef VIEW
#define VIEW push.view
#endif
