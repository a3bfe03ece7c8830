// The steps of numbers that are kept in 8 bits, (offset, step) each, and the unit of scales in 16-bit floats.
struct Grids {
    vec2 sh[16];  // of each coefficient
    vec2 log2_scale;
    float scale_unit;
};
