// One workgroup walks the list of a tile, one invocation per pixel, and counts or draws the work of a blend.
// `Work` in src/render/inspect/inspector.rs documents the pictures.
// Requires: the bindings and push constants of inspect/inspect.comp, inspect/codes.glsl, portable/staged.glsl or
// rays/staged.glsl, and
//   draws_glyphs()      true if WORK draws glyphs: centres or outlines of splats
//   draw_glyph(i, place, sum, transmittance)  draws the glyph of a staged splat; true if the pixel stops
#include "portable/blend_pixel.glsl"

const float NOTHING = 1e-12;  // behind this transmittance nothing is visible

shared uint stopped_lanes;

// Adds a splat to (mean depth, median depth, count). It has this share of the pixel and changes the transmittance from
// `before` to `after`.
vec3 add_depth(vec3 sum, float depth, float share, float before, float after) {
    // The mean moves towards each new depth by its fraction of all shares so far, so it stays within the depths.
    float mean = sum.z == 0.0 ? depth : sum.x + (depth - sum.x) * share / max(1.0 - after, share);
    return vec3(mean, before > 0.5 && after <= 0.5 ? depth : sum.y, sum.z + 1.0);
}

// Applies staged splat `i` to a pixel. Returns true if the pixel stops.
bool walk_splat(uint i, PLACE place, inout vec3 sum, inout float transmittance) {
    if (draws_glyphs()) return draw_glyph(i, place, sum, transmittance);
    if (WORK == WORK_DEPTHS && transmittance < NOTHING) return true;
    vec3 share = vec3(0.0);
    float before = transmittance, fall = falloff_at(i, place);
    vec4 look = look_of(i);
    bool ends = blend_falloff(fall, opacity_of(i), vec4(vec3(1.0), look.w), share, transmittance);
    // The splat that stops a pixel is drawn if the transmittance fell below STOP, but not if it would fall below
    // TRANSMITTANCE_MIN.
    bool drawn = fall <= look.w && (!ends || transmittance != before);
    if (WORK == WORK_DEPTHS) {
        if (drawn) sum = add_depth(sum, look.r, share.r, before, transmittance);
    } else if (WORK == WORK_EVALUATIONS || drawn) {
        sum += 1.0;
    }
    return ends;
}

void main() {
    uint tile = workgroup();
    if (tile >= push.tiles) return;
    uvec2 pixel = pixel_of_lane(tile);
    bool inside = all(lessThan(pixel, push.size_px));
    PLACE place = place_of(pixel);
    vec4 state = begin_pixel(pixel, inside);
    vec3 sum = state.rgb;
    float transmittance = abs(state.a);
    bool stopped = !inside || !sees(place) || state.a < 0.0, told = false;

    uvec2 list = ranges[tile];
    if (lane() == 0) {
        stopped_lanes = 0;
        atomicMax(totals.longest_list, list.y - list.x);  // a maximum: order does not matter
    }
    uvec2 entries = entries_of_pass(list);
    uint begin = entries.x, end = entries.y;
    if (WORK == WORK_TILE_LOAD) {
        sum = vec3(list.y - list.x);
        end = begin;
    }
    for (uint batch = begin; batch < end; batch += WORKGROUP) {
        // All lanes are done with the last batch. No lane stops before the next barrier, so all take the same branch.
        barrier();
        if (stopped_lanes == WORKGROUP) break;
        if (batch + lane() < end) put(splats[splat_ids[batch + lane()]]);
        barrier();
        uint count = min(WORKGROUP, end - batch);
        for (uint i = 0; i < count && !stopped; i++) {
            stopped = walk_splat(i, place, sum, transmittance);
        }
        if (stopped && !told) atomicAdd(stopped_lanes, 1);  // a count: order does not matter
        told = stopped;
    }
    bool opaque = WORK == WORK_CENTRES ? stopped : WORK != WORK_OUTLINES && WORK != WORK_DEPTHS;
    if (opaque && push.last_pass == 1) transmittance = 0.0;
    if (!inside) return;
    if (sees(place)) end_pixel(pixel, sum, transmittance, stopped);
    else imageStore(image, ivec2(pixel), vec4(0.0));  // no ray
}
