// The rules of the picture that several stages follow: src/rules.rs has their meaning and sources.

layout(constant_id = 16) const float ALPHA_MIN = 1.0 / 255.0;  // contributions below this are skipped
layout(constant_id = 17) const uint EXTENT = 0;                // how far a splat is drawn, one of:

const uint EXTENT_EXACT = 0;                // until alpha is ALPHA_MIN
const uint EXTENT_THREE_SIGMA = 1;          // the same, but not beyond three standard deviations
const uint EXTENT_THREE_SIGMA_SQUARES = 2;  // in the tiles of a square of three standard deviations of the longest axis

// exp(-q / 2) = exp2(-(log2(e) / 2) q), q a squared Mahalanobis distance.
const float LOG2_E = 1.4426950408889634;
