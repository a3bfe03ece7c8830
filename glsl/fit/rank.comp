#version 460
#include "shared/workgroup.glsl"
// One invocation per view and node: its place from front to back, by counting the nodes in front of it.
// Before: `depths` holds keys. After: `order` holds the nodes of each view, front to back; those at one depth by index.

layout(binding = 0, scalar) readonly buffer Depths { uint depths[]; };    // [views nodes]
layout(binding = 1, scalar) writeonly buffer Order { uint order[]; };     // [views nodes]
layout(push_constant, scalar) uniform Push {
    uint nodes;
    uint views;
} push;

shared uint keys[WORKGROUP];

void main() {
    uint groups = div_up(push.nodes, WORKGROUP);
    uint view = workgroup() / groups, index = workgroup() % groups * WORKGROUP + lane();
    if (view >= push.views) return;
    uint first = view * push.nodes;
    uint key = index < push.nodes ? depths[first + index] : ~0u;
    uint rank = 0;
    for (uint begin = 0; begin < push.nodes; begin += WORKGROUP) {
        uint other = begin + lane();
        barrier();
        keys[lane()] = other < push.nodes ? depths[first + other] : ~0u;
        barrier();
        uint count = min(WORKGROUP, push.nodes - begin);
        for (uint i = 0; i < count; i++) {
            uint found = keys[i];
            rank += uint(found < key || found == key && begin + i < index);
        }
    }
    if (index < push.nodes) order[first + rank] = index;
}
