#extension GL_EXT_control_flow_attributes : require
#extension GL_KHR_shader_subgroup_shuffle : require
// Chains of one operation, whose time and code show what the operation costs.
// Requires: shared/workgroup.glsl; UNROLLED; VALUE, the type of the values; FROM(number), the VALUE of a float;
// BITS(value)
// Each invocation applies the operation to CHAINS independent values, UNROLLED times each in every round. Operands come
// from a buffer, and all values go into the results, so that no compiler can leave out an operation.

const uint CHAINS = 8;
const uint MOST_UNROLLED = 8;

layout(binding = 0, scalar) readonly buffer Numbers { float numbers[]; };  // [WORKGROUP + CHAINS] from 0.5 to 1
layout(binding = 1, scalar) writeonly buffer Results { uint results[]; };  // [workgroups * WORKGROUP]
layout(push_constant, scalar) uniform Push {
    uint rounds;
} push;

// Values in workgroup memory that all lanes load from the same address.
shared vec4 shared_values[CHAINS * (MOST_UNROLLED + 1)];

VALUE applied(VALUE a, VALUE b, VALUE c, uint address);

void main() {
    for (uint i = lane(); i < shared_values.length(); i += WORKGROUP) shared_values[i] = vec4(numbers[i]);
    barrier();
    VALUE values[CHAINS];
    for (uint k = 0; k < CHAINS; k++) values[k] = FROM(numbers[lane() + k]);
    VALUE b = FROM(numbers[0]), c = FROM(numbers[1] * 0.3);
    [[dont_unroll]] for (uint round = 0; round < push.rounds; round++) {
        [[unroll]] for (uint i = 0; i < UNROLLED; i++) {
            [[unroll]] for (uint k = 0; k < CHAINS; k++) {
                values[k] = applied(values[k], b, c, round % CHAINS + i * CHAINS + k);
            }
        }
    }
    uint all = 0;
    for (uint k = 0; k < CHAINS; k++) all ^= BITS(values[k]);
    results[workgroup() * WORKGROUP + lane()] = all;
}
