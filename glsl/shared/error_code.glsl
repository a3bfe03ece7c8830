// Codes of errors and opacities: binary logarithms in 16 bits. src/lod/error_code.rs is the twin, and
// src/render/constants.rs asserts that the numbers are equal.

const uint CODES_PER_OCTAVE = 512;          // steps of a power of two
const float CODE_LOWEST_EXPONENT = -64.0;   // the power of two of code 0, which itself stands for 0

// The value of a code over 0.
float value_of_code(uint code) {
    return exp2(float(code) / float(CODES_PER_OCTAVE) + CODE_LOWEST_EXPONENT);
}
