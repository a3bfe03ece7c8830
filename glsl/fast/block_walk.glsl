// The walk of a subgroup through the entries that reach a block, in the order of the list.
// Requires: fast/frame.glsl, fast/subgroup_owner.glsl; WORKGROUP, HAS_RING; masks

// With a ring, lanes turn bits of the mask into entries in workgroup memory, many at a time: the time of a small
// picture depends on how long one subgroup takes for a splat. That of other pictures depends on the instructions of all
// subgroups: without a ring, each lane finds its entry in the mask.
const uint RING_PER_LANE = 8;
const uint RING = RING_PER_LANE * SUBGROUP;  // entries
const uint FIRST_BITS = 16;                  // of each lane, as long as the block's density is unknown
shared uint ring[HAS_RING ? RING_PER_LANE * WORKGROUP : 1];

// A walk through a block's mask, one word per lane at a time. Only `word`, `ahead` and `before` differ between lanes.
// Entries are counted from the begin of the walk.
struct Walk {
    uint next;    // first word of the mask that is loaded next
    uint end;     // one past the last word
    uint begin;   // index in the list of the first bit of the current words; with a ring, of the first bit not in it
    uint word;    // current word of this lane
    uint ahead;   // next word of this lane
    uint bits;    // with a ring: bits of each lane that go into it at once
    uint before;  // without a ring: entries before those of `word`
    uint ready;   // entries of the ring or of the current words, and before
    uint taken;   // entries that were taken
};

// A lane's word of a block's mask. A segment has 32 words for each block.
uint mask_word(Bin bin, uint block, uint word, uint end) {
    return word < end ? masks[((bin.first_segment + word / 32) * BLOCKS + block) * 32 + word % 32] : 0;
}

Walk begin_walk(Bin bin, uint block) {
    uint end = (bin.count + 31) / 32;
    uint ahead = mask_word(bin, block, gl_SubgroupInvocationID, end);
    return Walk(SUBGROUP, end, 0, 0, ahead, FIRST_BITS, 0, 0, 0);
}

// Moves on to the next words.
void advance(inout Walk walk, Bin bin, uint block) {
    walk.word = walk.ahead;
    walk.begin = 32 * (walk.next - SUBGROUP);
    walk.ahead = mask_word(bin, block, walk.next + gl_SubgroupInvocationID, walk.end);
    walk.next += SUBGROUP;
}

// Fills the ring until it has an entry for each lane, or the walk ends. All lanes take equally many bits, so that none
// waits for one with a full word: fewer where the entries would not fit, more where they leave half of the ring free.
void fill_ring(inout Walk walk, Bin bin, uint block) {
    subgroupBarrier();
    while (walk.ready < walk.taken + SUBGROUP && walk.begin < 32 * walk.end) {
        if (walk.begin == 32 * (walk.next - SUBGROUP)) advance(walk, bin, block);
        uint first = walk.begin + walk.bits * gl_SubgroupInvocationID;
        uint word = subgroupShuffle(walk.word, first / 32 % SUBGROUP);
        word = bitfieldExtract(word, int(first % 32), int(walk.bits));
        uint count = bitCount(word), place = walk.ready + subgroupExclusiveAdd(count), all = subgroupAdd(count);
        uint room = walk.taken + RING - walk.ready;
        if (all > room) {
            walk.bits /= 2;  // RING_PER_LANE / 2 bits always fit
            continue;
        }
        while (word != 0) {
            ring[gl_SubgroupID * RING + place % RING] = first + findLSB(word);
            word &= word - 1;
            place++;
        }
        walk.ready += all;
        walk.begin += walk.bits * SUBGROUP;
        bool can_double = walk.bits < 32 && walk.begin % (2 * walk.bits * SUBGROUP) == 0;
        if (can_double && 2 * all <= room) walk.bits *= 2;
    }
    subgroupBarrier();
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
    uint index = walk.taken + gl_SubgroupInvocationID;
    if (HAS_RING) {
        if (walk.ready < walk.taken + SUBGROUP) fill_ring(walk, bin, block);
        entry = ring[gl_SubgroupID * RING + index % RING];
    } else {
        while (walk.ready == walk.taken && walk.next < walk.end + SUBGROUP) {
            advance(walk, bin, block);
            uint bits = bitCount(walk.word);
            walk.before = walk.ready + subgroupExclusiveAdd(bits);
            walk.ready += subgroupAdd(bits);
        }
        uint owner = owner_of(walk.before, index);
        uint place = nth_bit(subgroupShuffle(walk.word, owner), index - subgroupShuffle(walk.before, owner));
        entry = walk.begin + 32 * owner + place;
    }
    uint count = min(walk.ready - walk.taken, SUBGROUP);
    walk.taken += count;
    return count;
}
