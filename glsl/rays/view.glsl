// The mean of a Gaussian as rays see it.
// Requires: rays/frame.glsl, depth.glsl, VIEW, IS_PARALLEL, true if the lens is parallel

// A point in view axes.
vec3 view_axes(vec3 mean) {
    precise vec3 p = (mean - VIEW.position_high) - VIEW.position_low;
    return vec3(dot(VIEW.right, p), dot(VIEW.down, p), dot(VIEW.forward, p));
}

// The depth by which splats are sorted, rounded once: z for a parallel lens, the distance for others.
float far_of(vec3 mean) {
    return IS_PARALLEL ? depth_of(mean, VIEW) : distance_of(mean, VIEW);
}

// The world units that rays measure as 1.
float unit_of(vec3 p) {
    return IS_PARALLEL ? 1.0 : length(p);
}

vec3 centre_of(vec3 p) {
    return IS_PARALLEL ? vec3(p.xy, 1.0) : p / length(p);
}

// The distance from `centre` within which all rays end that pass a sphere around the mean. `radius`: in units of
// `unit_of`.
float chord_of(float radius) {
    if (IS_PARALLEL) return radius;
    // 2 sin(angle / 2), where sin(angle) is the radius.
    return radius < 1.0 ? radius / sqrt(0.5 + 0.5 * sqrt(1.0 - radius * radius)) : EVERYWHERE;
}
