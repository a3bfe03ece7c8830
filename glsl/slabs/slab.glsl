// A slab: the splats from (key, index) = begin up to, but without, end, in the total order.
// src/render/slabs/mod.rs explains the words.

struct Slab {
    uvec2 begin;
    uvec2 end;
};

bool is_before(uvec2 one, uvec2 other) {
    return one.x < other.x || one.x == other.x && one.y < other.y;
}

bool is_in(Slab slab, uvec2 position) {
    return !is_before(position, slab.begin) && is_before(position, slab.end);
}
