// Levels of detail: which nodes of a page are drawn, and their opacities.
// src/levels/mod.rs explains the words; src/storage/pages/level.rs has the same words of levels.
// Requires: page.glsl, error_code.glsl, levels[], page
#include "shared/alpha_max.glsl"

layout(constant_id = 7) const bool HAS_LEVELS = false;

layout(constant_id = 8) const uint FADE = 0;  // codes above a limit over which a node fades in its children's place
// Of a splat whose alpha is ALPHA_MAX. The host rounds both, so that pictures do not depend on the compiler.
layout(constant_id = 13) const float TRANSMITTANCE_AT_ALPHA_MAX = 0.01;
layout(constant_id = 14) const float INVERSE_ALPHA_MAX = 1.010101;
const uint NO_LIMIT = 65535;                  // the code of an error that is within no limit

// The part of a node's children that it replaces: 1 if its error is within the limit.
float closed(uint error, uint limit) {
    if (FADE == 0 || error == NO_LIMIT) return float(error <= limit);
    return clamp((float(limit) + float(FADE) - float(error)) / float(FADE), 0.0, 1.0);
}

// The part of a node that is drawn: what it replaces, less what its parent replaces. Errors do not fall towards the
// root, so it is not negative, and the parts on the way from any Gaussian to the root sum to 1.
float drawn_part(uint gaussian) {
    if (!HAS_LEVELS) return 1.0;
    uint errors = levels[2 * gaussian];
    return closed(errors & 0xffff, page.limits & 0xffff) - closed(errors >> 16, page.limits >> 16);
}

bool is_in_cut(uint gaussian) {
    return drawn_part(gaussian) > 0.0;
}

// The opacity of a partly faded node. Its transmittance is that of the whole node, raised to the drawn fraction;
// opacities above ALPHA_MAX are scaled as ALPHA_MAX is.
float faded(uint gaussian, float opacity) {
    if (FADE == 0) return opacity;
    float part = drawn_part(gaussian);
    if (part == 1.0) return opacity;
    if (opacity < ALPHA_MAX) return 1.0 - pow(1.0 - opacity, part);
    return opacity * (1.0 - pow(TRANSMITTANCE_AT_ALPHA_MAX, part)) * INVERSE_ALPHA_MAX;
}

// The opacity of a node where it is large in the picture, and where it is smaller than a pixel; negative for a Gaussian
// of the scene.
vec2 opacities_of_node(uint gaussian) {
    if (!HAS_LEVELS) return vec2(-1.0);
    uint word = levels[2 * gaussian + 1];
    return word == 0 ? vec2(-1.0) : vec2(value_of_code(word & 0xffff), value_of_code(word >> 16));
}
