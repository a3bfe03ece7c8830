#version 460
#include "shared/workgroup.glsl"
#include "shared/frame.glsl"
#include "shared/depth.glsl"
#include "shared/marks.glsl"
#include "marks/figure.glsl"
// One invocation per Gaussian: selects it if its centre or its value is inside a figure. Gaussians that are left out
// of pictures are never selected.
// Before: bounds have the marks of the selection before. After: bounds have those of the new one, selected its bits.

layout(binding = 0, scalar) buffer Bounds { uvec4 bounds[]; };                              // [gaussians] mean, reach
layout(binding = 1, scalar) readonly buffer FigureBlock { Figure figure; };
layout(binding = 2, scalar) readonly buffer Points { vec2 points[]; };                      // [points] px
layout(binding = 3, scalar) readonly buffer Values { float values[]; };                     // [gaussians], or unused
layout(binding = 4, scalar) readonly buffer Contributions { float contributions[]; };       // [gaussians], or unused
layout(binding = 5, scalar) writeonly buffer Selected { uint selected[]; };                 // [gaussians / 32] bits
layout(push_constant, scalar) uniform Push {
    View view;
    uint gaussians;
    uint kind;    // FIGURE_
    uint mode;    // MODE_
    uint points;  // of the outline
} push;

shared uint words[WORKGROUP / 32];

float from_segment(vec2 place, vec2 a, vec2 b) {
    vec2 step = b - a;
    float squared = dot(step, step);
    float along = squared > 0.0 ? clamp(dot(place - a, step) / squared, 0.0, 1.0) : 0.0;
    return distance(place, a + along * step);
}

// By the even-odd rule.
bool is_in_lasso(vec2 place) {
    bool inside = false;
    for (uint i = 0; i < push.points; i++) {
        vec2 a = points[i], b = points[i + 1 < push.points ? i + 1 : 0];
        bool crosses = (a.y > place.y) != (b.y > place.y);
        if (crosses && place.x < (b.x - a.x) * ((place.y - a.y) / (b.y - a.y)) + a.x) inside = !inside;
    }
    return inside;
}

bool is_under_brush(vec2 place) {
    for (uint i = 0; i < push.points; i++) {
        if (from_segment(place, points[i > 0 ? i - 1 : 0], points[i]) <= figure.radius) return true;
    }
    return false;
}

bool is_in_outline(vec3 mean) {
    float z = depth_of(mean, VIEW);
    if (!(z > VIEW.near)) return false;
    precise vec3 p = (mean - VIEW.position_high) - VIEW.position_low;
    vec2 place = VIEW.focal_px * (vec2(dot(VIEW.right, p), dot(VIEW.down, p)) / z) + VIEW.centre_px;
    bool is_near = all(greaterThanEqual(place, figure.low.xy)) && all(lessThanEqual(place, figure.high.xy));
    switch (is_near ? push.kind : FIGURE_VALUES) {
        case FIGURE_RECTANGLE: return true;
        case FIGURE_LASSO: return is_in_lasso(place);
        case FIGURE_BRUSH: return is_under_brush(place);
        default: return false;
    }
}

bool is_inside(uint gaussian, vec3 mean) {
    if (figure.visible > 0.0 && !(contributions[gaussian] >= figure.visible)) return false;
    switch (push.kind) {
        case FIGURE_BALL: return distance(mean, figure.low) <= figure.radius;
        case FIGURE_BOX:
            return all(greaterThanEqual(mean, figure.low)) && all(lessThanEqual(mean, figure.high));
        case FIGURE_VALUES: return values[gaussian] >= figure.low.x && values[gaussian] <= figure.high.x;
        default: return is_in_outline(mean);
    }
}

void main() {
    if (lane() < WORKGROUP / 32) words[lane()] = 0;
    barrier();
    uint gaussian = workgroup() * WORKGROUP + lane();
    if (gaussian < push.gaussians) {
        uvec4 bound = bounds[gaussian];
        bool left_out = is_left_out(bound.w), before = is_selected(bound.w);
        // Where the result does not depend on the figure, it is not asked.
        bool asks = !left_out && before == (push.mode == MODE_SUBTRACT) || push.mode == MODE_REPLACE && !left_out;
        bool inside = asks && is_inside(gaussian, uintBitsToFloat(bound.xyz));
        bool after = push.mode == MODE_REPLACE ? inside : push.mode == MODE_ADD ? before || inside : before && !inside;
        if (after != before) bounds[gaussian].w = with_marks(bound.w, left_out, after);
        if (after) atomicOr(words[lane() / 32], 1u << lane() % 32);
    }
    barrier();
    uint word = workgroup() * (WORKGROUP / 32) + lane();
    if (lane() < WORKGROUP / 32 && 32 * word < push.gaussians) selected[word] = words[lane()];
}
