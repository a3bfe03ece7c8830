// What a splat weighs along the rays of the pixels of a block.
// Requires: fast/transmittance.glsl, WORKGROUP, BLOCK, PIXELS, ROWS, splats[], rays[], push.is_parallel
// Rays are scaled so that their ends lie in the plane through the middle of the block, across its ray. There a pixel is
// a pair of numbers `at`, in which s and w of a splat are affine: no lens is bent any more.
#include "rays/splat.glsl"
#include "fast_rays/record.glsl"

// At (x, y) = at, s = (a.y + x a.z + y a.w, b.x + y b.y), square = dot(s, s), p = b.z + x b.w + y c.x.
// Without COMPACT, splats are quotients: p is w, and exponent = a.x - square / (w^2 + kappa square), where
// w > 0. With COMPACT, most are products: exponent = a.x + square p, where p is -1 / (w^2 + kappa square) to the
// first degree around the place of the block that is nearest to the mean; kappa is negative.
const uint ANY = 0, PRODUCTS = 1;  // forms of the staged splats of a subgroup
const uint FORMS = COMPACT ? 2 : 1;
shared vec4 staged_a[WORKGROUP];
shared vec4 staged_b[WORKGROUP];
shared vec4 staged_c[WORKGROUP];  // yzw: colour
shared float staged_kappa[WORKGROUP];

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

// The largest error of an exponent for which splats are staged as products.
const float PRODUCT_ERROR = 0.1;

// Stages this lane's splat for all lanes; returns the form of all splats. A lane without a splat stages one that is
// never drawn, and so does one whose numbers would be infinite or NaN.
uint stage(Record record, bool exists) {
    RayRecord shape = record.shape;
    RayAxes axes = axes_of(shape, push.is_parallel == 1);
    vec3 e = middle - shape.centre;
    vec2 s = vec2(dot(axes.u, e), dot(axes.v, e));
    vec2 s_x = vec2(dot(axes.u, plane.e1), dot(axes.v, plane.e1));
    vec2 s_y = vec2(dot(axes.u, plane.e2), dot(axes.v, plane.e2));
    vec3 p = vec3(dot(axes.q, middle), dot(axes.q, plane.e1), dot(axes.q, plane.e2));
    float kappa = shape.kappa;
    bool is_product = false;
    if (COMPACT) {
        // The place of the block that is nearest to the mean.
        float mean_along = dot(plane.normal, shape.centre);
        vec2 mean = -vec2(dot(plane.e1, e), dot(plane.e2, e)) / mean_along;
        vec2 from = mean_along > 0.05 ? clamp(mean, -extent, extent) : vec2(0.0);
        vec2 far = extent + abs(from), s_from = s + from.x * s_x + from.y * s_y;
        float w = p.x + dot(p.yz, from), square = dot(s_from, s_from), whole = w * w + kappa * square;
        float per_whole = 1.0 / whole;
        vec2 whole_by = 2.0 * (w * p.yz + kappa * vec2(dot(s_from, s_x), dot(s_from, s_y)));
        // Terms of second degree, by the changes of w, of s and of both within the block, where the splat is drawn.
        float w_change = dot(abs(p.yz), far), whole_change = dot(abs(whole_by), far) * per_whole;
        float s_change = dot(s_x, s_x) * far.x * far.x + dot(s_y, s_y) * far.y * far.y;
        float change = whole_change * whole_change + (w_change * w_change + kappa * s_change) * per_whole;
        float fall = min(2.0 * (square + s_change) * per_whole, shape.limit);
        is_product = w > w_change && whole_change < 0.5 && change * fall < PRODUCT_ERROR;
        if (is_product) {
            p.yz = whole_by * per_whole * per_whole;
            p.x = -per_whole - dot(p.yz, from);
            kappa = -1.0;
        }
    }
    // s is turned so that only its first component depends on x.
    float length_x = length(s_x);
    vec2 turn = length_x > 0.0 ? s_x / length_x : vec2(1.0, 0.0);
    bool draws = exists && dot(s, s) < 1e30;
    uint place = lane();
    vec4 a = vec4(shape.limit - LOWERED, dot(turn, s), length_x, dot(turn, s_y));
    vec4 b = vec4(turn.x * s.y - turn.y * s.x, turn.x * s_y.y - turn.y * s_y.x, p.xy);
    staged_a[place] = draws ? a : vec4(-1e30, vec3(0.0));
    staged_b[place] = draws ? b : vec4(0.0);
    staged_c[place] = draws ? vec4(p.z, record.colour) : vec4(0.0);
    staged_kappa[place] = draws ? kappa : -1.0;
    return subgroupAll(is_product || !draws) ? PRODUCTS : ANY;
}

struct Curve {
    vec4 a;
    vec4 b;
    float by_y;
    float kappa;
    vec3 colour;
};

Curve staged_curve(uint place, uint form) {
    vec4 c = staged_c[place];
    return Curve(staged_a[place], staged_b[place], c.x, form == ANY ? staged_kappa[place] : -1.0, c.yzw);
}

// log2(alpha / ALPHA_MIN), less LOWERED, at the `k`-th pixel of this lane.
float exponent_at(Curve curve, uint k, uint form) {
    float x = at[k].x, y = at[k].y;
    vec4 a = curve.a, b = curve.b;
    float u = fma(a.w, y, fma(a.z, x, a.y)), v = fma(b.y, y, b.x), p = fma(curve.by_y, y, fma(b.w, x, b.z));
    float square = fma(u, u, v * v), product = fma(square, p, a.x);
    if (form == PRODUCTS) return product;
    float quotient = p > 0.0 ? a.x - square / fma(p, p, curve.kappa * square) : -1e30;
    return COMPACT && curve.kappa < 0.0 ? product : quotient;
}
