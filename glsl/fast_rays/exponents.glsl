// What a splat weighs along the rays of the pixels of a block.
// Requires: fast/transmittance.glsl, WORKGROUP, BLOCK, PIXELS, ROWS, splats[], rays[], push.is_parallel
// Rays are scaled so that their ends lie in the plane through the middle of the block, across its ray. There a pixel is a
// pair of numbers `at`, in which s and w of a splat are affine: no lens is bent any more.
#include "rays/splat.glsl"
#include "fast_rays/record.glsl"

// With COMPACT, most splats are polynomials: exponent = a.x + x (a.y + x a.w) + y (a.z + x b.x + y b.y) at (x, y) = at,
// of second degree around the place of the block that is nearest to the mean; c.w is negative.
// The others, and without COMPACT all, are quotients: s = (a.y + x a.z + y a.w, b.x + y b.y), w = c.x + x c.y + y c.z,
// square = dot(s, s), and exponent = a.x - square / (w^2 + c.w square), where w > 0.
const uint ANY = 0, POLYNOMIALS = 1;  // forms of AT_ONCE staged splats
const uint FORMS = COMPACT ? 2 : 1;
shared vec4 staged_a[WORKGROUP];
shared vec4 staged_b[WORKGROUP];  // zw: red and green
shared vec4 staged_c[WORKGROUP];
shared float staged_blue[WORKGROUP];

struct Record {
    RayRecord shape;
    vec3 colour;
};

const Record NO_RECORD = Record(RayRecord(vec3(0.0), 0.0, vec3(0.0), vec2(0.0), 0.0, vec3(0.0), 0.0), vec3(0.0));

Record load_record(uint splat) {
    uint first = splat * SPLAT_WORDS;
    uvec4 third = splats[first + 2];
    Record record;
    record.shape = record_of(splats[first], splats[first + 1], third);
    if (COMPACT) {
        record.colour = vec3(unpackHalf2x16(third.z), unpackHalf2x16(third.w).x);
    } else {
        record.colour = uintBitsToFloat(uvec3(third.zw, splats[first + 3].x));
    }
    return record;
}

Across plane;      // across the middle ray; across z for a parallel lens
vec3 middle;       // where the plane begins: the middle ray
vec2 at[PIXELS];   // the lane's pixels on the plane
vec2 extent;       // no pixel of the block is farther from (0, 0), by axis
bool has_ray[PIXELS];

void place_pixels(uvec2 corner, uvec2 lane_place) {
    vec3 seen[PIXELS], low = vec3(EVERYWHERE), high = vec3(-EVERYWHERE);
    for (uint k = 0; k < PIXELS; k++) {
        uvec2 place = corner + lane_place + uvec2(0, k * ROWS);
        bool inside = all(lessThan(place, push.size_px));
        seen[k] = inside ? rays[place.y * push.size_px.x + place.x] : vec3(0.0);
        has_ray[k] = seen[k] != vec3(0.0);
        if (has_ray[k]) {
            low = min(low, seen[k]);
            high = max(high, seen[k]);
        }
    }
    bool is_parallel = push.is_parallel == 1;
    middle = 0.5 * (subgroupMin(low) + subgroupMax(high));
    if (!is_parallel) middle = normalize(middle);
    plane = across(is_parallel ? vec3(0.0, 0.0, 1.0) : middle);
    extent = vec2(0.0);
    for (uint k = 0; k < PIXELS; k++) {
        vec3 from_middle = seen[k] - middle;
        vec2 on_plane = vec2(dot(plane.e1, from_middle), dot(plane.e2, from_middle));
        at[k] = has_ray[k] ? on_plane / dot(plane.normal, seen[k]) : vec2(0.0);
        extent = max(extent, abs(at[k]));
    }
    extent = subgroupMax(extent);
}

// The largest error of an exponent for which splats are staged as polynomials.
const float POLYNOMIAL_ERROR = 0.1;

