// Nodes of the levels of detail: the drawn fraction of a node, and its opacity.
// src/lod/mod.rs explains the words; src/pagefile/nodes.rs has the same layout of `levels`.
// Requires: page.glsl, error_code.glsl, levels[], page
#include "shared/alpha_max.glsl"

layout(constant_id = 7) const bool HAS_LEVELS = false;

layout(constant_id = 8) const uint FADE = 0;  // codes above a limit over which a node cross-fades with its children
// Of a splat whose alpha is ALPHA_MAX. The host rounds both, so that pictures do not depend on the compiler.
layout(constant_id = 13) const float TRANSMITTANCE_AT_ALPHA_MAX = 0.01;
layout(constant_id = 14) const float INVERSE_ALPHA_MAX = 1.010101;
const uint NO_LIMIT = 65535;                  // the code of an error above every limit

// The fraction of a node's children that it replaces: 1 if its error is within the limit.
float replaced_fraction(uint error, uint limit) {
    if (FADE == 0 || error == NO_LIMIT) return float(error <= limit);
    return clamp((float(limit) + float(FADE) - float(error)) / float(FADE), 0.0, 1.0);
}

// The drawn fraction of a node: the fraction that it replaces minus the fraction that its parent replaces. Errors do
// not decrease towards the root, so it is not negative, and the fractions from a Gaussian to the root sum to 1.
float drawn_fraction(uint gaussian) {
    if (!HAS_LEVELS) return 1.0;
    uint errors = levels[2 * gaussian];
    return replaced_fraction(errors & 0xffff, page.error_limits & 0xffff)
        - replaced_fraction(errors >> 16, page.error_limits >> 16);
}

bool is_in_cut(uint gaussian) {
    return drawn_fraction(gaussian) > 0.0;
}

// The opacity of a partly faded node. Its transmittance is that of the whole node, raised to the drawn fraction;
// opacities above ALPHA_MAX are scaled as ALPHA_MAX is.
float faded_opacity(uint gaussian, float opacity) {
    if (FADE == 0) return opacity;
    float fraction = drawn_fraction(gaussian);
    if (fraction == 1.0) return opacity;
    if (opacity < ALPHA_MAX) return 1.0 - pow(1.0 - opacity, fraction);
    return opacity * (1.0 - pow(TRANSMITTANCE_AT_ALPHA_MAX, fraction)) * INVERSE_ALPHA_MAX;
}

// The opacities of a node: large in the image, and smaller than a pixel. Negative for Gaussians of the scene.
vec2 opacities_of_node(uint gaussian) {
    if (!HAS_LEVELS) return vec2(-1.0);
    uint word = levels[2 * gaussian + 1];
    return word == 0 ? vec2(-1.0) : vec2(value_of_code(word & 0xffff), value_of_code(word >> 16));
}
