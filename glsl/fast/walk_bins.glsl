// Visits the bins of a chunk of splats: calls visit(bin, splat, writes) once for every bin that a splat touches.
// Requires: counters, span_ranges[], spans[], push.bins_x, push.visible_capacity, visit(bin, splat, writes)
// Splats touch one bin or thousands. A lane visits the few bins of a small splat alone; a subgroup shares first the
// rows of its larger splats, then the bins of these rows.

#include "fast/subgroup_owner.glsl"
const uint ROWS_ALONE = 2, BINS_ALONE = 4;  // most rows and bins of a small splat

// The `row`-th span of a splat. A splat with one row has its span in the range itself.
uint span_of(uvec2 range, uint row) {
    return range.y >> 16 == 1 ? range.x : spans[range.x + row];
}

uint width_of(uint span) {
    return (span >> 16) - (span & 0xffff);
}

// Visits the bins of a splat if it is small. Returns true if it is.
bool visit_alone(uvec2 range, uint splat, bool writes) {
    uint rows = range.y >> 16;
    if (rows > ROWS_ALONE) return false;
    uvec2 row_spans = uvec2(rows > 0 ? span_of(range, 0) : 0, rows > 1 ? span_of(range, 1) : 0);
    if (width_of(row_spans.x) + width_of(row_spans.y) > BINS_ALONE) return false;
    uint bins = (range.y & 0xffff) * push.bins_x;
    for (uint x = row_spans.x & 0xffff; x < row_spans.x >> 16; x++) visit(bins + x, splat, writes);
    bins += push.bins_x;
    for (uint x = row_spans.y & 0xffff; x < row_spans.y >> 16; x++) visit(bins + x, splat, writes);
    return true;
}

// Visits the bins of the spans of all lanes. `row`: the row of bins of this lane's span.
void visit_spans(uint row, uint span, uint splat, bool writes) {
    uint width = width_of(span), bin = row * push.bins_x + (span & 0xffff);
    uint before = subgroupExclusiveAdd(width), all = subgroupAdd(width);
    for (uint done = 0; done < all; done += SUBGROUP) {
        uint i = done + gl_SubgroupInvocationID, owner = owner_of(before, i);
        uint column = i - subgroupShuffle(before, owner);
        uint their_bin = subgroupShuffle(bin, owner), their_splat = subgroupShuffle(splat, owner);
        if (i < all) visit(their_bin + column, their_splat, writes);
    }
}

// Visits the bins of the larger splats of all lanes. `rows`: rows of bins of this lane's splat, 0 if it is small.
void visit_together(uvec2 range, uint rows, uint splat, bool writes) {
    uint before = subgroupExclusiveAdd(rows), all = subgroupAdd(rows);
    for (uint done = 0; done < all; done += SUBGROUP) {
        uint i = done + gl_SubgroupInvocationID, owner = owner_of(before, i);
        uint row = i - subgroupShuffle(before, owner), their_splat = subgroupShuffle(splat, owner);
        uvec2 theirs = subgroupShuffle(range, owner);
        visit_spans((theirs.y & 0xffff) + row, i < all ? span_of(theirs, row) : 0, their_splat, writes);
    }
}

// Visits the bins of the splats of a chunk.
void visit_splats(uint begin, uint end, bool writes) {
    // Lanes of a subgroup take splats far from one another: neighbours are often in one bin, where their atomics would
    // wait for each other.
    uint part = div_up(end - begin, SUBGROUP);
    uint own_begin = begin + gl_SubgroupInvocationID * part, own_end = min(own_begin + part, end);
    for (uint first = 0; first < part; first += gl_NumSubgroups) {
        uint splat = own_begin + first + gl_SubgroupID;
        uvec2 range = splat < own_end ? span_ranges[splat] : uvec2(0);
        uint rows = visit_alone(range, splat, writes) ? 0 : range.y >> 16;
        if (subgroupAny(rows > 0)) visit_together(range, rows, splat, writes);
    }
}
