#version 460
#include "shared/workgroup.glsl"
#include "fast/frame.glsl"
#include "pages/page.glsl"
#include "lod/selection.glsl"
// One invocation per page and placed view of its scene: tests whether the page may have splats in the image, counts its
// samples in the image, and computes the width of a pixel at its group.
// Before: the draw list has the views, the state is 0; if a picture hides groups, `stop_depths` and `stop_views` are
// its stop depths and views. After: `in_view` has the pages in view, in any order: sums are of whole numbers, and
// splats are sorted.

layout(binding = 0, scalar) readonly buffer Boxes { PageBox boxes[]; };                     // [pages]
layout(binding = 1, scalar) readonly buffer Errors { PageErrors errors[]; };                // [pages]
layout(binding = 2, scalar) readonly buffer DrawList { uvec4 draw_list[]; };                // [VIEW_ELEMENTS * views]
layout(binding = 3, scalar) writeonly buffer InView { uvec4 in_view[]; };                   // [capacity]
layout(binding = 4, scalar) buffer State { SelectionState state; };
layout(binding = 5, scalar) readonly buffer StopDepths { float stop_depths[]; };            // [bins * (BLOCKS + 1)]
layout(binding = 6, scalar) readonly buffer StopViews { uvec4 stop_views[]; };              // [VIEW_ELEMENTS * views]
layout(push_constant, scalar) uniform Push {
    vec2 focal_px;
    vec2 centre_px;
    uvec2 size_px;
    uint band;  // rows that are drawn: View.band
    float per_focal_squared;  // 1 / the larger focal length^2
    uint pages;
    uint views;  // the most of a page
    uint capacity;  // of `in_view`
    Occlusion occlusion;
} push;

PlacedView view;

#include "lod/hidden.glsl"

// A point in the axes of the view. `precise`: every device rounds alike all values on which the limit depends.
vec3 to_view(vec3 point) {
    precise vec3 p = (point - view.position_high) - view.position_low;
    precise vec3 seen;
    seen.x = (view.right.x * p.x + view.right.y * p.y) + view.right.z * p.z;
    seen.y = (view.down.x * p.x + view.down.y * p.y) + view.down.z * p.z;
    seen.z = (view.forward.x * p.x + view.forward.y * p.y) + view.forward.z * p.z;
    return seen;
}

// The squared factor of an error limit for the nodes of a page: the width of a pixel at the nearest point of their
// group's box, and more where pixels are wider than the reference width, since errors decrease there, or where the
// group is hidden.
float width_squared(uint page) {
    PageBox box = boxes[page];
    precise vec3 below = (box.lod_low - view.position_high) - view.position_low;
    precise vec3 above = (view.position_high - box.lod_high) + view.position_low;
    precise vec3 d = max(max(below, above), 0.0);
    precise float distance = max((d.x * d.x + d.y * d.y) + d.z * d.z, view.near * view.near);
    precise float px = distance * push.per_focal_squared;
    precise float width = px * max(px * box.per_width_squared, 1.0);
    precise float of_hidden = width * push.occlusion.factor_squared;
    return push.occlusion.factor_squared > 1.0 && is_hidden(box) ? of_hidden : width;
}

// The number of samples of a page in the image.
uint samples_in_image(uint page, PageBox box) {
    precise vec3 cell = (box.high - box.low) * (1.0 / 1024.0);
    uint found = 0;
    for (uint i = 0; i < SAMPLES; i++) {
        uint place = errors[page].samples[i];
        precise vec3 point = box.low + (vec3(place & 1023, place >> 10 & 1023, place >> 20) + 0.5) * cell;
        vec3 p = to_view(point);
        precise vec2 from = push.focal_px * p.xy + push.centre_px * p.z;
        precise vec2 to = vec2(push.size_px) * p.z;
        found += uint(p.z > view.near && all(greaterThanEqual(from, vec2(0.0))) && all(lessThanEqual(from, to)));
    }
    return found;
}

// True if a splat of the page may touch the image; `is_drawn`: its drawn rows. A bound: the cull test (cull_test.glsl)
// with the extremes of the box, as in PageCuller::page for whole bins, with slack for the rounding of f32.
bool may_be_seen(PageBox box, out bool is_drawn) {
    is_drawn = false;
    if (box.reach < 0.0) return false;
    vec3 half_size = 0.5 * (box.high - box.low);
    vec3 centre = to_view(box.low + half_size);
    vec3 magnitude = abs(view.position_high) + abs(box.low) + abs(box.high);
    float slack = 1e-6 * (magnitude.x + magnitude.y + magnitude.z);
    vec3 reach = vec3(dot(abs(view.right), half_size), dot(abs(view.down), half_size),
        dot(abs(view.forward), half_size)) + slack;
    vec3 low = centre - reach, high = centre + reach;
    if (high.z < view.near) return false;
    float nearest = max(low.z, view.near), farthest = max(high.z, view.near);
    vec2 least = min(low.xy / nearest, low.xy / farthest), most = max(high.xy / nearest, high.xy / farthest);
    vec2 size = vec2(push.size_px);
    vec2 first = (-push.centre_px - 0.15 * size) / push.focal_px;
    vec2 last = (size - push.centre_px + 0.15 * size) / push.focal_px;
    vec2 steepest = max(abs(clamp(least, first, last)), abs(clamp(most, first, last)));
    vec2 extent = push.focal_px / nearest * sqrt(1.0 + steepest * steepest) * box.reach * 1.01 + box.margin_px;
    vec2 from = push.focal_px * least + push.centre_px, to = push.focal_px * most + push.centre_px;
    vec2 more = extent + 1e-5 * (extent + max(abs(from), abs(to)) + push.focal_px) + 1.0;
    vec2 rows = vec2(rows_of(push.band));
    // Comparisons are also false for NaN: the page then counts as visible.
    is_drawn = !(to.y + more.y < rows.x || from.y - more.y > rows.y);
    return !(any(lessThan(to + more, vec2(0.0))) || any(greaterThan(from - more, size)));
}

void main() {
    uint number = workgroup() * WORKGROUP + lane();
    uint page = number % push.pages, placement = number / push.pages;
    if (placement >= push.views) return;
    PageBox box = boxes[page];
    if (placement >= uint(box.views)) return;
    uint number_of_view = uint(box.first_view) + placement, first = number_of_view * VIEW_ELEMENTS;
    view = PLACED_VIEW(draw_list, first);
    if (push.occlusion.factor_squared > 1.0) stop_view = PLACED_VIEW(stop_views, first);
    bool is_drawn;
    if (!may_be_seen(box, is_drawn)) return;
    uint parent = errors[page].parent;
    vec2 widths = vec2(width_squared(page), parent == NO_PAGE ? 0.0 : width_squared(parent));
    // Samples may miss a page that is small in the image; with weight 0, the coarsest level would be free of error.
    uint weight = max(samples_in_image(page, box), 1);
    uint before = atomicAdd(state.in_view, 1);
    if (before < push.capacity) in_view[before] = packed(PageInView(page, is_drawn, number_of_view, weight, widths));
}
