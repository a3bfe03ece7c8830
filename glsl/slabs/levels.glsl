// Levels of detail: which nodes of a page are drawn, and their opacities.
// src/levels/mod.rs explains the words; src/storage/pages/level.rs has the same words of levels.
// Requires: slab.glsl, levels[], page

layout(constant_id = 7) const bool HAS_LEVELS = false;

// True if the node is drawn: its own error is within the limit of its page, its parent's is not within that of its own.
bool is_in_cut(uint gaussian) {
    if (!HAS_LEVELS) return true;
    uint errors = levels[2 * gaussian];
    return (errors & 0xffff) <= (page.limits & 0xffff) && (errors >> 16) > (page.limits >> 16);
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
