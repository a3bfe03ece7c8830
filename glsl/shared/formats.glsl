// The number formats of a scene on the GPU, and the words of spherical harmonics that they take.
layout(constant_id = 0) const uint SH_DEGREE = 3;
layout(constant_id = 1) const uint SH_STORAGE = 0;
layout(constant_id = 2) const uint SHAPE_STORAGE = 0;

const uint STORED_F32 = 0;
const uint STORED_F16 = 1;
const uint STORED_U8 = 2;

const uint SH_FLOATS = 3 * (SH_DEGREE + 1) * (SH_DEGREE + 1);
const uint SH_PER_WORD = SH_STORAGE == STORED_F32 ? 1 : SH_STORAGE == STORED_F16 ? 2 : 4;
const uint SH_WORDS = (SH_FLOATS + SH_PER_WORD - 1) / SH_PER_WORD;
const uint SH_STORED_VECTORS = (SH_WORDS + 3) / 4;
// Gaussians that share an element of the last plane.
const uint SH_SHARE = SH_WORDS % 4 == 1 ? 4 : SH_WORDS % 4 == 2 ? 2 : 1;
