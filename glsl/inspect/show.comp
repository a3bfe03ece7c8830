#version 460
#include "shared/workgroup.glsl"
#include "portable/frame.glsl"
#include "inspect/codes.glsl"
// One invocation per pixel of a window: converts the displayed quantity of one or two pictures to 8 bits.
// A frame that did not fit its buffers is not shown: its pixels keep their former values.
// Before: the pictures are drawn and their totals counted. After: `shown` has the pixels; with DIRECT, `screen` has
// them too.

layout(constant_id = 0) const bool DIRECT = true;  // shaders can write the window image, else `shown` is copied
layout(constant_id = 1) const bool BGRA = false;   // the window's image has blue first

layout(binding = 0, rgba32f) readonly uniform image2D first;
layout(binding = 1, rgba32f) readonly uniform image2D second;
layout(binding = 2, scalar) readonly buffer FirstTotals { Totals first_totals; };
layout(binding = 3, scalar) readonly buffer SecondTotals { Totals second_totals; };
layout(binding = 4, scalar) readonly buffer Colours { uint colours[]; };  // [COLOURS], red lowest
layout(binding = 5, scalar) buffer Shown { uint shown[]; };               // [size_px.x * size_px.y]
layout(binding = 6) writeonly uniform image2D screen;

// The capacity that a frame was drawn with.
struct Room {
    uint visible;
    uint spans;
    uint listed;
    uint longest_list;
};

layout(push_constant, scalar) uniform Push {
    uvec2 size_px;     // of the screen
    uvec2 picture_px;  // of the pictures, in its upper left corner; the rest is black
    uint mode;
    float split_px;    // left edge of the second picture
    float gain;        // factor of differences
    uint quantity;
    uint logarithmic;  // 1: `low` and `high` are the ends of a logarithmic scale
    float low;         // the value with the first colour
    float high;        // the value with the last colour
    Room first_room;
    Room second_room;
} push;

bool is_complete(Totals totals, Room room) {
    return totals.visible <= room.visible && totals.spans <= room.spans && totals.listed_high == 0
        && totals.listed_low <= room.listed && totals.longest_list <= room.longest_list;
}

// The nearest of 255 steps, with halves rounded away from zero and NaN as 0, as in image files.
uint step_of(float value) {
    precise float steps = (value > 0.0 ? min(value, 1.0) : 0.0) * 255.0;
    float whole = floor(steps);
    return uint(steps - whole >= 0.5 ? whole + 1.0 : whole);
}

float place_between(float low, float high, float value) {
    return clamp((value - low) / max(high - low, 1e-30), 0.0, 1.0);
}

vec3 mapped(vec4 pixel) {
    if (push.quantity == QUANTITY_COLOUR) return pixel.rgb;
    float value = pixel.r;
    if (push.quantity == QUANTITY_MEAN) {
        if (!(pixel.a > 0.0)) return vec3(0.0);
        value /= pixel.a;
    }
    if (push.quantity == QUANTITY_COVERAGE) value = pixel.a;
    if (push.quantity == QUANTITY_TRANSMITTANCE) value = 1.0 - pixel.a;
    float place = push.logarithmic == 1
        ? place_between(log2(push.low), log2(push.high), log2(max(value, 1e-30)))
        : place_between(push.low, push.high, value);
    return unpackUnorm4x8(colours[uint(place * float(COLOURS - 1) + 0.5)]).rgb;
}

void main() {
    uint index = workgroup() * WORKGROUP + lane();
    uvec2 pixel = uvec2(index % push.size_px.x, index / push.size_px.x);
    if (pixel.y >= push.size_px.y) return;
    if (any(greaterThanEqual(pixel, push.picture_px))) {
        shown[index] = 0xff000000u;
        if (DIRECT) imageStore(screen, ivec2(pixel), vec4(0.0, 0.0, 0.0, 1.0));
        return;
    }
    ivec2 place = ivec2(pixel);
    bool shows_second = push.mode == MODE_SECOND || push.mode == MODE_SPLIT && float(pixel.x) + 0.5 > push.split_px;
    bool complete =
        shows_second ? is_complete(second_totals, push.second_room) : is_complete(first_totals, push.first_room);
    vec3 colour;
    if (push.mode == MODE_DIFFERENCE) {
        complete = complete && is_complete(second_totals, push.second_room);
        vec4 apart = abs(imageLoad(first, place) - imageLoad(second, place));
        colour = push.gain * mapped(apart);
    } else {
        colour = mapped(shows_second ? imageLoad(second, place) : imageLoad(first, place));
    }
    uvec3 steps = uvec3(step_of(colour.r), step_of(colour.g), step_of(colour.b));
    if (complete) {
        uvec3 packed = BGRA && !DIRECT ? steps.bgr : steps.rgb;
        shown[index] = packed.r | packed.g << 8 | packed.b << 16 | 0xff000000u;
    }
    if (DIRECT) imageStore(screen, place, unpackUnorm4x8(shown[index]));
}
