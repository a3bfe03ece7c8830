// Workgroups of 256 invocations, or of WORKGROUP_SIZE if a shader defines that before it includes this file.
// The subgroup size is only assumed to be a power of two from 4 to 128.
#extension GL_EXT_scalar_block_layout : require
#extension GL_KHR_shader_subgroup_basic : require
#extension GL_KHR_shader_subgroup_vote : require
#extension GL_KHR_shader_subgroup_ballot : require
#extension GL_KHR_shader_subgroup_arithmetic : require

#ifdef WORKGROUP_SIZE
const uint WORKGROUP = WORKGROUP_SIZE;
#else
const uint WORKGROUP = 256;
#endif
const uint MAX_SUBGROUPS = WORKGROUP / 4;
layout(local_size_x = WORKGROUP) in;

// Largest number of workgroups along x; more are folded into y (gpu::FOLD).
const uint FOLD = 65535;

// Index of this invocation in its workgroup, in subgroup order: neighbours share a subgroup on every device, which
// gl_LocalInvocationIndex does not promise. Subgroups are full, so the indices have no gaps.
uint lane() {
    return gl_SubgroupID * gl_SubgroupSize + gl_SubgroupInvocationID;
}

// Index of this workgroup in a folded dispatch, which may have more workgroups than were asked for.
uint workgroup() {
    return gl_WorkGroupID.y * gl_NumWorkGroups.x + gl_WorkGroupID.x;
}

// True if this workgroup is beyond the `groups` that were asked for, which only happens in a folded dispatch. A macro,
// so that others do not wait until the number of groups is loaded.
#define IS_SURPLUS(groups) (gl_NumWorkGroups.y > 1 && workgroup() >= (groups))

// Workgroup counts of an indirect dispatch of `groups` workgroups, folded.
uvec3 folded(uint groups) {
    uint x = min(groups, FOLD);
    return uvec3(x, (groups + max(x, 1) - 1) / max(x, 1), 1);
}

uint div_up(uint a, uint b) {
    return a / b + uint(a % b != 0);
}

#define NUMBER uint
#define SUMS subgroup_sums
#include "shared/workgroup_add.glsl"
#undef NUMBER
#undef SUMS
