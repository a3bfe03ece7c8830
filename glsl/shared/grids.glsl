// The grids of numbers that are stored in 8 bits, as (offset, step), and the base of scales that are stored in 16 bits.
struct Grids {
    vec2 sh[25];  // one per coefficient
    vec2 log2_scale;
    float scale_base;  // a whole number
};
