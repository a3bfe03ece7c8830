// Types that the stages of the rays path share.
#include "portable/frame.glsl"
#include "rays/splat.glsl"

// The rays of a tile, or of several tiles: all end within a spread of a middle. Cones are a tree in depth-first order:
// the cones within a cone follow it, up to the cone `next`.
struct Cone {
    uvec4 sphere;  // middle and spread, the bits of floats
    uint next;
    uint tile;  // or NO_TILE
};

const uint NO_TILE = 4294967295;
