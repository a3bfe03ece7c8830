// Ranks among the lanes of a subgroup of any size.
// Requires: ballot.glsl, digits.glsl

// (number of the lanes of `same` before this one, number of all lanes of `same`).
uvec2 rank_in(uvec4 same) {
    uvec2 rank = uvec2(0);
    for (uint w = 0; w < BALLOT_WORDS; w++) {
        rank += uvec2(bitCount(same[w] & gl_SubgroupLtMask[w]), bitCount(same[w]));
    }
    return rank;
}

// The lanes of the subgroup whose digit equals this lane's.
uvec4 same_digit(uint digit) {
    uvec4 same = subgroupBallot(true);
    for (uint bit = 0; bit < DIGIT_BITS; bit++) {
        bool mine = (digit >> bit & 1) != 0;
        uvec4 ballot = subgroupBallot(mine);
        for (uint w = 0; w < BALLOT_WORDS; w++) same[w] &= mine ? ballot[w] : ~ballot[w];
    }
    return same;
}
