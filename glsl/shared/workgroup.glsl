// Workgroups of 256, or as a shader says before it includes this, with nothing assumed of the subgroup size but that it is a power of two from 4 to 128.
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

// Most workgroups along x; more are folded into y (gpu::FOLD).
const uint FOLD = 65535;

// Index of this invocation in its workgroup, in subgroup order: neighbours share a subgroup on every device, which
// gl_LocalInvocationIndex does not promise. Subgroups are full, so this counts from 0 on.
uint lane() {
    return gl_SubgroupID * gl_SubgroupSize + gl_SubgroupInvocationID;
}

// Index of this workgroup in a folded dispatch. There may be more workgroups than were asked for.
uint workgroup() {
    return gl_WorkGroupID.y * gl_NumWorkGroups.x + gl_WorkGroupID.x;
}

// Workgroup counts of an indirect dispatch of `groups` workgroups, folded.
uvec3 folded(uint groups) {
    uint x = min(groups, FOLD);
    return uvec3(x, (groups + max(x, 1) - 1) / max(x, 1), 1);
}

uint div_up(uint a, uint b) {
    return a / b + uint(a % b != 0);
}

shared uint subgroup_sums[MAX_SUBGROUPS];

// Sum of `value` over the lanes before this one, and over all lanes. The whole workgroup must call it.
uint workgroup_exclusive_add(uint value, out uint total) {
    uint before = subgroupExclusiveAdd(value);
    barrier();  // an earlier call may still be reading
    if (gl_SubgroupInvocationID == gl_SubgroupSize - 1) {
        subgroup_sums[gl_SubgroupID] = before + value;
    }
    barrier();
    total = 0;
    for (uint i = 0; i < gl_NumSubgroups; i++) {
        before += i < gl_SubgroupID ? subgroup_sums[i] : 0;
        total += subgroup_sums[i];
    }
    return before;
}
