// Keys of floats.

// A key in the order of the floats, from the bits of one.
uint ordered(uint bits) {
    return (bits & 0x80000000u) != 0 ? ~bits : bits | 0x80000000u;
}
