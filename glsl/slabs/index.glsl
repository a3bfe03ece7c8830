// The index of a Gaussian of the current page in its scene, among all placed scenes: it orders splats of equal depth.
// Requires: found.glsl, indices[]

uint index_of(uint gaussian) {
    bool has_indices = (page.filled & HAS_INDICES) != 0;
    return page.first + (has_indices ? indices[gaussian] : gaussian - page.slot * PAGE);
}
