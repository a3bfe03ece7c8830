// Gaussians as another program wrote them, in arrays of 32-bit floats that follow each other: means (3 each),
// quaternions (4), scales (3), opacities (1), spherical harmonics (3 for each of COEFFICIENTS). Their canonical values
// are those of src/scene/canonical.rs, in 64-bit floats as there.
// Requires: words[], push.gaussians, COEFFICIENTS

// Limits of values that are packed without the host. Those of src/scene/canonical.rs and of the Python package are not
// lower.
const float ARRAYS_MEAN = 1e34;
const float ARRAYS_SH = 1e36;
const float ARRAYS_OPACITY_EXCESS = 9e-6;

const uint SIGN = 0x80000000u;
const uint INFINITE = 0x7f800000u;  // the bits of infinity: those of larger magnitudes are NaN
const uint ONE = 0x3f800000u;       // the bits of 1.0

uint mean_word(uint gaussian, uint i) {
    return words[3 * gaussian + i];
}

uint quaternion_word(uint gaussian, uint i) {
    return words[3 * push.gaussians + 4 * gaussian + i];
}

uint scale_word(uint gaussian, uint i) {
    return words[7 * push.gaussians + 3 * gaussian + i];
}

uint given_opacity(uint gaussian) {
    return words[10 * push.gaussians + gaussian];
}

uint sh_word(uint gaussian, uint i) {
    return words[11 * push.gaussians + 3 * COEFFICIENTS * gaussian + i];
}

uint magnitude(uint bits) {
    return bits & ~SIGN;
}

// The 32-bit float as a 64-bit one. Devices may take small ones for 0 in conversions.
double wide(uint bits) {
    const double SMALLEST = 1.4012984643248170709e-45LF;
    bool is_normal = magnitude(bits) >= 0x00800000u;
    double small = double(magnitude(bits)) * SMALLEST;
    return is_normal ? double(uintBitsToFloat(bits)) : (bits & SIGN) == 0 ? small : -small;
}

// The bits of the opacity from 0 to 1.
uint opacity_bits(uint gaussian) {
    uint bits = given_opacity(gaussian);
    return (bits & SIGN) != 0 ? 0 : min(bits, ONE);
}
