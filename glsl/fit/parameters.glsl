// The parameters of a node, and gradients by them, as `Parameters` in src/lod/gradient.rs.

const uint FIT_PARAMETERS = 13;  // mean, scales, turns, opacity, colour

struct FitGradient {
    float by[FIT_PARAMETERS];
};

// Means over the rounds, and limits.
struct FitState {
    float gradient[FIT_PARAMETERS];
    float square[FIT_PARAMETERS];
    float merged_scale[3];
    float merged_opacity;  // after the fit of opacities
    float is_fitted;  // 1 or 0
};
