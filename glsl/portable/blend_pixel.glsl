// A pass of a blend: its pixels and entries, the state of a pixel between two passes, and its final value.
// Requires: frame.glsl, RESUME, image, and of push size_px, background, pass_begin, pass_limit, last_pass

// The pixel of this invocation in a tile, in rows.
uvec2 pixel_of_lane(uint tile) {
    uint tiles_x = div_up(push.size_px.x, TILE);
    return uvec2(tile % tiles_x, tile / tiles_x) * TILE + uvec2(lane() % TILE, lane() / TILE);
}

// The first and one past the last entry of a list that this pass takes.
uvec2 entries_of_pass(uvec2 list) {
    uint begin = list.x + min(push.pass_begin, list.y - list.x);
    return uvec2(begin, begin + min(push.pass_limit, list.y - begin));
}

// The state of a pixel at the start of a pass: (colour, T), with T negated if the pixel has stopped.
vec4 begin_pixel(uvec2 pixel, bool inside) {
    vec4 fresh = vec4(0.0, 0.0, 0.0, 1.0);
    return RESUME && inside ? imageLoad(image, ivec2(pixel)) : fresh;
}

// Stores the state of a pixel, or after the last pass its final value.
void end_pixel(uvec2 pixel, vec3 colour, float transmittance, bool stopped) {
    if (push.last_pass == 1) {
        imageStore(image, ivec2(pixel), vec4(fma(vec3(transmittance), push.background, colour), 1.0 - transmittance));
    } else {
        imageStore(image, ivec2(pixel), vec4(colour, stopped ? -transmittance : transmittance));
    }
}
