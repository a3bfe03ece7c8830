// Constants and types that the stages of the fast path share: bins, blocks, runs, indirect dispatches.
// src/render/fast/mod.rs explains the words.
#include "shared/frame.glsl"

const uint BIN_COLUMNS = 8, BIN_ROWS = 4;  // blocks in a bin
const uint BLOCKS = 32;          // blocks in a bin, numbered row by row
const uint BLOCK_WIDTH = 8;      // px; blocks are 4, 8 or 16 px high
const uint NOT_STOPPED = 4294967295;  // in place of a depth key: a pixel of the block has not stopped
const uint MAX_BINS = 7200;      // bins in a picture at most: their counts fit into 32 KiB of workgroup memory
const uint PROJECT_CHUNK = 384;  // Gaussians that one workgroup of project takes
const uint BIN_CHUNK = 1024;     // most splats in a chunk while there are fewer than BIN_CHUNKS: one for a lane of list
const uint BIN_CHUNKS = 264;     // chunks of more splats, up to MANY_SPLATS; each is listed by one workgroup of list
const uint MAX_BIN_CHUNKS = 2048;  // four for each lane of sort
const uint MANY_SPLATS = 2500000;  // splats from which on there are more chunks than BIN_CHUNKS
const uint BIN_RUN = 2048;       // entries that one workgroup of sort sorts
const uint MERGE_RUNS = 64;      // most runs of a list that are merged at once
const uint BIN_SEGMENT = 1024;   // entries of a list whose masks lie together

// The list of a bin: entries [first, first + count). Its runs and segments are numbered from first_run and
// first_segment.
struct Bin {
    uint first;
    uint count;
    uint first_run;
    uint first_segment;
};

// The demands of a frame while project and list count them. They are 0 between frames: offsets moves them to the
// totals.
struct FastCounters {
    uint visible;
    uint spans;
    uint listed_low;
    uint listed_high;
};

// Workgroup counts of the fast path's indirect dispatches, and what they are made of: folded dispatches have more
// workgroups than there are runs or segments.
struct FastDispatches {
    uvec3 over_runs;
    uvec3 over_segments;
    uint runs;
    uint segments;
    uint chunks;
};

// The number of chunks of `splats`. All workgroups of list that run at the same time write all over their regions. If
// these do not fit into the cache of the GPU, parts of its lines go to memory one by one, so regions are smaller where
// there are many splats. As sort reads every chunk list by itself, there are at most as many lists as splats.
// Few splats have fewer chunks: a workgroup of list takes time without splats, too, and sort searches all chunk lists.
uint bin_chunks(uint splats, uint bins) {
    if (splats < MANY_SPLATS) return clamp((splats + BIN_CHUNK - 1) / BIN_CHUNK, 1, BIN_CHUNKS);
    return clamp(splats / bins, BIN_CHUNKS, MAX_BIN_CHUNKS);
}

// The place of a chunk list's begin in `list_starts`: chunk by chunk, as list writes them, or, if sort reads many for
// each bin, bin by bin.
uint start_place(uint chunk, uint chunks, uint bin, uint bins) {
    return chunks <= BIN_CHUNKS ? chunk * (bins + 1) + bin : bin * chunks + chunk;
}
