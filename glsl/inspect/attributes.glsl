// The attributes of a Gaussian that inspection shows instead of its colour. `Attribute` in
// src/render/inspect/inspector.rs documents them and their units.
// Requires: storage.glsl, rotation.glsl, codes.glsl, ATTRIBUTE, and as macros
//   VIEW             the camera, in the axes and units of the Gaussians
//   INDEX_OF(g)      the index of Gaussian g in its scene
//   IN_WORLD(length), IN_WORLD_AXES(v)
//   LEVEL, LAG(g), SQUARED_ERROR   of a node: lod/page_attributes.glsl explains them

// The shortest axis, turned to the camera; the first axis if several are equally short.
vec3 normal_of(vec4 rotation, vec3 scales, vec3 from_camera) {
    uint shortest = scales.y < scales.x ? 1 : 0;
    if (scales.z < scales[shortest]) shortest = 2;
    vec3 normal = rotation_matrix(rotation)[shortest];
    return dot(normal, from_camera) > 0.0 ? -normal : normal;
}

// log2 of a length; a length of 0 counts as the smallest normal float.
float log2_length(float length) {
    return log2(max(length, 1.17549435e-38));
}

// A colour unrelated to the colours of neighbouring numbers (the permutation of PCG, O'Neill 2014), and not too dark.
vec3 colour_of_number(uint number) {
    uint state = number * 747796405u + 2891336453u;
    uint word = ((state >> ((state >> 28) + 4)) ^ state) * 277803737u;
    uint hash = (word >> 22) ^ word;
    return 0.2 + 0.8 / 255.0 * vec3(hash & 0xff, hash >> 8 & 0xff, hash >> 16 & 0xff);
}

// log2 of the root mean squared error of a channel, in steps of 1/255: of a squared error, summed over the channels,
// that is spread over an area. The smallest value also stands for no error.
float log2_error(float squared_error, float area_px) {
    const float LEAST = -12.0;
    return max(log2(255.0) + 0.5 * log2(squared_error / (3.0 * area_px)), LEAST);
}

// `z` is the depth of the mean, `area_px` the integral of the splat's weight over the image.
vec3 attribute_of(uint gaussian, vec3 mean, float z, float area_px) {
    vec4 rotation;
    vec3 scales;
    float opacity;
    load_shape(gaussian, rotation, scales, opacity);
    float longest = max(scales.x, max(scales.y, scales.z)), shortest = min(scales.x, min(scales.y, scales.z));
    switch (ATTRIBUTE) {
        case ATTRIBUTE_DEPTH: return vec3(IN_WORLD(z));
        case ATTRIBUTE_NORMAL: return 0.5 + 0.5 * IN_WORLD_AXES(normal_of(rotation, scales, mean - VIEW.position_high));
        case ATTRIBUTE_OPACITY: return vec3(opacity);
        case ATTRIBUTE_SIZE: return vec3(log2_length(IN_WORLD(longest)));
        case ATTRIBUTE_ANISOTROPY: return vec3(log2_length(longest) - log2_length(shortest));
        case ATTRIBUTE_BASE_COLOUR: {
            vec4 floats[SH_VECTORS];
            load_sh(gaussian, floats);
            return harmonics_colour(floats, 0, vec3(0.0));
        }
        case ATTRIBUTE_LEVEL: return vec3(LEVEL);
        case ATTRIBUTE_PREDICTED_ERROR: return vec3(log2_error(SQUARED_ERROR, area_px));
        case ATTRIBUTE_LAG: return vec3(LAG(gaussian));
        default: return colour_of_number(INDEX_OF(gaussian));
    }
}
