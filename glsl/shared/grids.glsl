// The grids of numbers that are stored in 8 bits, as (offset, step), and the unit of scales stored as 16-bit floats.
struct Grids {
    vec2 sh[16];  // one per coefficient
    vec2 log2_scale;
    float scale_unit;
};
