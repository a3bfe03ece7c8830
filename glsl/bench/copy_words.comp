#version 460
#include "shared/workgroup.glsl"
// One invocation per four words: copies them. A stage that is bound by memory can move no more bytes in the same time.
// Before: `from` has `elements` elements. After: `to` has the same elements.

layout(binding = 0, scalar) readonly buffer From { uvec4 from[]; };
layout(binding = 1, scalar) writeonly buffer To { uvec4 to[]; };
layout(push_constant, scalar) uniform Push {
    uint elements;
} push;

void main() {
    uint i = workgroup() * WORKGROUP + lane();
    if (i < push.elements) to[i] = from[i];
}
