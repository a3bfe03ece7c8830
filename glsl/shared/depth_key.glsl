// The depth key of a splat: the number of floats between the near plane and its depth, without its lowest bits.
// Requires: frame.glsl, depth.glsl, push.depth_limit, push.depth_shift, and as macros
//   VIEW             the camera, in the axes and units of the Gaussians
//   IN_WORLD(depth)  a depth in world units
//   NEAR             the near plane in world units

layout(constant_id = 3) const bool BY_DISTANCE = false;  // depth keys are distances from the camera

// `z`: the view depth of the mean.
uint depth_key(vec3 mean, float z) {
    float far = IN_WORLD(BY_DISTANCE ? distance_of(mean, VIEW) : z);
    uint depth = floatBitsToUint(far) - floatBitsToUint(NEAR);  // positive floats order like their bits
    return min(depth >> push.depth_shift, push.depth_limit);
}
