// The projection of a Gaussian to a ray splat, and the bins that its rays are in.
// Requires: fast_rays/frame.glsl, fast_rays/record.glsl, ellipse.glsl, depth.glsl, rotation.glsl, storage.glsl,
// marks.glsl, VIEW, lens_table[], cells[], footprints[]

#define IS_PARALLEL (lens_table[1].z == 1)
#define HALF_SINE uintBitsToFloat(lens_table[1].x)

float falloff_limit(float opacity) {
    return log2(opacity / ALPHA_MIN);
}

#include "rays/view.glsl"
#include "rays/form.glsl"

const float FURTHEST_BEND = 64.0;  // px: splats that a lens bends more are listed by the rays of bins
// Its rows and columns are all those of the picture.
const Ellipse ALL_BINS = Ellipse(vec2(0.0), vec2(1e9), 0.0, 1e18, 1e-18, 1.0, 0.0);

// The picture around a direction, as a plane: the place of the direction, and the change of x and y px by a change of
// the direction in view axes.
struct Place {
    vec2 px;
    vec3 grad_x;
    vec3 grad_y;
    vec2 bends;  // near, far; px
};

Place place_of(vec3 centre) {
    if (IS_PARALLEL) {
        vec2 px = VIEW.focal_px * centre.xy + VIEW.centre_px;
        return Place(px, vec3(VIEW.focal_px.x, 0.0, 0.0), vec3(0.0, VIEW.focal_px.y, 0.0), vec2(0.0));
    }
    vec3 size = abs(centre);
    uint axis = size.x >= size.y && size.x >= size.z ? 0 : size.y >= size.z ? 1 : 2;
    // The axes in turn, so that the first is that of the face.
    vec3 turned = axis == 0 ? centre.xyz : axis == 1 ? centre.yzx : centre.zxy;
    float per_face = 1.0 / abs(turned.x);
    vec2 at = turned.yz * per_face;
    uvec2 cell = min(uvec2(max((0.5 * at + 0.5) * float(CELLS), 0.0)), uvec2(CELLS - 1));
    uint face = 2 * axis + uint(turned.x < 0.0), index = (face * CELLS + cell.y) * CELLS + cell.x;
    index *= CELL_ELEMENTS;
    vec4 first = uintBitsToFloat(cells[index]), second = uintBitsToFloat(cells[index + 1]);
    vec2 offset = at - ((vec2(cell) + 0.5) * (2.0 / float(CELLS)) - 1.0);
    // The coordinates of the face change by these vectors, in turned axes.
    vec3 grad_a = per_face * vec3(-at.x * sign(turned.x), 1.0, 0.0);
    vec3 grad_b = per_face * vec3(-at.y * sign(turned.x), 0.0, 1.0);
    vec2 by_a = VIEW.focal_px * first.zw, by_b = VIEW.focal_px * second.xy;
    vec3 grad_x = by_a.x * grad_a + by_b.x * grad_b, grad_y = by_a.y * grad_a + by_b.y * grad_b;
    Place place;
    place.px = VIEW.focal_px * first.xy + VIEW.centre_px + by_a * offset.x + by_b * offset.y;
    place.grad_x = axis == 0 ? grad_x : axis == 1 ? grad_x.zxy : grad_x.yzx;
    place.grad_y = axis == 0 ? grad_y : axis == 1 ? grad_y.zxy : grad_y.yzx;
    place.bends = max(VIEW.focal_px.x, VIEW.focal_px.y) * second.zw;
    return place;
}

// px, by how much places within `chord` of a direction may differ from linear ones: infinite where there is no bound,
// negative where there is no such place.
float bend_px(Place place, float chord) {
    float angle = chord + CELL, bend = chord > NEAR_REACH ? place.bends.y : place.bends.x;
    return IS_PARALLEL ? 0.0 : bend * angle * angle;
}

