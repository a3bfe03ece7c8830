// The tiles of a splat, as one span per tile row.
// Requires: ballot.glsl, ellipse.glsl, VIEW, spans[]

const uint ROWS_ALONE = 4;  // a splat with more rows is shared by its subgroup

// Writes the spans of `rows` (first, count) from `offset` on, and returns how many tiles they have. All lanes of the
// subgroup must call it.
uint write_spans(Ellipse ellipse, uvec2 rows, uint offset) {
    uint tiles = 0;
    bool shared_work = rows.y > ROWS_ALONE;
    if (!shared_work) {
        for (uint row = 0; row < rows.y; row++) {
            uint span = tile_span(ellipse, rows.x + row, VIEW.size_px);
            spans[offset + row] = span;
            tiles += span_length(span);
        }
    }
    uvec4 waiting = subgroupBallot(shared_work);
    for (uint w = 0; w < BALLOT_WORDS; w++) {
        for (uint word = waiting[w]; word != 0; word &= word - 1) {
            uint owner = 32 * w + findLSB(word);
            Ellipse theirs = broadcast_ellipse(ellipse, owner);
            uvec2 their_rows = subgroupBroadcast(rows, owner);
            uint their_offset = subgroupBroadcast(offset, owner);
            uint sum = 0;
            for (uint row = gl_SubgroupInvocationID; row < their_rows.y; row += gl_SubgroupSize) {
                uint span = tile_span(theirs, their_rows.x + row, VIEW.size_px);
                spans[their_offset + row] = span;
                sum += span_length(span);
            }
            sum = subgroupAdd(sum);
            if (gl_SubgroupInvocationID == owner) tiles = sum;
        }
    }
    return tiles;
}
