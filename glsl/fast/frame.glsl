// What the stages of the fast path share: bins, blocks, runs, indirect dispatches.
#include "shared/frame.glsl"

// Splats are listed in bins of 32 blocks of pixels.
const uint BIN_COLUMNS = 8, BIN_ROWS = 4;  // blocks in a bin
const uint BLOCKS = 32;          // blocks in a bin, numbered row by row
const uint BLOCK_WIDTH = 8;      // px; blocks are 4, 8 or 16 px high
const uint MAX_BINS = 7200;      // bins in a picture: their counts leave some of 32 KiB of workgroup memory
const uint PROJECT_CHUNK = 384;  // Gaussians that one workgroup of project takes
const uint BIN_CHUNKS = 264;     // parts of the splats, each listed by one workgroup of count and of fill
const uint BIN_RUN = 2048;       // entries that one workgroup of sort sorts
const uint BIN_PIECES = 16;      // sorted pieces of a list that are merged at once
const uint BIN_STRETCH = 1024;   // entries of a list whose masks lie together
// Entries from which on a list is long: it is merged more than once, and several subgroups blend each block of its bin.
const uint LONG_LIST = BIN_RUN * BIN_PIECES;

// What is listed in a bin: entries [first, first + count), in runs and stretches of its own.
struct Bin {
    uint first;
    uint count;
    uint first_run;
    uint first_stretch;
};

// Workgroup counts of the fast path's indirect dispatches.
struct FastDispatches {
    uvec3 over_runs;
    uvec3 over_stretches;
    uvec3 over_long_blocks;  // of the first bins of bin_order
};
