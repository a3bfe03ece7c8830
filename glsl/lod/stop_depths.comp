#version 460
#define WORKGROUP_SIZE 32
#include "shared/workgroup.glsl"
#include "fast/frame.glsl"
// One workgroup per bin: the stop depths of its blocks and of the bin.
// Before: stop_keys from the blend of a picture. After: stop_depths has the largest depth with the key of each block,
// then the largest of each bin; infinity where a pixel has not stopped. Blocks outside the picture do not count.

layout(binding = 0, scalar) readonly buffer StopKeys { uint stop_keys[]; };                 // [bins * BLOCKS]
layout(binding = 1, scalar) writeonly buffer StopDepths { float stop_depths[]; };           // [bins * (BLOCKS + 1)]
layout(push_constant, scalar) uniform Push {
    uvec2 size_px;
    uvec2 bins;
    uint block_height;  // px
    uint depth_shift;   // of depth keys
    float near;
} push;

const uint INFINITY = 2139095040;  // the bits of an infinite float
shared uint farthest;  // bits of a float: positive floats order like their bits

void main() {
    uint bins = push.bins.x * push.bins.y, bin = workgroup(), block = lane();
    if (bin >= bins) return;
    if (block == 0) farthest = 0;
    barrier();
    uint key = stop_keys[bin * BLOCKS + block];
    uint depth = floatBitsToUint(push.near) + (key + 1 << push.depth_shift) - 1;
    depth = key == NOT_STOPPED ? INFINITY : min(depth, INFINITY);
    stop_depths[bin * BLOCKS + block] = uintBitsToFloat(depth);
    uvec2 place = uvec2(BIN_COLUMNS, BIN_ROWS) * uvec2(bin % push.bins.x, bin / push.bins.x)
        + uvec2(block % BIN_COLUMNS, block / BIN_COLUMNS);
    bool is_inside = all(lessThan(place * uvec2(BLOCK_WIDTH, push.block_height), push.size_px));
    if (is_inside) atomicMax(farthest, depth);  // a maximum: order does not matter
    barrier();
    if (block == 0) stop_depths[bins * BLOCKS + bin] = uintBitsToFloat(farthest);
}
