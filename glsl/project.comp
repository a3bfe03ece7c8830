#version 460
#include "workgroup.glsl"
#include "ballot.glsl"
#include "frame.glsl"
#include "depth.glsl"
#include "harmonics.glsl"
#include "ellipse.glsl"
#include "grids.glsl"
#include "rotation.glsl"
// One invocation per visible Gaussian: its splat, its depth key, and the tiles it touches, as one span per tile row.
// Before: gaussian_from_splat from cull_compact; totals.spans and the instance demand are 0.
// After: all [visible_kept] outputs are set. A splat without a tile has an empty span range and the largest depth key.
// What a span says is what duplicate emits: no later stage decides a tile hit again.

layout(constant_id = 3) const bool BY_DISTANCE = false;   // depth keys are distances from the camera
layout(constant_id = 4) const bool ANTIALIASED = false;   // opacities make up for the low-pass

layout(binding = 0, scalar) readonly buffer Ids { uint gaussian_from_splat[]; };            // [visible_capacity]
layout(binding = 1, scalar) readonly buffer Bounds { uvec4 bounds[]; };                     // [gaussians] mean, reach
layout(binding = 2, scalar) readonly buffer GridsBlock { Grids grids; };
layout(binding = 3, scalar) readonly buffer Shapes { uvec4 plane[]; } shapes[2];            // [gaussians] at most each
layout(binding = 4, scalar) readonly buffer Sh { uvec4 plane[]; } sh[SH_PLANES];            // [gaussians] at most each
layout(binding = 5, scalar) writeonly buffer Splats { Splat splats[]; };                    // [visible_capacity]
layout(binding = 6, scalar) writeonly buffer DepthKeys { uint depth_keys[]; };              // [visible_capacity]
layout(binding = 7, scalar) writeonly buffer SpanRanges { uvec2 span_ranges[]; };           // [visible_capacity] first, rows
layout(binding = 8, scalar) writeonly buffer TileCounts { uint tile_counts[]; };            // [visible_capacity]
layout(binding = 9, scalar) writeonly buffer Spans { uint spans[]; };                       // [span_capacity]
layout(binding = 10, scalar) buffer TotalsBlock { Totals totals; };
layout(push_constant, scalar) uniform Push {
    View view;
    uint span_capacity;
    uint depth_limit;  // the largest depth key, for splats without tiles
    uint depth_shift;  // bits that depth keys leave out
} push;

#include "storage.glsl"

const float COMPENSATION_MIN = 0.005;  // the least part of an opacity that is left (gsplat)
const uint ROWS_ALONE = 4;  // a splat with more tile rows is shared by its subgroup

shared uint first_span;

// The 2D covariance V V^T + low_pass I as (a, b, c) = (xx, xy, yy), and its determinant, where V (2x3) = J W R S.
// The determinant is a sum of squares of the minors of V (Cauchy-Binet), so that no needle loses it to cancellation.
// `sharp_part`: the determinant without the low-pass, over it.
vec4 covariance_of(vec3 v0, vec3 v1, float low_pass, out float sharp_part) {
    vec3 minors = cross(v0, v1);
    vec3 abc = vec3(dot(v0, v0), dot(v0, v1), dot(v1, v1));
    float sharp = dot(minors, minors);
    float determinant = sharp + low_pass * (abc.x + abc.z) + low_pass * low_pass;
    sharp_part = sharp / determinant;
    return vec4(abc.x + low_pass, abc.y, abc.z + low_pass, determinant);
}

// The unit vector along `p`, whose length may have a square beyond the floats.
vec3 direction(vec3 p) {
    vec3 size = abs(p);
    return normalize(p / max(size.x, max(size.y, size.z)));
}

