#extension GL_KHR_shader_subgroup_shuffle : require
// Shares the items of all lanes of a subgroup among its lanes: finds the lane that an item belongs to.

layout(constant_id = 6) const uint SUBGROUP = 32;  // lanes of every subgroup

// The lane that the item `index` of a subgroup belongs to. `before`: number of items of the lanes before this one.
uint owner_of(uint before, uint index) {
    uint owner = 0;
    for (uint step = SUBGROUP / 2; step > 0; step /= 2) {
        if (subgroupShuffle(before, owner + step) <= index) owner += step;
    }
    return owner;
}
