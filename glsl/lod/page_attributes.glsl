// Attributes of a selected page that inspection shows: level, lag, predicted error. They are packed in PageDraw.
// Requires: page.glsl

const uint LEVEL_BITS = 5, LAG_BITS = 5, ERROR_BITS = 10;
const float LAG_STEPS = 2.0;     // per octave of errors
const float ERROR_STEPS = 8.0;  // per octave of squared errors
const float ERROR_LOWEST = -64.0;  // exponent of the first step

// `level`: 0 for Gaussians of the scene. `lag`: octaves of its error limit above the selected one, because finer pages
// are missing. `squared_error`: of a node in the image, or 0.
uint packed_attributes(uint level, float lag, float squared_error) {
    uint lag_step = uint(clamp(lag * LAG_STEPS, 0.0, float((1 << LAG_BITS) - 1)));
    float error_step = clamp((log2(squared_error) - ERROR_LOWEST) * ERROR_STEPS, 1.0, float((1 << ERROR_BITS) - 1));
    uint error = squared_error > 0.0 ? uint(error_step) : 0;
    return min(level, (1 << LEVEL_BITS) - 1) | lag_step << LEVEL_BITS | error << LEVEL_BITS + LAG_BITS;
}

uint level_of(PageDraw page) {
    return bitfieldExtract(page.attributes, 0, int(LEVEL_BITS));
}

float lag_of(PageDraw page) {
    return float(bitfieldExtract(page.attributes, int(LEVEL_BITS), int(LAG_BITS))) / LAG_STEPS;
}

float squared_error_of(PageDraw page) {
    uint step = bitfieldExtract(page.attributes, int(LEVEL_BITS + LAG_BITS), int(ERROR_BITS));
    return step == 0 ? 0.0 : exp2(float(step) / ERROR_STEPS + ERROR_LOWEST);
}
