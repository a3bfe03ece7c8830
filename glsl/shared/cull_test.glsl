// The cull test: a bound on where a Gaussian can touch the image that `VIEW` sees.
// Requires: frame.glsl, marks.glsl, VIEW
#include "shared/depth.glsl"

// True if the Gaussian may touch a pixel centre; `z` is the view depth of its mean.
// `bound` holds the mean, and two bfloat16 in its last word. The lower one is the number of standard deviations from
// the mean at which alpha falls to ALPHA_MIN. The upper one is the same in world units along the longest axis, or
// negative if alpha is below ALPHA_MIN everywhere. Their signs are marks (marks.glsl).
// The half extent of the splat is bounded: the rows of J W have length f/z * sqrt(1 + t^2), where t is the clamped
// slope (projection.glsl), and the low-pass adds at most deviations * sqrt(LOW_PASS).
bool may_be_visible(uvec4 bound, out float z) {
    vec3 mean = uintBitsToFloat(bound.xyz);
    vec2 sizes = reach_and_deviations(bound.w);
    float reach = sizes.x, deviations = sizes.y;
    precise vec3 p = (mean - VIEW.position_high) - VIEW.position_low;
    z = depth_of(mean, VIEW);
    if (is_never_drawn(bound.w) || !(z > VIEW.near)) return false;
    vec2 slope = vec2(dot(VIEW.right, p), dot(VIEW.down, p)) / z;
    vec2 size = vec2(VIEW.size_px);
    vec2 margin = 0.15 * size;
    vec2 low = (-VIEW.centre_px - margin) / VIEW.focal_px;
    vec2 high = (size - VIEW.centre_px + margin) / VIEW.focal_px;
    vec2 clamped = clamp(slope, low, high);
    vec2 extent = VIEW.focal_px / z * sqrt(1.0 + clamped * clamped) * reach;
    extent += deviations * sqrt(LOW_PASS);
    vec2 mean_px = VIEW.focal_px * slope + VIEW.centre_px;
    // px, covers the rounding of everything above; the first term covers that of the view transform.
    vec2 slack = 1e-6 * VIEW.focal_px * sqrt(1.0 + dot(slope, slope)) + 1e-5 * (extent + abs(mean_px)) + 0.01;
    vec2 from = mean_px - extent - slack, to = mean_px + extent + slack;
    // The box meets the drawn rows and holds a pixel centre. Many splats whose opacity is hardly above ALPHA_MIN hold
    // none.
    vec2 rows = vec2(rows_of(VIEW.band));
    return all(greaterThanEqual(to, vec2(0.0, rows.x))) && all(lessThanEqual(from, vec2(size.x, rows.y)))
        && all(lessThanEqual(ceil(from - 0.5), floor(to - 0.5)));
}

bool may_be_visible(uvec4 bound) {
    float z;
    return may_be_visible(bound, z);
}
