// One invocation makes one splat, its depth key, and the tiles that it touches, as one span per tile row.
// Requires: the bindings and push constants of portable/project.comp, and as macros
//   FIND(visible)    the Gaussian of an element of gaussian_from_splat; it may choose VIEW
//   VIEW, IN_WORLD(depth) and NEAR, as depth_key.glsl says
#include "shared/marks.glsl"
#include "shared/storage.glsl"
#include "shared/projection.glsl"
#include "shared/depth_key.glsl"
#include "shared/spans.glsl"

shared uint first_span;

void main() {
    uint index = workgroup() * WORKGROUP + lane();
    bool exists = index < totals.visible_kept;
    // Lanes without a splat of their own have a view, too: they share the work of large splats.
    uint gaussian = FIND(exists ? gaussian_from_splat[index] : 0);
    vec3 mean = exists ? uintBitsToFloat(bounds[gaussian].xyz) : vec3(0.0);
    precise vec3 p = (mean - VIEW.position_high) - VIEW.position_low;

    Splat splat;
    Ellipse ellipse = EMPTY_ELLIPSE;
    float z = max(depth_of(mean, VIEW), VIEW.near);
    if (exists) project(gaussian, p, z, splat, ellipse);
    uvec2 rows = tile_rows(ellipse, VIEW);  // first, count

    uint total;
    uint offset = workgroup_exclusive_add(rows.y, total);
    if (lane() == 0) {
        first_span = atomicAdd(totals.spans, total);  // any order is right: spans are found through their range
        // More than 2^32 spans have at least as many instances, so the frame is refused in the same way.
        if (first_span + total < first_span) atomicAdd(totals.listed_high, 1);
    }
    barrier();
    offset += first_span;
    bool fits = offset <= push.span_capacity && rows.y <= push.span_capacity - offset;
    if (!fits) rows.y = 0;

    uint tiles = write_spans(ellipse, rows, offset);
    workgroup_exclusive_add(tiles, total);
    if (lane() == 0) {
        uint before = atomicAdd(totals.listed_low, total);  // a sum of integers: order does not matter
        if (before + total < before) atomicAdd(totals.listed_high, 1);
    }
    if (!exists) return;
    span_ranges[index] = tiles == 0 ? uvec2(0) : uvec2(offset, drawn_row(rows.x, VIEW) | rows.y << 16);
    tile_counts[index] = tiles;
    depth_keys[index] = tiles == 0 ? push.depth_limit : min(depth_key(mean, z), push.depth_limit - 1);
    if (tiles > 0) {
        uvec4 stored[SH_VECTORS];
        fetch_sh(gaussian, stored);
        splat.colour = marked_colour(bounds[gaussian].w, stored_colour(stored, direction(p)));
        splats[index] = splat;
    }
}
