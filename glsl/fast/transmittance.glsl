// How blend applies the threshold of alphas, and stores transmittances.
// Requires: shared/rules.glsl
// Exponents are relative to log2(ALPHA_MIN), so that a splat is not drawn where its exponent is negative. With FLUSHES,
// exponents are lowered by 126 so that exp2 itself makes these 0, and transmittances are multiplied by 2^126. This
// rounds alphas by up to 3e-6 of their value: too much for splats that are not COMPACT.

layout(constant_id = 13) const bool FLUSHES = false;  // COMPACT, and exp2 returns 0 for arguments below -126

#define LOWERED (FLUSHES ? 126.0 : 0.0)
#define UNIT (FLUSHES ? 8.507059173023462e37 * ALPHA_MIN : ALPHA_MIN)  // what a transmittance of 1 is stored as

// The transmittance that is stored as `live`: 1 exactly where no splat was drawn.
float transmittance_of(float live) {
    return live == UNIT ? 1.0 : live / UNIT;
}
