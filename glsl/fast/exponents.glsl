// What a splat of a pinhole weighs at the pixels of a block.
// Requires: fast/transmittance.glsl, WORKGROUP, BLOCK, PIXELS, ROWS, splats[]
// The exponent of a splat is a polynomial around the middle of the block (the idea of Local-GS) and takes two fused
// multiply-adds per pixel.
#include "fast/splat.glsl"

// The entries that are blended next.
// With COMPACT, exponent = a.x + x (a.y + x a.w) + y (a.z + x b.x + y b.y).
// Without, exponent = a.x - (a.y + x a.w + y b.x)^2 - (a.z + y b.y)^2: three operations more and a tenth of the
// rounding error.
shared vec4 staged_a[WORKGROUP];
shared vec4 staged_b[WORKGROUP];  // zw: red and green
shared float staged_blue[WORKGROUP];

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

const Record NO_RECORD = Record(vec4(0.0), vec4(0.0), 0.0);

vec2 middle;         // px, the middle of the block
float x, y[PIXELS];  // px, the centres of the lane's pixels relative to the middle

void place_pixels(uvec2 corner, uvec2 lane_place) {
    middle = vec2(corner + uvec2(0, push.top_px)) + 0.5 * vec2(BLOCK);
    x = float(lane_place.x) + 0.5 - 0.5 * float(BLOCK.x);
    for (uint k = 0; k < PIXELS; k++) y[k] = float(lane_place.y + k * ROWS) + 0.5 - 0.5 * float(BLOCK.y);
}

const uint FORMS = 1;

// Stages the polynomial of this lane's splat around `middle` for all lanes; returns the form of all splats. A lane
// without a splat stages one that is never drawn, and so does one whose polynomial would be infinite or NaN.
uint stage(Record record, bool exists) {
    vec2 d = middle - record.a.xy;
    vec3 factor = vec3(record.a.zw, record.b.x);
    uint place = lane();
    precise float u = fma(factor.x, d.x, factor.y * d.y);
    precise float v = factor.z * d.y;
    precise float square = fma(u, u, v * v);
    bool draws = exists && square < 1e30;
    vec4 a, b;
    if (COMPACT) {
        precise float at_middle = record.b.y - square - LOWERED;
        a = vec4(at_middle, -2.0 * factor.x * u, -2.0 * (factor.y * u + factor.z * v), -factor.x * factor.x);
        b = vec4(-2.0 * factor.x * factor.y, -(factor.y * factor.y + factor.z * factor.z), record.b.zw);
    } else {
        a = vec4(record.b.y, u, v, factor.x);
        b = vec4(factor.yz, record.b.zw);
    }
    staged_a[place] = draws ? a : vec4(-1e30, vec3(0.0));
    staged_b[place] = draws ? b : vec4(0.0);
    staged_blue[place] = record.blue;
    return 0;
}

// A staged splat at the column of this lane.
struct Curve {
    vec4 a;
    vec4 b;
    float on_axis;
    float slope;  // used with COMPACT
    vec3 colour;
};

Curve staged_curve(uint place, uint form) {
    vec4 a = staged_a[place], b = staged_b[place];
    float on_axis = COMPACT ? fma(x, fma(a.w, x, a.y), a.x) : fma(a.w, x, a.y);
    return Curve(a, b, on_axis, fma(b.x, x, a.z), vec3(b.zw, staged_blue[place]));
}

// log2(alpha / ALPHA_MIN), less LOWERED, at the `k`-th pixel of this lane.
float exponent_at(Curve curve, uint k, uint form) {
    if (COMPACT) return fma(y[k], fma(curve.b.y, y[k], curve.slope), curve.on_axis);
    float u = fma(curve.b.x, y[k], curve.on_axis), v = fma(curve.b.y, y[k], curve.a.z);
    return fma(-u, u, fma(-v, v, curve.a.x));
}
