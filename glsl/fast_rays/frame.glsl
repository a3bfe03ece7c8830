// Types that the stages of the fast path along rays share.
#include "fast/frame.glsl"
#include "rays/splat.glsl"

// `lens_table` has what the stages need of the rays of a picture, in elements of four words: the head, then the rays of
// bins.
//
// The head has two elements. All rays end within a spread of a middle: (middle, spread); and (the sine of half the
// angle of the last row of footprints, the root of the sum of the variances of the widest footprint, 1 if the lens is
// parallel, 0).
const uint HEAD = 2;

// The rays of a bin are (middle, spread), (along_x, off), (along_y, 0). The ray of the pixel at (x, y) px from the
// middle of the bin, scaled by a positive number, ends within `spread` of `middle`, and at
// middle + (x + dx) along_x + (y + dy) along_y, where dx and dy are at most `off`. Where that is not so, `off` is
// infinite. A bin without a ray has a negative spread.
const uint BIN_RAYS = 3;

// `cells` has where a lens sees directions, for all pictures. Directions lie in cells on the faces of a cube around the
// camera. A cell has two elements: the place of its middle in plane coordinates, in units of the focal lengths from the
// principal point, and the derivatives of the place by the two coordinates of the face; then the bends of directions
// that are near and far. Within an angle of NEAR_REACH or FAR_REACH, a place differs from the linear one by at most
// bend * (angle + CELL)^2; where the lens has no such bound, the bend is infinite, and where all of these directions
// are outside the lens, it is negative. A parallel lens has no cells.
const uint CELL_ELEMENTS = 2;
const uint CELLS = 256;       // along an edge of the cube
const float CELL = 0.0056;    // the largest angle between the middle of a cell and a direction in it
const float NEAR_REACH = 0.1, FAR_REACH = 0.3;  // rad
