// Marks the blocks that the entries of a segment reach.
// Requires: the bindings of fast/masks.comp, and mask_of(splat, bin), the blocks of a bin that a splat reaches, a bit
// each

shared uint reached[BIN_SEGMENT];                   // the blocks that each entry reaches, a bit each
shared uint rows[BLOCKS * (BIN_SEGMENT / 32 + 1)];  // the words of each block, padded against bank conflicts

// Turns 32 words with a bit per block, one per lane, into 32 words with a bit per lane: a 32x32 bit transpose.
uint transposed(uint word) {
    [[unroll]] for (uint step = 16; step > 0; step /= 2) {
        uint low = 0xffffffff / ((1u << step) + 1);  // 0x0000ffff, 0x00ff00ff, ..., 0x55555555
        uint other = subgroupShuffleXor(word, step);
        word = (gl_SubgroupInvocationID & step) == 0 ? word & low | (other & low) << step
                                                     : word & ~low | (other & ~low) >> step;
    }
    return word;
}

void main() {
    uint segment = workgroup();
    if (IS_SURPLUS(dispatches.segments)) return;
    uint number = segment_bins[segment];
    Bin bin = bins[number];
    uint begin = (segment - bin.first_segment) * BIN_SEGMENT;
    for (uint i = lane(); i < BIN_SEGMENT; i += WORKGROUP) {
        uint mask = 0;
        if (begin + i < bin.count) {
            mask = mask_of(splat_ids[bin.first + begin + i], number);
        }
        if (SUBGROUP == 32) {
            rows[gl_SubgroupInvocationID * 33 + i / 32] = transposed(mask);
        } else {
            reached[i] = mask;
        }
    }
    barrier();
    uint block = lane() / 32, word = lane() % 32;
    for (; block < BLOCKS; block += WORKGROUP / 32) {
        uint bits = 0;
        if (SUBGROUP == 32) {
            bits = rows[block * 33 + word];
        } else {
            for (uint i = 0; i < 32; i++) bits |= (reached[32 * word + i] >> block & 1) << i;
        }
        masks[(segment * BLOCKS + block) * 32 + word] = bits;
    }
}
