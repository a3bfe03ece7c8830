// The index of a Gaussian of the current page among the Gaussians of all placements. It orders splats of equal depth.
// Requires: page, indices[], push.gaussians

uint index_of(uint gaussian) {
    return page.has_indices ? page.view * push.gaussians + indices[gaussian] : gaussian;
}
