#version 460
#include "workgroup.glsl"
#extension GL_KHR_shader_subgroup_shuffle : require
#include "frame.glsl"
#include "rules.glsl"
#include "bin_splat.glsl"
// One subgroup per block of 8x8 pixels: blends what reaches it front to back, and leaves when all its pixels are opaque.
// Before: bins, sorted splat_ids and masks. After: image = (colour over the background, 1 - T).
// No subgroup waits for another. A lane has several pixels of one column; the exponent of a splat is a polynomial around
// the middle of the block (the idea of Local-GS), two fused multiply-adds a pixel.

layout(constant_id = 6) const uint SUBGROUP = 32;
layout(constant_id = 18) const float ALPHA_MAX = 0.99;
layout(constant_id = 19) const float TRANSMITTANCE_MIN = 1e-4;  // the splat that would take T below is not added
layout(constant_id = 20) const float STOP = 0.0;                // a pixel is finished once T is below

layout(binding = 0, scalar) readonly buffer Bins { Bin bins[]; };                           // [bins]
layout(binding = 1, scalar) readonly buffer BinOrder { uint bin_order[]; };                 // [bins]
layout(binding = 2, scalar) readonly buffer SplatIds { uint splat_ids[]; };                 // [entry_capacity]
layout(binding = 3, scalar) readonly buffer Splats { uvec4 splats[]; };                     // [visible_capacity] of 2 or 3
layout(binding = 4, scalar) readonly buffer Masks { uint masks[]; };                        // [stretches * BLOCKS * 32]
layout(binding = 5, rgba32f) writeonly uniform image2D image;
layout(push_constant, scalar) uniform Push {
    uvec2 size_px;
    uint bins_x;
    uint bins;
    vec3 background;
} push;

const uint PIXELS = BLOCK * BLOCK / SUBGROUP;  // of a lane, one below the other
const uint ROWS = SUBGROUP / BLOCK;            // of pixels between them
const float NEVER = 1e38;                      // an exponent that no splat reaches

// Of the entries that are blended next: exponent = a.x + x (a.y + x a.w) + y (a.z + x b.x + y b.y).
shared vec4 staged_a[WORKGROUP];
shared vec4 staged_b[WORKGROUP];  // and red, green
shared float staged_blue[WORKGROUP];

// The walk through a block's mask, the same in all lanes but `word` and `before`.
struct Walk {
    uint next;    // word of masks that is loaded next, by this lane
    uint left;    // words of the mask that are not loaded yet
    uint begin;   // entry of the first bit of the words at hand
    uint word;    // this lane's
    uint ahead;   // and its next
    uint before;  // bits set in the words of the lanes before
    uint total;   // in those of all lanes
    uint taken;   // of them
};

uint load_word(uint index, bool exists) {
    return exists ? masks[index] : 0;
}

// Index of the n-th set bit of `word`, which has more.
uint nth_bit(uint word, uint n) {
    uint place = 0;
    for (uint width = 16; width > 0; width /= 2) {
        uint below = bitCount(bitfieldExtract(word, int(place), int(width)));
        if (n >= below) {
            n -= below;
            place += width;
        }
    }
    return place;
}

// An element of a bin's masks lies in stretches of 32 words, one such row per block.
uint mask_index(Bin bin, uint block, uint word) {
    return ((bin.first_stretch + word / 32) * BLOCKS + block) * 32 + word % 32;
}

// Entries that are taken next, one a lane: how many, and this lane's.
uint take(inout Walk walk, Bin bin, uint block, out uint entry) {
    uint words = (bin.count + 31) / 32;
    while (walk.taken >= walk.total && walk.next < words + SUBGROUP) {
        walk.word = walk.ahead;
        walk.begin = 32 * (walk.next - SUBGROUP);
        uint mine = walk.next + gl_SubgroupInvocationID;
        walk.ahead = mine < words ? masks[mask_index(bin, block, mine)] : 0;
        walk.next += SUBGROUP;
        uint bits = bitCount(walk.word);
        walk.before = subgroupExclusiveAdd(bits);
        walk.total = subgroupAdd(bits);
        walk.taken = 0;
    }
    uint count = min(walk.total - walk.taken, SUBGROUP);
    uint index = walk.taken + gl_SubgroupInvocationID;
    walk.taken += count;
    uint owner = 0;
    for (uint step = SUBGROUP / 2; step > 0; step /= 2) {
        if (subgroupShuffle(walk.before, owner + step) <= index) owner += step;
    }
    uint place = nth_bit(subgroupShuffle(walk.word, owner), index - subgroupShuffle(walk.before, owner));
    entry = walk.begin + 32 * owner + place;
    return count;
}

struct Record {
    vec4 a;
    vec4 b;
    float blue;
};

Record load_record(uint splat) {
    Record record;
    record.a = uintBitsToFloat(splats[splat * SPLAT_WORDS]);
    uvec4 b = splats[splat * SPLAT_WORDS + 1];
    if (COMPACT) {
        record.b = vec4(uintBitsToFloat(b.xy), unpackHalf2x16(b.z));
        record.blue = unpackHalf2x16(b.w).x;
    } else {
        record.b = uintBitsToFloat(b);
        record.blue = uintBitsToFloat(splats[splat * SPLAT_WORDS + 2].x);
    }
    return record;
}

