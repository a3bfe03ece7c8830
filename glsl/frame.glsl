// What the stages of a frame share: the view, the counts, the splat, the tile.

const uint TILE = 16;  // px, width and height

// Elements that one workgroup of a stage takes.
const uint CULL_CHUNK = 1024;
const uint SCAN_CHUNK = 2048;
const uint SORT_CHUNK = 2048;
const uint DUPLICATE_CHUNK = 1024;

// The fast path lists splats in bins, each of 32 blocks of pixels.
const uint BIN_COLUMNS = 8, BIN_ROWS = 4;  // of blocks
const uint BLOCK_WIDTH = 8;                // px; blocks are 4, 8 or 16 px high
const uint BLOCKS = 32;           // in a bin, row by row
const uint MAX_BINS = 7200;       // whose counts leave some of 32 KiB of workgroup memory
const uint BIN_PROJECT_CHUNK = 384;
const uint BIN_CHUNKS = 264;      // parts in which splats are listed
const uint BIN_RUN = 2048;        // entries that a workgroup sorts
const uint BIN_PIECES = 16;       // sorted pieces of a list that are merged at once
// Entries of a long bin, at least: more than are merged at once; several subgroups blend each of its blocks.
const uint LONG_LIST = BIN_RUN * BIN_PIECES;
const uint BIN_STRETCH = 1024;    // entries whose masks lie together

const uint TILE_CLASSES = 6;  // by the length of a tile's list: tile_order.comp

// The camera. Rows of the world-to-view rotation: right, down, forward. What decides a depth comes in two parts, high
// and low, that keep the digits of f64.
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
    float near;
};

// What a frame counted. Demands may exceed what there was room for; the host then grows the workspace.
struct Totals {
    uint visible;          // demand: Gaussians that passed the cull
    uint visible_kept;
    uint spans;            // demand: tile rows touched, over all splats
    uint instances_low;    // demand: tiles touched, over all splats, 64 bits
    uint instances_high;
    uint instances_kept;
    uint longest_list;     // splats in the fullest tile
    uint evaluations_low;  // by a counting blend alone: alphas computed for pixels that had not stopped, 64 bits
    uint evaluations_high;
    uint walked_low;       // and for all lanes of the subgroups that computed them, 64 bits
    uint walked_high;
    uint stopped_pixels;   // opaque before their list ended
    uint listed_tiles;     // with a list
    uint tiles_in_class[TILE_CLASSES];
};

// Workgroup counts of the indirect dispatches.
struct Dispatches {
    uvec3 over_visible;
    uvec3 sort_visible;
    uvec3 scan_visible;
    uvec3 duplicate;
    uvec3 sort_instances;
    uvec3 over_instances;
};

// What is listed in a bin: entries [first, first + count), in runs and stretches of its own.
struct Bin {
    uint first;
    uint count;
    uint first_run;
    uint first_stretch;
};

// Workgroup counts of the fast path's indirect dispatches.
struct BinDispatches {
    uvec3 over_runs;
    uvec3 over_stretches;
    uvec3 over_long_blocks;  // of the first bins of bin_order
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