// Projects one Gaussian: the splat without its colour, its ellipse, and the depth.
void project(uint gaussian, vec3 mean, vec3 p, out Splat splat, out Ellipse ellipse, out float z) {
    vec4 rotation;
    vec3 scale;
    load_shape(gaussian, rotation, scale, splat.opacity);
    z = max(depth_of(mean, push.view), push.view.near);
    vec2 slope = vec2(dot(push.view.right, p), dot(push.view.down, p)) / z;
    vec2 size = vec2(push.view.size_px);
    // The Jacobian's slope is clamped 15 % of the image beyond each edge (the original's 1.3 tan(fov/2)).
    vec2 low = (-push.view.centre_px - 0.15 * size) / push.view.focal_px;
    vec2 high = (size - push.view.centre_px + 0.15 * size) / push.view.focal_px;
    vec2 clamped = clamp(slope, low, high);
    vec2 px_per_world = push.view.focal_px / z;
    mat3 to_world = rotation_matrix(rotation);
    float stretch = max(px_per_world.x, px_per_world.y) * sqrt(1.0 + dot(clamped, clamped));
    // Past 1e16 px a longer axis changes no weight on the image.
    scale = min(scale, 1e16 / stretch);
    // The unit in which the axes are measured, so that no fourth power of one overflows.
    float unit_px = max(1.0, 1e-8 * stretch * max(scale.x, max(scale.y, scale.z)));
    vec2 per_world = px_per_world / unit_px;
    vec3 v0 = per_world.x * ((push.view.right - clamped.x * push.view.forward) * to_world) * scale;
    vec3 v1 = per_world.y * ((push.view.down - clamped.y * push.view.forward) * to_world) * scale;
    float sharp_part;
    vec4 covariance = covariance_of(v0, v1, LOW_PASS / unit_px / unit_px, sharp_part);
    float a = covariance.x, b = covariance.y, c = covariance.z, determinant = covariance.w;

    float to_exp2 = sqrt(0.5 * LOG2_E) / unit_px;
    splat.mean_px = push.view.focal_px * slope + push.view.centre_px;
    splat.factor.x = to_exp2 * sqrt(c / determinant);
    splat.factor.y = -to_exp2 * (b / sqrt(c)) / sqrt(determinant);  // c * determinant overflows
    splat.factor.z = to_exp2 / sqrt(c);
    if (ANTIALIASED) splat.opacity *= sqrt(max(sharp_part, COMPENSATION_MIN * COMPENSATION_MIN));
    ellipse = ellipse_of(splat.mean_px, covariance, unit_px, splat.opacity);
}

void main() {
    uint index = workgroup() * WORKGROUP + lane();
    bool exists = index < totals.visible_kept;
    uint gaussian = exists ? gaussian_from_splat[index] : 0;
    vec3 mean = exists ? uintBitsToFloat(bounds[gaussian].xyz) : vec3(0.0);
    precise vec3 p = (mean - push.view.position_high) - push.view.position_low;

    Splat splat;
    Ellipse ellipse = EMPTY_ELLIPSE;
    float z = push.view.near;
    if (exists) project(gaussian, mean, p, splat, ellipse, z);
    uvec2 rows = tile_rows(ellipse, push.view.size_px);  // first, count

    uint total;
    uint offset = workgroup_exclusive_add(rows.y, total);
    if (lane() == 0) {
        first_span = atomicAdd(totals.spans, total);  // any order: spans are found through their range
        // Over 2^32 spans are at least as many instances: refused like those.
        if (first_span + total < first_span) atomicAdd(totals.instances_high, 1);
    }
    barrier();
    offset += first_span;
    bool fits = offset <= push.span_capacity && rows.y <= push.span_capacity - offset;
    if (!fits) rows.y = 0;

    uint tiles = 0;
    bool shared_work = rows.y > ROWS_ALONE;
    if (!shared_work) {
        for (uint row = 0; row < rows.y; row++) {
            uint span = tile_span(ellipse, rows.x + row, push.view.size_px);
            spans[offset + row] = span;
            tiles += span_length(span);
        }
    }
    uvec4 waiting = subgroupBallot(shared_work);
    for (uint w = 0; w < BALLOT_WORDS; w++) {
        for (uint word = waiting[w]; word != 0; word &= word - 1) {
            uint owner = 32 * w + findLSB(word);
            Ellipse theirs = broadcast_ellipse(ellipse, owner);
            uvec2 their_rows = subgroupBroadcast(rows, owner);
            uint their_offset = subgroupBroadcast(offset, owner);
            uint sum = 0;
            for (uint row = gl_SubgroupInvocationID; row < their_rows.y; row += gl_SubgroupSize) {
                uint span = tile_span(theirs, their_rows.x + row, push.view.size_px);
                spans[their_offset + row] = span;
                sum += span_length(span);
            }
            sum = subgroupAdd(sum);
            if (gl_SubgroupInvocationID == owner) tiles = sum;
        }
    }

    workgroup_exclusive_add(tiles, total);
    if (lane() == 0) {
        uint before = atomicAdd(totals.instances_low, total);  // a sum of integers: order does not matter
        if (before + total < before) atomicAdd(totals.instances_high, 1);
    }
    if (!exists) return;
    span_ranges[index] = tiles == 0 ? uvec2(0) : uvec2(offset, rows.x | rows.y << 16);
    tile_counts[index] = tiles;
    float far = BY_DISTANCE && tiles > 0 ? distance_of(mean, push.view) : z;
    uint depth = floatBitsToUint(far) - floatBitsToUint(push.view.near);  // positive floats order like their bits
    depth_keys[index] = tiles == 0 ? push.depth_limit : min(depth >> push.depth_shift, push.depth_limit - 1);
    if (tiles > 0) {
        vec4 planes[SH_PLANES];
        load_sh(gaussian, planes);
        splat.colour = harmonics_colour(planes, SH_DEGREE, direction(p));
        splats[index] = splat;
    }
}
