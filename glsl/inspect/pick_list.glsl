// One invocation per instance of one tile's list computes the depth, alpha and colour of its splat at one pixel.
// Requires: the bindings and push constants of inspect/pick.comp, portable/blend_splat.glsl, and
//   falloff_here(splat)    the falloff of a splat at the pixel
//   depth_by_rule(mean)    the depth of a mean

void main() {
    uint index = workgroup() * WORKGROUP + lane();
    if (index >= push.count) return;
    uint id = splat_ids[push.first + index];
    uint gaussian = gaussian_from_splat[id];
    SPLAT splat = splats[id];
    float fall = falloff_here(splat);
    bool drawn = fall <= falloff_limit(splat.opacity);
    gaussians[index] = gaussian;
    evidence[index].depth = depth_by_rule(uintBitsToFloat(bounds[gaussian].xyz));
    evidence[index].alpha = drawn ? alpha_at(splat.opacity, fall) : 0.0;
    evidence[index].colour = splat.colour;
}
