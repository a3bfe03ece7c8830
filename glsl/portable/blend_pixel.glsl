// A pixel from one blend pass to the next, and to its end. Behind the declarations of `image`, `push` and RESUME.

// (colour, T), T negated once the pixel has stopped.
vec4 begin_pixel(uvec2 pixel, bool inside) {
    vec4 fresh = vec4(0.0, 0.0, 0.0, 1.0);
    return RESUME && inside ? imageLoad(image, ivec2(pixel)) : fresh;
}

void end_pixel(uvec2 pixel, vec3 colour, float transmittance, bool stopped) {
    if (push.last_pass == 1) {
        imageStore(image, ivec2(pixel), vec4(fma(vec3(transmittance), push.background, colour), 1.0 - transmittance));
    } else {
        imageStore(image, ivec2(pixel), vec4(colour, stopped ? -transmittance : transmittance));
    }
}
