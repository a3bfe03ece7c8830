// The walk of a subgroup through the entries that reach a block, in the order of the list.
// Requires: fast/frame.glsl, fast/subgroup_owner.glsl; masks

// A walk through a block's mask, one word per lane at a time. Only `word`, `ahead` and `before` differ between lanes.
// Entries are counted from the begin of the walk.
struct Walk {
    uint next;    // first word of the mask that is loaded next
    uint end;     // one past the last word
    uint begin;   // index in the list of the first bit of the current words
    uint word;    // current word of this lane
    uint ahead;   // next word of this lane
    uint before;  // entries before those of `word`
    uint ready;   // entries of the current words and before
    uint taken;   // entries that were taken
};

// A lane's word of a block's mask. A segment has 32 words for each block.
uint mask_word(Bin bin, uint block, uint word, uint end) {
    return word < end ? masks[((bin.first_segment + word / 32) * BLOCKS + block) * 32 + word % 32] : 0;
}

Walk begin_walk(Bin bin, uint block) {
    uint end = (bin.count + 31) / 32;
    return Walk(SUBGROUP, end, 0, 0, mask_word(bin, block, gl_SubgroupInvocationID, end), 0, 0, 0);
}

// Moves on to the next words.
void advance(inout Walk walk, Bin bin, uint block) {
    walk.word = walk.ahead;
    walk.begin = 32 * (walk.next - SUBGROUP);
    walk.ahead = mask_word(bin, block, walk.next + gl_SubgroupInvocationID, walk.end);
    walk.next += SUBGROUP;
    uint bits = bitCount(walk.word);
    walk.before = walk.ready + subgroupExclusiveAdd(bits);
    walk.ready += subgroupAdd(bits);
}

// Index of the n-th set bit of `word`, counted from 0. `word` has more than n.
uint nth_bit(uint word, uint n) {
    uint place = 0;
    for (uint width = 16; width > 0; width /= 2) {
        uint below = bitCount(bitfieldExtract(word, int(place), int(width)));
        if (n >= below) {
            n -= below;
            place += width;
        }
    }
    return place;
}

// Takes the next entries of the walk, at most one per lane. Returns how many; `entry` is this lane's.
uint take(inout Walk walk, Bin bin, uint block, out uint entry) {
    while (walk.taken == walk.ready && walk.next < walk.end + SUBGROUP) advance(walk, bin, block);
    uint count = min(walk.ready - walk.taken, SUBGROUP), index = walk.taken + gl_SubgroupInvocationID;
    walk.taken += count;
    uint owner = owner_of(walk.before, index);
    uint place = nth_bit(subgroupShuffle(walk.word, owner), index - subgroupShuffle(walk.before, owner));
    entry = walk.begin + 32 * owner + place;
    return count;
}
