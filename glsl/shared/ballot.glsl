// Ballots of a subgroup of any size, at the price of as many words as this device's have.

layout(constant_id = 31) const uint BALLOT_WORDS = 4;  // 1 for subgroups of up to 32, which is what makes walks cheap

bool any_in(uvec4 ballot) {
    uint all_words = 0;
    for (uint w = 0; w < BALLOT_WORDS; w++) all_words |= ballot[w];
    return all_words != 0;
}
