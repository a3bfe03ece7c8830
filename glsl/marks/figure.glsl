// A figure that selects Gaussians: in the picture, in the world, or of values. src/render/marks/figure.rs has its twin.

const uint FIGURE_RECTANGLE = 0, FIGURE_LASSO = 1, FIGURE_BRUSH = 2, FIGURE_BALL = 3, FIGURE_BOX = 4;
const uint FIGURE_VALUES = 5;
const uint MODE_REPLACE = 0, MODE_ADD = 1, MODE_SUBTRACT = 2;

struct Figure {
    // The corners of an outline's bounding rectangle or of a box, a ball's centre, the limits of values (x).
    vec3 low;
    vec3 high;
    float radius;   // of a brush, px, and of a ball
    float visible;  // the least contribution of a Gaussian that is selected; 0 for all
};
