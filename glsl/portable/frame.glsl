// Constants and types that the stages of the portable path share: tiles, chunks, indirect dispatches.
#include "shared/frame.glsl"

const uint TILE = 16;  // px, width and height of a tile

// Elements that one workgroup of a stage handles.
const uint CULL_CHUNK = 1024;
const uint SCAN_CHUNK = 2048;
const uint SORT_CHUNK = 2048;
const uint DUPLICATE_CHUNK = 1024;

// Workgroup counts of the portable path's indirect dispatches.
struct PortableDispatches {
    uvec3 over_visible;
    uvec3 sort_visible;
    uvec3 scan_visible;
    uvec3 duplicate;
    uvec3 sort_instances;
    uvec3 over_instances;
};