// Leaves the polynomial of a splat around `middle` where all lanes find it.
void stage(Record record, vec2 middle) {
    vec2 d = middle - record.a.xy;
    vec3 factor = vec3(record.a.zw, record.b.x);
    precise float u = fma(factor.x, d.x, factor.y * d.y);
    precise float v = factor.z * d.y;
    precise float at_middle = record.b.y - fma(u, u, v * v);
    uint place = gl_SubgroupID * SUBGROUP + gl_SubgroupInvocationID;
    staged_a[place] =
        vec4(at_middle, -2.0 * factor.x * u, -2.0 * (factor.y * u + factor.z * v), -factor.x * factor.x);
    staged_b[place] = vec4(
        -2.0 * factor.x * factor.y, -(factor.y * factor.y + factor.z * factor.z), record.b.zw);
    staged_blue[place] = record.blue;
}

void main() {
    uint place = workgroup() * gl_NumSubgroups + gl_SubgroupID;
    if (place >= push.bins * BLOCKS) return;
    uint number = bin_order[place / BLOCKS], block = place % BLOCKS;
    uvec2 corner = uvec2(number % push.bins_x, number / push.bins_x) * BIN
        + uvec2(block % (BIN.x / BLOCK), block / (BIN.x / BLOCK)) * BLOCK;
    if (any(greaterThanEqual(corner, push.size_px))) return;
    Bin bin = bins[number];
    uint lane_of = gl_SubgroupInvocationID;
    uvec2 pixel = corner + uvec2(lane_of % BLOCK, lane_of / BLOCK);
    vec2 middle = vec2(corner) + 0.5 * float(BLOCK);
    float x = float(lane_of % BLOCK) + 0.5 - 0.5 * float(BLOCK);
    float y[PIXELS], transmittance[PIXELS], threshold[PIXELS];
    vec3 colour[PIXELS];
    for (uint k = 0; k < PIXELS; k++) {
        y[k] = float(lane_of / BLOCK + k * ROWS) + 0.5 - 0.5 * float(BLOCK);
        transmittance[k] = 1.0;
        colour[k] = vec3(0.0);
        bool inside = all(lessThan(pixel + uvec2(0, k * ROWS), push.size_px));
        threshold[k] = inside ? log2(ALPHA_MIN) : NEVER;
    }

    Walk walk;
    walk.total = walk.taken = walk.before = walk.word = walk.begin = 0;
    walk.next = SUBGROUP;
    walk.ahead = 32 * lane_of < bin.count ? masks[mask_index(bin, block, lane_of)] : 0;
    // Loaded a batch ahead, and its id two: the loads run while the batch before is blended.
    uint entry;
    uint count = take(walk, bin, block, entry);
    uint splat = lane_of < count ? splat_ids[bin.first + entry] : 0;
    Record record;
    if (lane_of < count) record = load_record(splat);
    uint count_ahead = take(walk, bin, block, entry);
    if (lane_of < count_ahead) splat = splat_ids[bin.first + entry];
    while (count > 0) {
        subgroupMemoryBarrierShared();
        subgroupBarrier();
        if (lane_of < count) stage(record, middle);
        subgroupMemoryBarrierShared();
        subgroupBarrier();
        uint here = count;
        count = count_ahead;
        if (lane_of < count) record = load_record(splat);
        count_ahead = take(walk, bin, block, entry);
        if (lane_of < count_ahead) splat = splat_ids[bin.first + entry];
        for (uint i = gl_SubgroupID * SUBGROUP; i < gl_SubgroupID * SUBGROUP + here; i++) {
            vec4 a = staged_a[i], b = staged_b[i];
            float blue = staged_blue[i];
            float on_axis = fma(x, fma(a.w, x, a.y), a.x), slope = fma(b.x, x, a.z);
            for (uint k = 0; k < PIXELS; k++) {
                float exponent = fma(y[k], fma(b.y, y[k], slope), on_axis);
                float alpha = min(ALPHA_MAX, exp2(exponent));
                float rest = fma(-alpha, transmittance[k], transmittance[k]);
                // Positive phrasing: what is not a number is not drawn.
                bool drawn = exponent >= threshold[k];
                if (drawn && rest < max(STOP, TRANSMITTANCE_MIN)) threshold[k] = NEVER;
                if (drawn && rest >= TRANSMITTANCE_MIN) {
                    colour[k] = fma(vec3(b.zw, blue), vec3(alpha * transmittance[k]), colour[k]);
                    transmittance[k] = rest;
                }
            }
        }
        bool goes_on = false;
        for (uint k = 0; k < PIXELS; k++) goes_on = goes_on || threshold[k] < NEVER;
        if (!subgroupAny(goes_on)) break;
    }
    for (uint k = 0; k < PIXELS; k++) {
        uvec2 at = pixel + uvec2(0, k * ROWS);
        if (all(lessThan(at, push.size_px))) {
            vec3 shown = fma(vec3(transmittance[k]), push.background, colour[k]);
            imageStore(image, ivec2(at), vec4(shown, 1.0 - transmittance[k]));
        }
    }
}
