// The sum over the lanes of a workgroup before each. To be included once for each type that is summed.
// Requires: workgroup.glsl; the macros NUMBER, the type, and SUMS, the name of the workgroup memory

shared NUMBER SUMS[MAX_SUBGROUPS];

// Returns the sum of `value` over the lanes before this one; `total` is the sum over all lanes. The whole workgroup
// must call it.
NUMBER workgroup_exclusive_add(NUMBER value, out NUMBER total) {
    NUMBER before = subgroupExclusiveAdd(value);
    barrier();  // lanes may still read the sums of an earlier call
    if (gl_SubgroupInvocationID == gl_SubgroupSize - 1) SUMS[gl_SubgroupID] = before + value;
    barrier();
    total = NUMBER(0);
    // Each lane of a subgroup loads the sum of another subgroup: a loop over all of them in each lane takes longer.
    for (uint first = 0; first < gl_NumSubgroups; first += gl_SubgroupSize) {
        uint other = first + gl_SubgroupInvocationID;
        NUMBER sum = other < gl_NumSubgroups ? SUMS[other] : NUMBER(0);
        before += subgroupAdd(other < gl_SubgroupID ? sum : NUMBER(0));
        total += subgroupAdd(sum);
    }
    return before;
}
