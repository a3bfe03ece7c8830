// The share of a splat in a pixel: alpha * transmittance, with the arithmetic of the blend.
// Requires: portable/blend_splat.glsl, with a STOP of 0

const uint SHARE_UNIT = 16777216;  // 2^24: sums of shares are in units of 1 / SHARE_UNIT

// Subtracts the share of a splat from the transmittance and returns it: 0 if the splat is not drawn. A splat that would
// lower the transmittance below TRANSMITTANCE_MIN is not drawn either, but it ends the pixel (`stops`) and hides all
// splats behind it, so its share is the remaining transmittance.
float take_share(vec2 mean, vec4 weight, float limit, vec2 pixel, inout float transmittance, out bool stops) {
    vec3 share = vec3(0.0);
    stops = blend_splat(mean, weight, vec4(vec3(1.0), limit), pixel, share, transmittance);
    return stops ? transmittance : share.r;
}
