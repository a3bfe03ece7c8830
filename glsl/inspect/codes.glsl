// Numbers shared by the host and the shaders of the inspector. build.rs makes Rust constants of them.

// The attribute that a splat shows instead of its colour.
const uint ATTRIBUTE_DEPTH = 0;
const uint ATTRIBUTE_NORMAL = 1;
const uint ATTRIBUTE_OPACITY = 2;
const uint ATTRIBUTE_SIZE = 3;
const uint ATTRIBUTE_ANISOTROPY = 4;
const uint ATTRIBUTE_BASE_COLOUR = 5;
const uint ATTRIBUTE_IDENTITY = 6;
const uint ATTRIBUTE_LEVEL = 7;
const uint ATTRIBUTE_PREDICTED_ERROR = 8;
const uint ATTRIBUTE_LAG = 9;
const uint NO_ATTRIBUTE = 10;

// The work that inspect counts or draws.
const uint WORK_TILE_LOAD = 0;
const uint WORK_EVALUATIONS = 1;
const uint WORK_CONTRIBUTIONS = 2;
const uint WORK_CENTRES = 3;
const uint WORK_OUTLINES = 4;
const uint WORK_DEPTHS = 5;

// The comparison of two images by show.comp.
const uint MODE_FIRST = 0;
const uint MODE_SECOND = 1;
const uint MODE_SPLIT = 2;
const uint MODE_DIFFERENCE = 3;

// The quantity of a pixel that show.comp displays.
const uint QUANTITY_COLOUR = 0;         // the unchanged image
const uint QUANTITY_NUMBER = 1;         // the number in all three channels
const uint QUANTITY_MEAN = 2;           // the number divided by the coverage
const uint QUANTITY_COVERAGE = 3;       // 1 - T
const uint QUANTITY_TRANSMITTANCE = 4;  // T

const uint COLOURS = 256;  // number of colours in the scale of false colours
