// The pixels that nodes have in pictures.

const uint FIT_TILE = 16;  // width and height of the tiles that a workgroup blends, px
const uint FIT_LANES = 8;  // numbers that one instruction of the host works on, in sums over pixels
const uint FIT_RESIDUALS = 5;  // values of a pixel by which opacities and colours are fitted

// The pixels of a node in a picture.
struct FitSpan {
    uint first_row;
    uint end_row;
    uint first_column;
    uint end_column;
    uint first_record;  // the record of the first row
    uint first_weight;  // the place of its first pixel in the list of weights
};

// The pixels of a row: columns `columns & 0xffff` to `columns >> 16`, without the last, and the number in rows above.
struct FitRow {
    uint columns;
    uint pixels_above;
};

// What is used of the lists of rows and weights.
struct FitUse {
    uint records;
    uint weights;
    uint is_full;  // 1 if there was no room for some nodes
};
