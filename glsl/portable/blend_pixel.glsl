// The state of a pixel between two blend passes, and its final value.
// Requires: RESUME, image, push.background, push.last_pass

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
