// One invocation per visible Gaussian writes one of its attributes as the colour of its splat.
// Requires: the bindings and push constants of inspect/shade_attribute.comp, codes, depth, harmonics, grids, rotation,
// ATTRIBUTE, and depth_by_rule(mean), the depth of a mean
#define INDEX_OF(gaussian) (gaussian)
#define IN_WORLD(length) (length)
#define IN_WORLD_AXES(v) (v)
// Of a Gaussian of the scene.
#define LEVEL 0.0
#define LAG(gaussian) 0.0
#define SQUARED_ERROR 0.0
#include "shared/storage.glsl"
#include "inspect/attributes.glsl"

void main() {
    uint index = workgroup() * WORKGROUP + lane();
    if (index >= totals.visible_kept) return;
    uint gaussian = gaussian_from_splat[index];
    vec3 mean = uintBitsToFloat(bounds[gaussian].xyz);
    splats[index].colour = attribute_of(gaussian, mean, depth_by_rule(mean), 1.0);
}
