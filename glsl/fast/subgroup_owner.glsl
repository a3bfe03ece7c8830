#extension GL_KHR_shader_subgroup_shuffle : require
// Finds which lane an item belongs to when the lanes of a subgroup share out all their items.

layout(constant_id = 6) const uint SUBGROUP = 32;  // lanes of every subgroup

// The lane that the item `index` of a subgroup belongs to, where `before` is the number of items of the lanes before each.
uint owner_of(uint before, uint index) {
    uint owner = 0;
    for (uint step = SUBGROUP / 2; step > 0; step /= 2) {
        if (subgroupShuffle(before, owner + step) <= index) owner += step;
    }
    return owner;
}
