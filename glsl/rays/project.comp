#version 460
#include "shared/workgroup.glsl"
#include "shared/ballot.glsl"
#include "rays/frame.glsl"
#include "shared/depth.glsl"
#include "shared/harmonics.glsl"
#include "shared/grids.glsl"
#include "shared/rotation.glsl"
#include "portable/blend_splat.glsl"
// One invocation per visible Gaussian: computes its splat and its depth key, and counts the tiles that it may touch.
// Before: gaussian_from_splat from cull_compact; the instance demand is 0. After: all [visible_kept] outputs are set. A
// splat without a tile has the largest depth key.

layout(binding = 0, scalar) readonly buffer Ids { uint gaussian_from_splat[]; };            // [visible_capacity]
layout(binding = 1, scalar) readonly buffer Bounds { uvec4 bounds[]; };                     // [gaussians] mean, reach
layout(binding = 2, scalar) readonly buffer GridsBlock { Grids grids; };
layout(binding = 3, scalar) readonly buffer Shapes { uvec4 plane[]; } shapes[2];            // [gaussians] at most each
layout(binding = 4, scalar) readonly buffer Sh { uvec4 plane[]; } sh[SH_PLANES];            // [gaussians] at most each
layout(binding = 5, scalar) writeonly buffer Splats { RaySplat splats[]; };                 // [visible_capacity]
layout(binding = 6, scalar) writeonly buffer DepthKeys { uint depth_keys[]; };              // [visible_capacity]
layout(binding = 7, scalar) writeonly buffer TileCounts { uint tile_counts[]; };            // [visible_capacity]
layout(binding = 8, scalar) readonly buffer Cones { Cone cones[]; };                        // [cones]
layout(binding = 9, scalar) readonly buffer Footprints { vec3 footprints[]; };              // [(FOOTPRINTS + 1)^2]
layout(binding = 10, scalar) buffer TotalsBlock { Totals totals; };
layout(push_constant, scalar) uniform Push {
    View view;
    uint is_parallel;
    uint cones;
    uint depth_limit;  // the largest depth key, for splats without tiles
    uint depth_shift;  // lowest bits that depth keys leave out
    float half_sine;   // of the last row of footprints
    float large;       // the chord beyond which a subgroup shares a splat
} push;

layout(constant_id = 4) const bool ANTIALIASED = false;  // opacities compensate for the low-pass

const float COMPENSATION_MIN = 0.005;  // lower limit of the factor of an opacity (gsplat)

#include "shared/storage.glsl"
#include "rays/view.glsl"
#include "rays/walk_tiles.glsl"

// The covariance of directions that a pixel covers at a unit direction `rho` from the axis: away from the axis, mixed,
// around it. The table has rows by the sine of half the angle, columns by the place on a square around the axis.
vec3 footprint_at(vec3 n, float rho) {
    float row = min(0.5 * length(vec2(rho, 1.0 - n.z)) / push.half_sine, 1.0) * float(FOOTPRINTS);
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

RaySplat make_splat(uint gaussian, vec3 p) {
    RaySplat splat;
    vec4 rotation;
    vec3 scale;
    load_shape(gaussian, rotation, scale, splat.opacity);
    float unit = unit_of(p);
    bool is_parallel = push.is_parallel == 1;
    vec3 centre = centre_of(p), normal = is_parallel ? vec3(0.0, 0.0, 1.0) : centre;
    // The frame across the direction: away from the axis, and around it.
    float rho = length(normal.xy);
    vec2 azimuth = rho > 0.0 ? normal.xy / rho : vec2(1.0, 0.0);
    vec3 e1 = vec3(normal.z * azimuth, -rho), e2 = vec3(-azimuth.y, azimuth.x, 0.0);
    vec2 px = 1.0 / VIEW.focal_px;
    vec3 low_pass = LOW_PASS * (is_parallel ? vec3(px.x * px.x, 0.0, px.y * px.y) : footprint_at(normal, rho));
    float l11 = low_pass.x, l12 = low_pass.y, l22 = low_pass.z;
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
    vec2 gamma = is_parallel ? vec2(0.0) : vec2(fx * whitened.x, fy * whitened.x + fz * whitened.y);
    vec3 along = m3 - gamma.x * m1 - gamma.y * m2;
    // The variance along the ray that is left, as a sum of squares.
    float kappa = dot(along, along) + gamma.x * gamma.x * l11 + 2.0 * gamma.x * gamma.y * l12 + gamma.y * gamma.y * l22;
    float to_exp2 = sqrt(0.5 * LOG2_E);
    splat.centre = centre;
    splat.u = to_exp2 * (fx * e1 + fy * e2);
    splat.v = to_exp2 * fz * e2;
    splat.q = normal - gamma.x * e1 - gamma.y * e2;
    splat.kappa = is_parallel ? 0.0 : kappa / (0.5 * LOG2_E);
    if (ANTIALIASED) splat.opacity *= sqrt(max(sharp / determinant, COMPENSATION_MIN * COMPENSATION_MIN));
    float deviations = sqrt(max(falloff_limit(splat.opacity), 0.0) / (0.5 * LOG2_E));
    float radius = max(scale.x, max(scale.y, scale.z)) + sqrt(l11 + l22);
    splat.chord = chord_of(1.00001 * deviations * radius);
    return splat;
}

void main() {
    uint index = workgroup() * WORKGROUP + lane();
    bool exists = index < totals.visible_kept;
    uint gaussian = exists ? gaussian_from_splat[index] : 0, tiles = 0;
    vec3 mean = exists ? uintBitsToFloat(bounds[gaussian].xyz) : vec3(0.0);
    vec3 p = view_axes(mean);
    RaySplat splat;
    Reach reach;
    bool is_drawn = false;
    if (exists) {
        splat = make_splat(gaussian, p);
        float limit = falloff_limit(splat.opacity);
        reach = reach_of(splat, limit);
        is_drawn = limit >= 0.0;
        if (is_drawn && !is_large(splat)) WALK_TILES(splat, reach, 0, push.cones, COUNT_TILE)
    }
    uvec4 waiting = subgroupBallot(is_drawn && is_large(splat));
    for (uint w = 0; w < BALLOT_WORDS; w++) {
        for (uint word = waiting[w]; word != 0; word &= word - 1) {
            uint owner = 32 * w + findLSB(word);
            uint all = subgroupAdd(count_part(broadcast_splat(splat, owner), broadcast_reach(reach, owner)));
            if (gl_SubgroupInvocationID == owner) tiles = all;
        }
    }
    uint total;
    workgroup_exclusive_add(tiles, total);
    if (lane() == 0) {
        uint before = atomicAdd(totals.listed_low, total);  // a sum of integers: order does not matter
        if (before + total < before) atomicAdd(totals.listed_high, 1);
    }
    if (!exists) return;
    tile_counts[index] = tiles;
    uint key = floatBitsToUint(far_of(mean)) - floatBitsToUint(VIEW.near);  // positive floats order like their bits
    depth_keys[index] = tiles == 0 ? push.depth_limit : min(key >> push.depth_shift, push.depth_limit - 1);
    if (tiles > 0) {
        uvec4 stored[SH_VECTORS];
        fetch_sh(gaussian, stored);
        splat.colour = stored_colour(stored, to_world(p / length(p)));
        splats[index] = splat;
    }
}