// Stages this lane's splat for all lanes; returns a ballot of those that are no polynomials. A lane without a splat stages one that is never
// drawn, and so does one whose numbers would be infinite or NaN.
uvec4 stage(Record record, bool exists) {
    RayRecord shape = record.shape;
    RayAxes axes = axes_of(shape, push.is_parallel == 1);
    vec3 e = middle - shape.centre;
    vec2 s = vec2(dot(axes.u, e), dot(axes.v, e));
    vec2 s_x = vec2(dot(axes.u, plane.e1), dot(axes.v, plane.e1)), s_y = vec2(dot(axes.u, plane.e2), dot(axes.v, plane.e2));
    float w = dot(axes.q, middle), kappa = shape.kappa;
    vec2 w_by = vec2(dot(axes.q, plane.e1), dot(axes.q, plane.e2));
    uint place = lane();
    staged_blue[place] = record.colour.b;
    uvec4 quotients = uvec4(0);
    if (COMPACT) {
        // The place of the block that is nearest to the mean.
        float mean_along = dot(plane.normal, shape.centre);
        vec2 mean = -vec2(dot(plane.e1, e), dot(plane.e2, e)) / mean_along;
        vec2 from = mean_along > 0.05 ? clamp(mean, -extent, extent) : vec2(0.0);
        vec2 s_from = s + from.x * s_x + from.y * s_y;
        float w_from = w + dot(w_by, from), per_w = 1.0 / w_from;
        // Derivatives of rho = s / w, of square = |rho|^2, and of falloff = square / (1 + kappa square).
        vec2 rho = s_from * per_w, rho_x = (s_x - rho * w_by.x) * per_w, rho_y = (s_y - rho * w_by.y) * per_w;
        float square = dot(rho, rho), rest = 1.0 / (1.0 + kappa * square), by_square = rest * rest;
        vec2 square_by = 2.0 * vec2(dot(rho, rho_x), dot(rho, rho_y)), w_part = w_by * per_w;
        vec2 fall_by = by_square * square_by;
        vec3 fall_twice = 2.0 * by_square * vec3(dot(rho_x, rho_x), dot(rho_x, rho_y), dot(rho_y, rho_y))
            - by_square * vec3(2.0 * square_by.x * w_part.x, dot(square_by, w_part.yx), 2.0 * square_by.y * w_part.y)
            - 2.0 * kappa * rest * by_square * vec3(square_by.x * square_by, square_by.y * square_by.y);
        // Terms of third degree, by the changes of w and of rho within the block where the splat is drawn.
        vec2 far = extent + abs(from);
        float w_change = dot(abs(w_part), far);
        float change = min(dot(rho_x, rho_x) * far.x * far.x + dot(rho_y, rho_y) * far.y * far.y, shape.limit);
        float near = min(square, shape.limit), mixed = sqrt(near * change);
        float error = w_change * (2.0 * change + w_change * (6.0 * mixed + 4.0 * near * w_change))
            + kappa * change * (4.0 * mixed + change);
        bool suits = w_from > 0.0 && w_change < 0.5 && error < POLYNOMIAL_ERROR || !exists;
        quotients = subgroupBallot(!suits);
        if (suits) {
            vec2 turned = vec2(dot(fall_twice.xy, from), dot(fall_twice.yz, from));
            float at_middle = shape.limit - rest * square + dot(fall_by, from) - 0.5 * dot(turned, from) - LOWERED;
            bool draws = exists && abs(at_middle) < 1e30;
            staged_a[place] = draws ? vec4(at_middle, turned - fall_by, -0.5 * fall_twice.x) : vec4(-1e30, vec3(0.0));
            staged_b[place] = draws ? vec4(-fall_twice.y, -0.5 * fall_twice.z, record.colour.rg) : vec4(0.0);
            staged_c[place] = vec4(-1.0);
            return quotients;
        }
    }
    // s is turned so that only its first component depends on x.
    float length_x = length(s_x);
    vec2 turn = length_x > 0.0 ? s_x / length_x : vec2(1.0, 0.0);
    bool draws = exists && dot(s, s) < 1e30;
    staged_a[place] = vec4(shape.limit - LOWERED, dot(turn, s), length_x, dot(turn, s_y));
    staged_b[place] = vec4(turn.x * s.y - turn.y * s.x, turn.x * s_y.y - turn.y * s_y.x, record.colour.rg);
    staged_c[place] = draws ? vec4(w, w_by, kappa) : vec4(-1.0, vec3(0.0));
    if (!draws) {
        staged_a[place] = vec4(0.0);
        staged_b[place] = vec4(0.0);
    }
    return quotients;
}

// True if some of the AT_ONCE splats from `first` on is no polynomial.
bool has_quotient(uvec4 quotients, uint first) {
    return (quotients[first / 32] >> first % 32 & (1 << AT_ONCE) - 1) != 0;
}

struct Curve {
    vec4 a;
    vec4 b;
    vec4 c;
    vec3 colour;
};

Curve staged_curve(uint place, uint form) {
    vec4 b = staged_b[place];
    vec4 c = form == ANY ? staged_c[place] : vec4(-1.0);
    return Curve(staged_a[place], b, c, vec3(b.zw, staged_blue[place]));
}

// log2(alpha / ALPHA_MIN), less LOWERED, at the `k`-th pixel of this lane.
float exponent_at(Curve curve, uint k, uint form) {
    float x = at[k].x, y = at[k].y;
    vec4 a = curve.a, b = curve.b, c = curve.c;
    float polynomial = fma(y, fma(b.y, y, fma(b.x, x, a.z)), fma(x, fma(a.w, x, a.y), a.x));
    if (COMPACT && (form == POLYNOMIALS || c.w < 0.0)) return polynomial;
    float u = fma(a.w, y, fma(a.z, x, a.y)), v = fma(b.y, y, b.x), w = fma(c.z, y, fma(c.y, x, c.x));
    float square = fma(u, u, v * v);
    return w > 0.0 ? a.x - square / fma(w, w, c.w * square) : -1e30;
}
