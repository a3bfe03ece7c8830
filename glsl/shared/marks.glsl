// The marks of a Gaussian, which are bits of the last word of its bounds: it is left out of pictures, it is selected.
// The word has two bfloat16, the reach and the deviations (cull_test.glsl). Neither is negative where the Gaussian can
// be drawn, so their signs are the marks. A Gaussian whose alpha is below ALPHA_MIN everywhere has the reach -1, and
// its lowest bit is the first mark.

const uint SIGN = 0x80000000, SELECTED = 0x8000, FAINT = 0xbf800000;

// True if no picture shows the Gaussian.
bool is_never_drawn(uint word) {
    return (word & SIGN) != 0;
}

bool is_faint(uint word) {
    return (word & 0xffff7ffe) == FAINT;
}

bool is_left_out(uint word) {
    return is_faint(word) ? (word & 1) != 0 : is_never_drawn(word);
}

bool is_selected(uint word) {
    return (word & SELECTED) != 0;
}

uint with_marks(uint word, bool left_out, bool selected) {
    uint kept = is_faint(word) ? FAINT | uint(left_out) : word & ~(SIGN | SELECTED) | (left_out ? SIGN : 0);
    return kept | (selected ? SELECTED : 0);
}

// The reach and the deviations of a Gaussian that can be drawn.
vec2 reach_and_deviations(uint word) {
    return vec2(uintBitsToFloat(word & 0xffff0000), uintBitsToFloat((word & 0x7fff) << 16));
}

const vec3 TINT = vec3(1.0, 0.72, 0.1);  // of selected Gaussians
const float TINT_WEIGHT = 0.7;

// `colour`, or a mixture with TINT if the Gaussian is selected.
vec3 marked_colour(uint word, vec3 colour) {
    return is_selected(word) ? mix(colour, TINT, TINT_WEIGHT) : colour;
}
