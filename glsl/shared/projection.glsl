// The projection of a Gaussian to a splat.
// Requires: frame.glsl, ellipse.glsl, rotation.glsl, storage.glsl, VIEW
// OPACITIES_OF(gaussian), if it is defined, gives the two opacities of a node (several Gaussians), and
// faded_opacity(gaussian, opacity) the opacity of its drawn fraction.

#include "shared/direction.glsl"

layout(constant_id = 4) const bool ANTIALIASED = false;  // opacities compensate for the low-pass

const float COMPENSATION_MIN = 0.005;  // lower limit of the factor of an opacity (gsplat)

// The 2D covariance V V^T + low_pass I as (a, b, c) = (xx, xy, yy), and its determinant, where V (2x3) = J W R S.
// The determinant is a sum of squares of the minors of V (Cauchy-Binet), so that no needle loses it to cancellation.
// `sharp_part` is the determinant without the low-pass, divided by the one with it.
vec4 covariance_of(vec3 v0, vec3 v1, float low_pass, out float sharp_part) {
    vec3 minors = cross(v0, v1);
    vec3 abc = vec3(dot(v0, v0), dot(v0, v1), dot(v1, v1));
    float sharp = dot(minors, minors);
    float determinant = sharp + low_pass * (abc.x + abc.z) + low_pass * low_pass;
    sharp_part = sharp / determinant;
    return vec4(abc.x + low_pass, abc.y, abc.z + low_pass, determinant);
}

// Projects one Gaussian to a splat without its colour, and to its ellipse. `p` is its mean relative to the camera, in
// world axes; `z` is its depth.
void project(uint gaussian, vec3 p, float z, out Splat splat, out Ellipse ellipse) {
    vec4 rotation;
    vec3 scale;
    load_shape(gaussian, rotation, scale, splat.opacity);
    vec2 slope = vec2(dot(VIEW.right, p), dot(VIEW.down, p)) / z;
    vec2 size = vec2(VIEW.size_px);
    // The Jacobian's slope is clamped 15 % of the image beyond each edge (the original's 1.3 tan(fov/2)).
    vec2 low = (-VIEW.centre_px - 0.15 * size) / VIEW.focal_px;
    vec2 high = (size - VIEW.centre_px + 0.15 * size) / VIEW.focal_px;
    vec2 clamped = clamp(slope, low, high);
    vec2 px_per_world = VIEW.focal_px / z;
    mat3 to_world = rotation_matrix(rotation);
    float stretch = max(px_per_world.x, px_per_world.y) * sqrt(1.0 + dot(clamped, clamped));
    // Beyond 1e16 px a longer axis changes no weight on the image.
    scale = min(scale, 1e16 / stretch);
    // Axes are measured in this unit, so that no fourth power of one overflows.
    float unit_px = max(1.0, 1e-8 * stretch * max(scale.x, max(scale.y, scale.z)));
    vec2 per_world = px_per_world / unit_px;
    vec3 v0 = per_world.x * ((VIEW.right - clamped.x * VIEW.forward) * to_world) * scale;
    vec3 v1 = per_world.y * ((VIEW.down - clamped.y * VIEW.forward) * to_world) * scale;
    float sharp_part;
    vec4 covariance = covariance_of(v0, v1, LOW_PASS / unit_px / unit_px, sharp_part);
    float a = covariance.x, b = covariance.y, c = covariance.z, determinant = covariance.w;

    float to_exp2 = sqrt(0.5 * LOG2_E) / unit_px;
    splat.mean_px = VIEW.focal_px * slope + VIEW.centre_px;
    splat.factor.x = to_exp2 * sqrt(c / determinant);
    splat.factor.y = -to_exp2 * (b / sqrt(c)) / sqrt(determinant);  // two roots: c * determinant may overflow
    splat.factor.z = to_exp2 / sqrt(c);
#ifdef OPACITIES_OF
    // The classic rules widen each of the Gaussians that a node stands for by the low-pass, so what they cover together
    // goes from the node's own opacity times its area to the sum of theirs times that of a pixel.
    vec2 of_node = OPACITIES_OF(gaussian);
    if (of_node.x >= 0.0) splat.opacity = ANTIALIASED ? of_node.x : mix(of_node.y, of_node.x, sqrt(sharp_part));
    splat.opacity = faded_opacity(gaussian, splat.opacity);
#endif
    if (ANTIALIASED) splat.opacity *= sqrt(max(sharp_part, COMPENSATION_MIN * COMPENSATION_MIN));
    ellipse = ellipse_of(splat.mean_px, covariance, unit_px, splat.opacity);
}
