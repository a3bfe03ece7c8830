// The bins of a ray splat, as one span per row of bins.
// Requires: ballot.glsl, spans.glsl, fast_rays/projection.glsl, LISTED, lens_table[]

// Writes the spans of `rows` (first, count) from `offset` on. For ALL_BINS, a subgroup looks for the first and the last
// bin of each row whose rays may meet the splat. All lanes of the subgroup must call it.
void write_ray_spans(RayRecord splat, Ellipse ellipse, uvec2 rows, uint offset) {
    bool is_bounded = ellipse.extent.x < ALL_BINS.extent.x;
    write_spans(ellipse, is_bounded ? rows : uvec2(0), offset);
    uint columns = div_up(VIEW.size_px.x, LISTED.x);
    uvec4 waiting = subgroupBallot(!is_bounded && rows.y > 0);
    for (uint w = 0; w < BALLOT_WORDS; w++) {
        for (uint word = waiting[w]; word != 0; word &= word - 1) {
            uint owner = 32 * w + findLSB(word);
            RayRecord theirs = splat;
            theirs.centre = subgroupBroadcast(splat.centre, owner);
            theirs.factor = subgroupBroadcast(splat.factor, owner);
            theirs.gamma = subgroupBroadcast(splat.gamma, owner);
            RayAxes axes = axes_of(theirs, IS_PARALLEL);
            RaySplat sought;
            sought.centre = theirs.centre;
            sought.u = axes.u;
            sought.v = axes.v;
            sought.q = axes.q;
            sought.kappa = subgroupBroadcast(splat.kappa, owner);
            sought.chord = subgroupBroadcast(splat.chord, owner);
            Reach reach = reach_of(sought, subgroupBroadcast(splat.limit, owner) + 2e-4);
            uint count = subgroupBroadcast(rows.y, owner), begin = subgroupBroadcast(offset, owner);
            for (uint row = 0; row < count; row++) {
                uint first = columns, end = 0;
                for (uint left = 0; left < columns; left += gl_SubgroupSize) {
                    uint column = left + gl_SubgroupInvocationID, bin = row * columns + min(column, columns - 1);
                    vec4 sphere = uintBitsToFloat(lens_table[HEAD + bin * BIN_RAYS]);
                    bool is_met = column < columns && meets(sought, reach, sphere.xyz, sphere.w);
                    uvec4 ballot = subgroupBallot(is_met);
                    if (ballot == uvec4(0)) continue;
                    if (first == columns) first = left + subgroupBallotFindLSB(ballot);
                    end = left + subgroupBallotFindMSB(ballot) + 1;
                }
                if (subgroupElect()) spans[begin + row] = first < end ? first | end << 16 : 0;
            }
        }
    }
}

#define WRITE_SPANS(splat, ellipse, rows, offset) write_ray_spans(splat, ellipse, rows, offset)
