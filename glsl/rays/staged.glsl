// The splats of a batch in workgroup memory, and where pixels see them: along their rays.
// Requires: portable/blend_splat.glsl, rays/splat.glsl, push.size_px, rays (0 where a pixel has none)
#define SPLAT RaySplat
#define PLACE vec3  // a ray

shared RaySplat staged[WORKGROUP];
shared float staged_limit[WORKGROUP];  // the falloff beyond which the splat is not drawn

PLACE place_of(uvec2 pixel) {
    bool inside = all(lessThan(pixel, push.size_px));
    return inside ? rays[pixel.y * push.size_px.x + pixel.x] : vec3(0.0);
}

bool sees(PLACE ray) {
    return ray != vec3(0.0);
}

void put(RaySplat splat) {
    staged[lane()] = splat;
    staged_limit[lane()] = falloff_limit(splat.opacity);
}

float falloff_at(uint i, PLACE ray) {
    return falloff_along(staged[i], ray);
}

float opacity_of(uint i) {
    return staged[i].opacity;
}

vec4 look_of(uint i) {
    return vec4(staged[i].colour, staged_limit[i]);
}
