#version 460
#include "shared/workgroup.glsl"
// One invocation per element: looks it up in a table.
// Before: indices[0 .. length] are indices into `table`. After: gathered[i] = table[indices[i]].

layout(binding = 0, scalar) readonly buffer Lengths { uint lengths[]; };
layout(binding = 1, scalar) readonly buffer Indices { uint indices[]; };
layout(binding = 2, scalar) readonly buffer Table { uint table[]; };
layout(binding = 3, scalar) writeonly buffer Gathered { uint gathered[]; };
layout(push_constant, scalar) uniform Push {
    uint length_index;
} push;

void main() {
    uint i = workgroup() * WORKGROUP + lane();
    if (i < lengths[push.length_index]) gathered[i] = table[indices[i]];
}
