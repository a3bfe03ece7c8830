#version 460
#define WORKGROUP_SIZE 128
#include "shared/workgroup.glsl"
// One workgroup: waits for its own workgroup memory again and again. The more memory a workgroup has, the fewer run at
// the same time.
// Before: numbers has WORKGROUP zeros. After: results.

layout(constant_id = 0) const uint WORDS = WORKGROUP;  // of workgroup memory

layout(binding = 0, scalar) readonly buffer Numbers { uint numbers[]; };   // [WORKGROUP] zeros
layout(binding = 1, scalar) writeonly buffer Results { uint results[]; };  // [workgroups * WORKGROUP]
layout(push_constant, scalar) uniform Push {
    uint rounds;
} push;

shared uint next[WORDS];

void main() {
    // Each lane goes on at the same place, which the compiler does not know.
    next[lane()] = lane() ^ numbers[lane()];
    barrier();
    uint at = lane();
    for (uint i = 0; i < push.rounds; i++) at = next[at];
    results[workgroup() * WORKGROUP + lane()] = at;
}
