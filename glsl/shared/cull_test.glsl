// Whether a Gaussian can touch the image that `push.view` sees. Behind the declaration of `push`.
#include "shared/depth.glsl"

// `bound`: the mean, and two bfloat16: how many standard deviations from the mean alpha falls to ALPHA_MIN, and above
// it the same in world units along the longest axis, negative if alpha starts lower.
// Bound on the half extent of the splat: rows of J W have length f/z * sqrt(1 + t^2), t the clamped slope
// (project.comp), and the low-pass adds deviations * sqrt(LOW_PASS) at most.
// `z`: the view depth of its mean.
bool may_be_visible(uvec4 bound, out float z) {
    vec3 mean = uintBitsToFloat(bound.xyz);
    float reach = uintBitsToFloat(bound.w & 0xffff0000), deviations = uintBitsToFloat(bound.w << 16);
    precise vec3 p = (mean - push.view.position_high) - push.view.position_low;
    z = depth_of(mean, push.view);
    if (!(reach >= 0.0 && z > push.view.near)) return false;
    vec2 slope = vec2(dot(push.view.right, p), dot(push.view.down, p)) / z;
    vec2 size = vec2(push.view.size_px);
    vec2 margin = 0.15 * size;
    vec2 low = (-push.view.centre_px - margin) / push.view.focal_px;
    vec2 high = (size - push.view.centre_px + margin) / push.view.focal_px;
    vec2 clamped = clamp(slope, low, high);
    vec2 extent = push.view.focal_px / z * sqrt(1.0 + clamped * clamped) * reach;
    extent += deviations * sqrt(LOW_PASS);
    vec2 mean_px = push.view.focal_px * slope + push.view.centre_px;
    // px, over the rounding of all of the above; the first term is that of the view transform.
    vec2 slack = 1e-6 * push.view.focal_px * sqrt(1.0 + dot(slope, slope)) + 1e-5 * (extent + abs(mean_px)) + 0.01;
    vec2 from = mean_px - extent - slack, to = mean_px + extent + slack;
    // On the image, and not between pixel centres, as the many splats are whose opacity is hardly more than ALPHA_MIN.
    return all(greaterThanEqual(to, vec2(0.0))) && all(lessThanEqual(from, size))
        && all(lessThanEqual(ceil(from - 0.5), floor(to - 0.5)));
}

bool may_be_visible(uvec4 bound) {
    float z;
    return may_be_visible(bound, z);
}
