#version 460
#include "shared/workgroup.glsl"
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
// Footprints of directions: xx, yy, zz and xy, xz, yz of a covariance in view axes.
layout(binding = 9, scalar) readonly buffer Footprints { vec3 footprints[]; };   // [2 (FOOTPRINTS + 1)^2]
layout(binding = 10, scalar) buffer TotalsBlock { Totals totals; };
layout(push_constant, scalar) uniform Push {
    View view;
    uint is_parallel;
    uint cones;
    uint depth_limit;  // the largest depth key, for splats without tiles
    uint depth_shift;  // lowest bits that depth keys leave out
} push;

layout(constant_id = 4) const bool ANTIALIASED = false;  // opacities compensate for the low-pass

const float COMPENSATION_MIN = 0.005;  // lower limit of the factor of an opacity (gsplat)

#include "shared/storage.glsl"
#include "rays/view.glsl"
#include "rays/walk_tiles.glsl"

// The covariance of directions that a pixel covers around a unit direction, as its diagonal and the rest. The table
// is an octahedral map with +z in the middle.
void footprint_at(vec3 n, out vec3 diagonal, out vec3 rest) {
    vec2 at = n.xy / (abs(n.x) + abs(n.y) + abs(n.z));
    if (n.z < 0.0) at = (1.0 - abs(at.yx)) * mix(vec2(-1.0), vec2(1.0), greaterThanEqual(at, vec2(0.0)));
    vec2 cells = (0.5 * at + 0.5) * float(FOOTPRINTS);
    uvec2 cell = uvec2(clamp(cells, vec2(0.0), vec2(float(FOOTPRINTS - 1))));
    vec2 inside = cells - vec2(cell);
    diagonal = rest = vec3(0.0);
    for (uint k = 0; k < 4; k++) {
        uvec2 corner = uvec2(k & 1, k >> 1);
        vec2 part = mix(1.0 - inside, inside, equal(corner, uvec2(1)));
        uint place = 2 * ((cell.y + corner.y) * (FOOTPRINTS + 1) + cell.x + corner.x);
        diagonal += part.x * part.y * footprints[place];
        rest += part.x * part.y * footprints[place + 1];
    }
}

// Two unit vectors across `n` and each other (Duff et al., "Building an Orthonormal Basis, Revisited", 2017).
void frame_at(vec3 n, out vec3 e1, out vec3 e2) {
    float side = n.z < 0.0 ? -1.0 : 1.0;
    float a = -1.0 / (side + n.z), b = n.x * n.y * a;
    e1 = vec3(1.0 + side * n.x * n.x * a, side * b, -side * n.x);
    e2 = vec3(b, side + n.y * n.y * a, -n.y);
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
    vec3 centre = centre_of(p), normal = push.is_parallel == 1 ? vec3(0.0, 0.0, 1.0) : centre, e1, e2, diagonal, rest;
    frame_at(normal, e1, e2);
    if (push.is_parallel == 1) {
        diagonal = vec3(1.0 / (VIEW.focal_px * VIEW.focal_px), 0.0);
        rest = vec3(0.0);
    } else {
        footprint_at(normal, diagonal, rest);
    }
    mat3 footprint = LOW_PASS * mat3(diagonal.x, rest.xy, rest.x, diagonal.y, rest.z, rest.yz, diagonal.z);
    vec3 f1 = footprint * e1;
    float l11 = dot(e1, f1), l12 = dot(e2, f1), l22 = dot(e2, footprint * e2);
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
    vec2 gamma = push.is_parallel == 1 ? vec2(0.0) : vec2(fx * whitened.x, fy * whitened.x + fz * whitened.y);
    vec3 along = m3 - gamma.x * m1 - gamma.y * m2;
    // The variance along the ray that is left, as a sum of squares.
    float kappa = dot(along, along) + gamma.x * gamma.x * l11 + 2.0 * gamma.x * gamma.y * l12 + gamma.y * gamma.y * l22;
    float to_exp2 = sqrt(0.5 * LOG2_E);
    splat.centre = centre;
    splat.u = to_exp2 * (fx * e1 + fy * e2);
    splat.v = to_exp2 * fz * e2;
    splat.q = normal - gamma.x * e1 - gamma.y * e2;
    splat.kappa = push.is_parallel == 1 ? 0.0 : kappa / (0.5 * LOG2_E);
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
    if (exists) {
        splat = make_splat(gaussian, p);
        float limit = falloff_limit(splat.opacity);
        Reach reach = reach_of(splat, limit);
#define COUNT(tile) tiles++;
        if (limit >= 0.0) WALK_TILES(splat, reach, COUNT)
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
