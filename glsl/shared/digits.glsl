// Digits of the keys of a radix sort. Requires: DIGIT_BITS.
// A pass sorts 32-bit keys with 32-bit values, stably, by one digit of DIGIT_BITS bits: histogram, offsets, scatter
// (reduce-then-scan; no workgroup waits for another, so it needs no forward progress between them).

const uint DIGITS = 1u << DIGIT_BITS;

// The key's bits from `shift` on, `bits` of them, at most DIGIT_BITS.
uint digit_of(uint key, uint shift, uint bits) {
    return bitfieldExtract(key, int(shift), int(bits));
}
