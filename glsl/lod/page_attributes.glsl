// What a cut notes of a page that it lists, for the looks that show it.
// Requires: page.glsl

const uint LEVEL_BITS = 5, LAG_BITS = 5, ENERGY_BITS = 10;
const float LAG_STEPS = 2.0;     // of a power of two of errors
const float ENERGY_STEPS = 8.0;  // of a power of two of squared errors
const float ENERGY_LOWEST = -64.0;  // the power of two of the first step

// `level`: 0 for Gaussians of the scene. `lag`: by how many powers of two its limit is above the one that is asked for,
// because finer pages are missing. `energy`: of a node, its squared error in the picture; 0 for none.
uint notes_of(uint level, float lag, float energy) {
    uint lag_step = uint(clamp(lag * LAG_STEPS, 0.0, float((1 << LAG_BITS) - 1)));
    float energy_step = clamp((log2(energy) - ENERGY_LOWEST) * ENERGY_STEPS, 1.0, float((1 << ENERGY_BITS) - 1));
    uint energies = energy > 0.0 ? uint(energy_step) : 0;
    return min(level, (1 << LEVEL_BITS) - 1) | lag_step << LEVEL_BITS | energies << LEVEL_BITS + LAG_BITS;
}

uint level_of(ListedPage page) {
    return bitfieldExtract(page.notes, 0, int(LEVEL_BITS));
}

float lag_of(ListedPage page) {
    return float(bitfieldExtract(page.notes, int(LEVEL_BITS), int(LAG_BITS))) / LAG_STEPS;
}

float energy_of(ListedPage page) {
    uint step = bitfieldExtract(page.notes, int(LEVEL_BITS + LAG_BITS), int(ENERGY_BITS));
    return step == 0 ? 0.0 : exp2(float(step) / ENERGY_STEPS + ENERGY_LOWEST);
}
