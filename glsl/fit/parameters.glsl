// The parameters of a node, and gradients by them, as `Parameters` in src/lod/gradient.rs.

const uint FIT_PARAMETERS = 13;  // mean, scales, turns, opacity, colour

struct FitGradient {
    float by[FIT_PARAMETERS];
};
