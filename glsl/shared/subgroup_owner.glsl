#extension GL_KHR_shader_subgroup_shuffle : require
// Behind the declaration of SUBGROUP.

// The lane that the item `index` of a subgroup belongs to, where the lanes before each have `before` of them in all.
uint owner_of(uint before, uint index) {
    uint owner = 0;
    for (uint step = SUBGROUP / 2; step > 0; step /= 2) {
        if (subgroupShuffle(before, owner + step) <= index) owner += step;
    }
    return owner;
}
