// Ballots of a subgroup of any size. Loops over a ballot take only the words that this device's subgroups need.

layout(constant_id = 31) const uint BALLOT_WORDS = 4;  // 1 for subgroups of up to 32 lanes: loops are then cheap

bool any_in(uvec4 ballot) {
    uint all_words = 0;
    for (uint w = 0; w < BALLOT_WORDS; w++) all_words |= ballot[w];
    return all_words != 0;
}
