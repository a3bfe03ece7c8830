// The splats of a batch in workgroup memory, and where pixels see them: at their centres.
// Requires: portable/blend_splat.glsl, push.top_px
#define SPLAT Splat
#define PLACE vec2  // px

shared vec2 staged_mean[WORKGROUP];
shared vec4 staged_weight[WORKGROUP];  // factor, opacity
shared vec4 staged_look[WORKGROUP];    // colour, and the falloff beyond which the splat is not drawn

// The centre of a pixel of the image in the picture, of which the image may be a band.
PLACE place_of(uvec2 pixel) {
    return vec2(pixel + uvec2(0, push.top_px)) + 0.5;
}

bool sees(PLACE centre) {
    return true;
}

void put(Splat splat) {
    staged_mean[lane()] = splat.mean_px;
    staged_weight[lane()] = vec4(splat.factor, splat.opacity);
    staged_look[lane()] = colour_and_limit(splat);
}

float falloff_at(uint i, PLACE centre) {
    return falloff(staged_weight[i].xyz, centre - staged_mean[i]);
}

float opacity_of(uint i) {
    return staged_weight[i].w;
}

vec4 look_of(uint i) {
    return staged_look[i];
}
