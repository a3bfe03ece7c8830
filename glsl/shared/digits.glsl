// Digits of the keys of a radix sort.
// Requires: DIGIT_BITS
// A pass sorts 32-bit keys with 32-bit values, stably, by one digit of DIGIT_BITS bits, in three stages: histogram,
// offsets, scatter (reduce-then-scan). No workgroup waits for another: no forward progress between them is assumed.

const uint DIGITS = 1u << DIGIT_BITS;

// The `bits` bits of the key from bit `shift` on; `bits` is at most DIGIT_BITS.
uint digit_of(uint key, uint shift, uint bits) {
    return bitfieldExtract(key, int(shift), int(bits));
}
