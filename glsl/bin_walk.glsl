// Goes through the bins of a chunk of splats. Behind the declarations of `totals`, `span_ranges`, `spans` and `push`, and of
// visit(bin, splat), which is called once for each.

const uint ROWS_ALONE = 8;  // a splat with more rows of bins is shared by its subgroup

void visit_row(uvec2 range, uint row, uint splat, uint from, uint step) {
    uint span = range.y >> 16 == 1 ? range.x : spans[range.x + row];  // the only one is in place
    uint bins = ((range.y & 0xffff) + row) * push.bins_x;
    for (uint x = (span & 0xffff) + from; x < span >> 16; x += step) visit(bins + x, splat);
}

void visit_chunk(uint chunk) {
    uint visible = min(totals.visible, push.visible_capacity);
    uint each = div_up(visible, BIN_CHUNKS);
    uint begin = min(visible, chunk * each), end = min(visible, begin + each);
    // Lanes of a subgroup take splats far from one another: those nearby are often in one bin, where they would wait for
    // each other.
    uint part = div_up(end - begin, gl_SubgroupSize);
    uint own_begin = begin + gl_SubgroupInvocationID * part, own_end = min(own_begin + part, end);
    for (uint first = 0; first < part; first += gl_NumSubgroups) {
        uint splat = own_begin + first + gl_SubgroupID;
        uvec2 range = first + gl_SubgroupID < part && splat < own_end ? span_ranges[splat] : uvec2(0);
        uint rows = range.y >> 16;
        bool shared_work = rows > ROWS_ALONE;
        if (!shared_work) {
            for (uint row = 0; row < rows; row++) visit_row(range, row, splat, 0, 1);
        }
        uvec4 waiting = subgroupBallot(shared_work);
        for (uint w = 0; w < BALLOT_WORDS; w++) {
            for (uint word = waiting[w]; word != 0; word &= word - 1) {
                uint owner = 32 * w + findLSB(word);
                uvec2 theirs = subgroupBroadcast(range, owner);
                uint their_splat = subgroupBroadcast(splat, owner);
                for (uint row = 0; row < theirs.y >> 16; row++) {
                    visit_row(theirs, row, their_splat, gl_SubgroupInvocationID, gl_SubgroupSize);
                }
            }
        }
    }
}
