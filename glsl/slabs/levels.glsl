// Levels of detail: which nodes of a page are drawn, and their opacities.
// src/levels/mod.rs explains the words; src/storage/pages/level.rs has the same words of levels.
// Requires: slab.glsl, levels[], page

layout(constant_id = 7) const bool HAS_LEVELS = false;

layout(constant_id = 8) const uint FADE = 0;  // codes above a limit over which a node fades in its children's place
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

// The opacity of a part of a node: what lies behind is dimmed by that power of what the whole node dims it by. Of
// alphas above the largest that is drawn, the part is that of this.
float faded(uint gaussian, float opacity) {
    if (FADE == 0) return opacity;
    float part = drawn_part(gaussian);
    if (part == 1.0) return opacity;
    const float MOST = 0.99;
    return opacity < MOST ? 1.0 - pow(1.0 - opacity, part) : opacity * (1.0 - pow(1.0 - MOST, part)) / MOST;
}

// The number over 0 that a code stands for.
float decoded(uint code) {
    return exp2(float(code) / 512.0 - 64.0);
}

// The opacity of a node where it is large in the picture, and where it is smaller than a pixel; negative for a Gaussian
// of the scene.
vec2 opacities_of_node(uint gaussian) {
    if (!HAS_LEVELS) return vec2(-1.0);
    uint word = levels[2 * gaussian + 1];
    return word == 0 ? vec2(-1.0) : vec2(decoded(word & 0xffff), decoded(word >> 16));
}
