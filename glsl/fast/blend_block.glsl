#include "shared/workgroup.glsl"
#extension GL_EXT_control_flow_attributes : require
#include "fast/frame.glsl"
#include "shared/rules.glsl"
#include "shared/blend_rules.glsl"
#include "fast/transmittance.glsl"
// The blend of a block of pixels by one subgroup, front to back, over the list of its bin.
// Requires: WORKGROUP_SIZE, BLOCK_HEIGHT, HAS_RING
// A lane has several pixels of one column. What a splat weighs at a pixel is in fast/exponents.glsl, or, with RAYS, in
// fast_rays/exponents.glsl.

#include "fast/subgroup_owner.glsl"
layout(constant_id = 12) const bool HAS_CLAMPED_ALPHAS = true;  // some opacity is above ALPHA_MAX

layout(binding = 0, scalar) readonly buffer Bins { Bin bins[]; };                           // [bins]
layout(binding = 1, scalar) readonly buffer BinOrder { uint bin_order[]; };                 // [bins]
layout(binding = 2, scalar) readonly buffer SplatIds { uint splat_ids[]; };                 // [entry_capacity]
layout(binding = 3, scalar) readonly buffer Splats { uvec4 splats[]; };              // [SPLAT_WORDS * visible_capacity]
layout(binding = 4, scalar) readonly buffer Masks { uint masks[]; };                        // [segments * BLOCKS * 32]
#ifndef IMAGE_ACCESS
#define IMAGE_ACCESS writeonly
#endif
layout(binding = 5, rgba32f) IMAGE_ACCESS uniform image2D image;
#ifdef RAYS
layout(binding = 6, scalar) readonly buffer Rays { vec3 rays[]; };                          // [pixels] 0 if none
const bool HAS_STOP_KEYS = false;
#else
layout(constant_id = 15) const bool HAS_STOP_KEYS = false;
layout(binding = 7, scalar) readonly buffer DepthKeys { uint depth_keys[]; };               // [visible_capacity]
layout(binding = 8, scalar) writeonly buffer StopKeys { uint stop_keys[]; };                // [bins * BLOCKS]
#endif
layout(push_constant, scalar) uniform Push {
    uvec2 size_px;
    uint bins_x;
    uint bins;
    vec3 background;
#ifdef RAYS
    uint is_parallel;
#else
    uint top_px;  // row of the picture that is the first of the image
#endif
} push;

// The exp2 of the largest exponent. An alpha of 1 is lowered by less than it is rounded: it must not make a
// transmittance negative.
#define LARGEST_WEIGHT (min(ALPHA_MAX, 1.0 - 5e-7) / UNIT)

const uvec2 BLOCK = uvec2(BLOCK_WIDTH, BLOCK_HEIGHT);
const uint BLOCK_PIXELS = BLOCK_WIDTH * BLOCK_HEIGHT;
const uint PIXELS = BLOCK_PIXELS / SUBGROUP;  // pixels of a lane, in one column
const uint ROWS = SUBGROUP / BLOCK_WIDTH;     // rows from one of these pixels to the next
// Splats whose alphas are computed before the first of them is blended. With one pixel per lane there are more, so that
// a lane has enough independent work.
const uint AT_ONCE = PIXELS == 1 ? 8 : 4;

#include "fast/block_walk.glsl"

#ifdef RAYS
#include "fast_rays/exponents.glsl"
#else
#include "fast/exponents.glsl"
#endif

// The state of this lane's pixels of a block.
uvec2 pixel;             // px of the image, the first pixel of the lane
// A pixel that goes on has the transmittance `live` and stops when that falls below `limit`. A pixel that has stopped
// has `live` = 0 and `limit` < 0, and its transmittance is `last`. All three are multiplied by UNIT, so that alpha
// times T is exp2(exponent) times `live`.
float live[PIXELS], limit[PIXELS], last[PIXELS];
vec3 colour[PIXELS];
uint stopped_at;  // with HAS_STOP_KEYS: the staged splat of a batch at which a pixel of this lane stopped last

// A pixel whose transmittance is below this takes no more splats.
float last_transmittance() {
    return max(TRANSMITTANCE_MIN, STOP);
}

// Starts a pixel with this transmittance. With 0 it takes no splat.
void begin_pixel(uint k, float transmittance) {
    live[k] = last[k] = UNIT * transmittance;
    limit[k] = transmittance > 0.0 ? UNIT * last_transmittance() : -1.0;
    colour[k] = vec3(0.0);
}