// The words of `bound` and the test of pixel centres are those of shared/cull_test.glsl.
bool may_be_visible(uvec4 bound, out float far) {
    vec3 mean = uintBitsToFloat(bound.xyz);
    vec2 sizes = reach_and_deviations(bound.w);
    float reach = sizes.x, deviations = sizes.y;
    far = far_of(mean);
    if (is_never_drawn(bound.w) || !(far > VIEW.near)) return false;
    vec3 p = view_axes(mean);
    vec3 centre = centre_of(p);
    float widest = uintBitsToFloat(lens_table[1].y);
    float chord = chord_of(1.00001 * reach / unit_of(p) + deviations * sqrt(LOW_PASS) * widest);
    vec4 all = uintBitsToFloat(lens_table[0]);
    if (distance(centre, all.xyz) > chord + all.w) return false;
    if (chord > FAR_REACH && !IS_PARALLEL) return true;
    Place place = place_of(centre);
    float bent = bend_px(place, chord);
    if (bent < 0.0) return false;
    vec2 extent = chord * vec2(length(place.grad_x), length(place.grad_y)) + bent;
    vec2 slack = 1e-5 * (extent + abs(place.px)) + 0.01;
    vec2 from = place.px - extent - slack, to = place.px + extent + slack;
    // NaN and infinity are visible.
    bool is_beside = any(lessThan(to, vec2(0.0))) || any(greaterThan(from, vec2(VIEW.size_px)));
    return !(is_beside || any(greaterThan(ceil(from - 0.5), floor(to - 0.5))));
}

// The ellipse that holds the pixels whose rays meet the splat; ALL_BINS where there is no bound.
Ellipse ellipse_around(RayForm form, float limit) {
    // A little beyond the true border, as ellipse_of.
    float slope = slope_of(form.kappa, limit + 2e-4);
    if (!(slope >= 0.0 && slope * form.bent < 0.5 && (IS_PARALLEL || form.chord <= FAR_REACH))) return ALL_BINS;
    Place place = place_of(form.centre);
    float slack = bend_px(place, form.chord);
    if (slack < 0.0) return EMPTY_ELLIPSE;
    if (!(slack <= FURTHEST_BEND)) return ALL_BINS;
    // |s| <= slope w, where w is at most 1 + bent |s|.
    float radius = slope / (1.0 - slope * form.bent), level = radius * radius / (0.5 * LOG2_E);
    vec3 e1 = form.across.e1, e2 = form.across.e2, low = form.low_pass;
    vec2 by_1 = vec2(dot(place.grad_x, e1), dot(place.grad_y, e1));
    vec2 by_2 = vec2(dot(place.grad_x, e2), dot(place.grad_y, e2));
    vec3 v0 = by_1.x * form.axis1 + by_2.x * form.axis2, v1 = by_1.y * form.axis1 + by_2.y * form.axis2;
    vec3 minors = cross(v0, v1);
    // The covariances of the Gaussian and of the low-pass on the picture: (xx, xy, yy).
    vec3 own = vec3(dot(v0, v0), dot(v0, v1), dot(v1, v1));
    vec3 wide = low.x * vec3(by_1.x * by_1.x, by_1.x * by_1.y, by_1.y * by_1.y)
        + low.y * vec3(2.0 * by_1.x * by_2.x, by_1.x * by_2.y + by_1.y * by_2.x, 2.0 * by_1.y * by_2.y)
        + low.z * vec3(by_2.x * by_2.x, by_2.x * by_2.y, by_2.y * by_2.y);
    float turn = by_1.x * by_2.y - by_1.y * by_2.x;
    float determinant = dot(minors, minors) + own.x * wide.z + own.z * wide.x - 2.0 * own.y * wide.y
        + turn * turn * (low.x * low.z - low.y * low.y);
    vec3 both = own + wide;
    // An ellipse that holds all within `slack` of this one: the sum of both, each widened.
    float part = max(slack * inversesqrt(0.5 * level * (both.x + both.z)), 1e-6);
    float grown = 1.0 + part, round = grown / part * slack * slack / level;
    determinant = grown * grown * determinant + grown * round * (both.x + both.z) + round * round;
    return ellipse_at(place.px, vec4(grown * both + vec3(round, 0.0, round), determinant), 1.0, level);
}

// `p`: the mean relative to the camera, in world axes; `far`: its depth.
void project(uint gaussian, vec3 p, float far, out RayRecord splat, out Ellipse ellipse) {
    RayForm form = ray_form(gaussian, vec3(dot(VIEW.right, p), dot(VIEW.down, p), dot(VIEW.forward, p)));
    splat.centre = form.centre;
    splat.limit = falloff_limit(form.opacity);
    splat.factor = form.factor;
    splat.gamma = form.gamma;
    splat.kappa = form.kappa;
    splat.chord = form.chord;
    ellipse = splat.limit >= 0.0 ? ellipse_around(form, splat.limit) : EMPTY_ELLIPSE;
}

#define SPLAT RayRecord
