// What a splat does to a pixel: the arithmetic that all blends share, so that they agree bit for bit.

// -log2 of a weight over its opacity, as a sum of squares.
float falloff(vec3 factor, vec2 d) {
    precise float u = fma(factor.x, d.x, factor.y * d.y);
    precise float v = factor.z * d.y;
    precise float sum = fma(u, u, v * v);
    return sum;
}

// What a splat is blended with: its colour, and the falloff at which alpha is ALPHA_MIN.
vec4 colour_and_limit(Splat splat) {
    return vec4(splat.colour, log2(splat.opacity / ALPHA_MIN));
}

// Blends a splat into a pixel; true if that ends the pixel. `weight`: factor, opacity; `look`: colour and limit.
bool blend_splat(vec2 mean, vec4 weight, vec4 look, vec2 pixel, inout vec3 colour, inout float transmittance) {
    float fall = falloff(weight.xyz, pixel - mean);
    if (!(fall <= look.w)) return false;  // alpha < ALPHA_MIN
    float alpha = min(ALPHA_MAX, weight.w * exp2(-fall));
    precise float rest = transmittance * (1.0 - alpha);
    if (rest < TRANSMITTANCE_MIN) return true;
    precise float share = alpha * transmittance;
    precise vec3 added = fma(look.rgb, vec3(share), colour);
    colour = added;
    transmittance = rest;
    return false;
}