// Blends the staged splats from `first` up to `behind`, which have this form.
void blend_staged(uint first, uint behind, uint form) {
    for (uint i = first; i < behind; i += AT_ONCE) {
        float weights[AT_ONCE][PIXELS];  // exp2(exponent), then alpha T
        vec3 colours[AT_ONCE];
        [[unroll]] for (uint j = 0; j < AT_ONCE; j++) {
            Curve curve = staged_curve(i + j, form);
            colours[j] = curve.colour;
            [[unroll]] for (uint k = 0; k < PIXELS; k++) {
                float exponent = exponent_at(curve, k, form);
                float weight = FLUSHES || exponent >= 0.0 ? exp2(exponent) : 0.0;
                if (HAS_CLAMPED_ALPHAS) weight = min(LARGEST_WEIGHT, weight);
                weights[j][k] = weight;
            }
        }
        // Transmittances are computed as if no pixel stopped, which is seldom wrong. Where one does stop, the
        // splats that it does not take are removed, one by one: the picture does not depend on how many there are
        // at once.
        float before[PIXELS];
        bool ends = false;
        [[unroll]] for (uint k = 0; k < PIXELS; k++) {
            before[k] = live[k];
            [[unroll]] for (uint j = 0; j < AT_ONCE; j++) {
                weights[j][k] *= live[k];
                live[k] = fma(-UNIT, weights[j][k], live[k]);
            }
            ends = ends || live[k] < limit[k];
        }
        if (subgroupAny(ends)) {
            [[unroll]] for (uint k = 0; k < PIXELS; k++) {
                if (live[k] < limit[k]) {
                    float left = last[k] = before[k];
                    [[unroll]] for (uint j = 0; j < AT_ONCE; j++) {
                        float after = fma(-UNIT, weights[j][k], left);
                        if (HAS_STOP_KEYS && left >= limit[k]) stopped_at = max(stopped_at, i + j);
                        bool added = left >= limit[k] && after >= UNIT * TRANSMITTANCE_MIN;
                        weights[j][k] = added ? weights[j][k] : 0.0;
                        last[k] = added ? after : last[k];
                        left = after;
                    }
                    live[k] = 0.0;
                    limit[k] = -1.0;
                }
            }
        }
        [[unroll]] for (uint j = 0; j < AT_ONCE; j++) {
            [[unroll]] for (uint k = 0; k < PIXELS; k++) {
                colour[k] = fma(colours[j], vec3(weights[j][k]), colour[k]);
            }
        }
    }
}

// Blends the entries that reach the block, until all pixels have stopped. With HAS_STOP_KEYS, returns the depth key of
// the splat at which the last of them stopped, or NOT_STOPPED. Before: a pixel has not stopped.
uint blend_entries(Bin bin, uint block) {
    bool is_open = true;
    Walk walk = begin_walk(bin, block);
    // Splats are loaded one batch ahead and their ids two, so that the loads run while a batch is blended.
    uint entry;
    uint count = take(walk, bin, block, entry);
    uint splat = gl_SubgroupInvocationID < count ? splat_ids[bin.first + entry] : 0;
    Record record = NO_RECORD;
    if (gl_SubgroupInvocationID < count) record = load_record(splat);
    uint count_ahead = take(walk, bin, block, entry);
    uint staged, next = splat;  // with HAS_STOP_KEYS: the splats that are blended, and those after them
    if (gl_SubgroupInvocationID < count_ahead) splat = splat_ids[bin.first + entry];
    while (count > 0) {
        staged = next;
        next = splat;
        stopped_at = 0;
        subgroupBarrier();
        uint form = stage(record, gl_SubgroupInvocationID < count);
        subgroupBarrier();
        uint first = gl_SubgroupID * SUBGROUP, behind = first + count;
        count = count_ahead;
        if (gl_SubgroupInvocationID < count) record = load_record(splat);
        count_ahead = take(walk, bin, block, entry);
        if (gl_SubgroupInvocationID < count_ahead) splat = splat_ids[bin.first + entry];
        if (FORMS == 1 || form == 0) {
            blend_staged(first, behind, 0);
        } else {
            blend_staged(first, behind, 1);
        }
        bool goes_on = false;
        for (uint k = 0; k < PIXELS; k++) goes_on = goes_on || live[k] > 0.0;
        is_open = subgroupAny(goes_on);
        if (!is_open) break;
    }
#ifndef RAYS
    if (HAS_STOP_KEYS && !is_open) return depth_keys[subgroupShuffle(staged, subgroupMax(stopped_at) % SUBGROUP)];
#endif
    return NOT_STOPPED;
}

float final_transmittance(uint k) {
    return transmittance_of(limit[k] < 0.0 ? last[k] : live[k]);
}

bool is_inside(uint k) {
    return all(lessThan(pixel + uvec2(0, k * ROWS), push.size_px));
}

void show(uint k, vec3 colour, float transmittance) {
    vec3 shown = fma(vec3(transmittance), push.background, colour);
    if (is_inside(k)) imageStore(image, ivec2(pixel + uvec2(0, k * ROWS)), vec4(shown, 1.0 - transmittance));
}

// Finds this lane's pixels of a block of a bin. Returns true if the block meets the image.
bool begin_block(uint bin_number, uint block) {
    uvec2 bin_place = uvec2(bin_number % push.bins_x, bin_number / push.bins_x);
    uvec2 corner = BLOCK * (uvec2(BIN_COLUMNS, BIN_ROWS) * bin_place + uvec2(block % BIN_COLUMNS, block / BIN_COLUMNS));
    uvec2 lane_place = uvec2(gl_SubgroupInvocationID % BLOCK_WIDTH, gl_SubgroupInvocationID / BLOCK_WIDTH);
    pixel = corner + lane_place;
    place_pixels(corner, lane_place);
    return all(lessThan(corner, push.size_px));
}
