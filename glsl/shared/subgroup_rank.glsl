// Ranks among the lanes of a subgroup, whatever its size. Behind ballot.glsl and sort.glsl.

// Of the lanes in `same`: how many come before this one, and how many there are.
uvec2 rank_in(uvec4 same) {
    uvec2 rank = uvec2(0);
    for (uint w = 0; w < BALLOT_WORDS; w++) {
        rank += uvec2(bitCount(same[w] & gl_SubgroupLtMask[w]), bitCount(same[w]));
    }
    return rank;
}

// Lanes of the subgroup whose digit equals this lane's.
uvec4 same_digit(uint digit) {
    uvec4 same = subgroupBallot(true);
    for (uint bit = 0; bit < DIGIT_BITS; bit++) {
        bool mine = (digit >> bit & 1) != 0;
        uvec4 ballot = subgroupBallot(mine);
        for (uint w = 0; w < BALLOT_WORDS; w++) same[w] &= mine ? ballot[w] : ~ballot[w];
    }
    return same;
}
