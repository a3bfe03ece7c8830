// The form of a Gaussian as rays meet it.
// Requires: rays/frame.glsl, rays/view.glsl, rotation.glsl, storage.glsl, VIEW, HALF_SINE, footprints[],
// falloff_limit(opacity)

#include "shared/direction.glsl"

layout(constant_id = 4) const bool ANTIALIASED = false;  // opacities compensate for the low-pass

const float COMPENSATION_MIN = 0.005;  // lower limit of the factor of an opacity (gsplat)

// What a ray splat is made of, in the frame across the direction of the mean, and in units of `unit_of`.
struct RayForm {
    vec3 centre;     // the direction of the mean, or (x, y, 1)
    Across across;
    vec3 factor;     // u = factor.x e1 + factor.y e2, v = factor.z e2
    vec2 gamma;      // q = normal - gamma.x e1 - gamma.y e2
    float bent;      // w differs from 1 by at most this times |s| between rays that end on the plane across the normal
    float kappa;
    float opacity;
    float chord;
    vec3 axis1;      // rows of the root of the covariance, along e1 and e2
    vec3 axis2;
    vec3 low_pass;   // the covariance of the low-pass: along e1, mixed, along e2
};

// The covariance of directions that a pixel covers at a unit direction `rho` from the axis: away from the axis, mixed,
// around it. The table has rows by the sine of half the angle, columns by the place on a square around the axis.
vec3 footprint_at(vec3 n, float rho) {
    float row = min(0.5 * length(vec2(rho, 1.0 - n.z)) / HALF_SINE, 1.0) * float(FOOTPRINTS);
    vec2 place = n.xy / max(abs(n.x) + abs(n.y), 1e-30);
    float around = place.y >= 0.0 ? (place.x >= 0.0 ? place.y : 1.0 - place.x)
                                  : (place.x < 0.0 ? 2.0 - place.y : 3.0 + place.x);
    vec2 cells = vec2(0.25 * around * float(FOOTPRINTS), row);
    uvec2 cell = min(uvec2(cells), uvec2(FOOTPRINTS - 1));
    vec2 inside = cells - vec2(cell);
    uint first = cell.y * (FOOTPRINTS + 1) + cell.x, second = first + FOOTPRINTS + 1;
    vec3 low = mix(footprints[first], footprints[first + 1], inside.x);
    return mix(low, mix(footprints[second], footprints[second + 1], inside.x), inside.y);
}

// A direction of view axes in world axes.
vec3 to_world(vec3 axis) {
    return axis.x * VIEW.right + axis.y * VIEW.down + axis.z * VIEW.forward;
}

// `p`: the mean in view axes.
RayForm ray_form(uint gaussian, vec3 p) {
    RayForm form;
    vec4 rotation;
    vec3 scale;
    load_shape(gaussian, rotation, scale, form.opacity);
    float unit = unit_of(p);
    form.centre = centre_of(p);
    form.across = across(IS_PARALLEL ? vec3(0.0, 0.0, 1.0) : form.centre);
    vec3 normal = form.across.normal, e1 = form.across.e1, e2 = form.across.e2;
    vec2 px = 1.0 / VIEW.focal_px;
    vec3 of_pixel = IS_PARALLEL ? vec3(px.x * px.x, 0.0, px.y * px.y) : footprint_at(normal, length(normal.xy));
    form.low_pass = LOW_PASS * of_pixel;
    float l11 = form.low_pass.x, l12 = form.low_pass.y, l22 = form.low_pass.z;
    // Beyond 1e9 units a longer axis changes no weight.
    scale = min(scale / unit, 1e9);
    mat3 turned = rotation_matrix(rotation);
    vec3 m1 = (to_world(e1) * turned) * scale, m2 = (to_world(e2) * turned) * scale;
    vec3 m3 = (to_world(normal) * turned) * scale;
    vec3 minors = cross(m1, m2);
    float a = dot(m1, m1) + l11, b = dot(m1, m2) + l12, c = dot(m2, m2) + l22, sharp = dot(minors, minors);
    float determinant = sharp + dot(m1, m1) * l22 - 2.0 * dot(m1, m2) * l12 + dot(m2, m2) * l11 + l11 * l22 - l12 * l12;
    // The Cholesky factor of the inverse of [a b; b c].
    float fx = sqrt(c / determinant), fy = -(b / sqrt(c)) / sqrt(determinant), fz = 1.0 / sqrt(c);
    vec2 whitened = vec2(fx * dot(m1, m3) + fy * dot(m2, m3), fz * dot(m2, m3));
    vec2 gamma = IS_PARALLEL ? vec2(0.0) : vec2(fx * whitened.x, fy * whitened.x + fz * whitened.y);
    vec3 along = m3 - gamma.x * m1 - gamma.y * m2;
    // The variance along the ray that is left, as a sum of squares.
    float kappa = dot(along, along) + gamma.x * gamma.x * l11 + 2.0 * gamma.x * gamma.y * l12 + gamma.y * gamma.y * l22;
    float to_exp2 = sqrt(0.5 * LOG2_E);
    form.factor = to_exp2 * vec3(fx, fy, fz);
    form.gamma = gamma;
    form.bent = IS_PARALLEL ? 0.0 : length(whitened) / to_exp2;
    form.kappa = IS_PARALLEL ? 0.0 : kappa / (0.5 * LOG2_E);
    if (ANTIALIASED) form.opacity *= sqrt(max(sharp / determinant, COMPENSATION_MIN * COMPENSATION_MIN));
    float deviations = sqrt(max(falloff_limit(form.opacity), 0.0) / (0.5 * LOG2_E));
    float radius = max(scale.x, max(scale.y, scale.z)) + sqrt(l11 + l22);
    form.chord = chord_of(1.00001 * deviations * radius);
    form.axis1 = m1;
    form.axis2 = m2;
    return form;
}
