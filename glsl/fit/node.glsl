// Nodes, and the pictures that they are drawn in: `Node`, `Window` and `Splats` of src/lod.
// Requires: fit/numbers.glsl

struct FitNode {
    float mean[3];
    float rotation[4];  // w x y z
    float scale[3];
    float opacity;
    float size;
    float colour[3];  // red, green and blue of the harmonics of degree 0
    float is_new;     // 1 for a parent of several children, or 0
};

const uint FIT_FUNCTIONS = 25;  // basis functions of spherical harmonics

// A picture, with doubles in two words.
struct FitView {
    uvec2 right[3];
    uvec2 down[3];
    uvec2 forward[3];
    uvec2 origin[2];
    uvec2 px;
    uvec2 basis[FIT_FUNCTIONS];
    uint width;
    uint height;
    uint first_pixel;
};

// A node in a picture.
struct FitSplat {
    float mean[2];
    float conic[3];
    float opacity;
    float colour[3];
    float is_new;
};

dvec3 doubles(uvec2 words[3]) {
    return dvec3(packDouble2x32(words[0]), packDouble2x32(words[1]), packDouble2x32(words[2]));
}

dvec3 wide(float values[3]) {
    return dvec3(values[0], values[1], values[2]);
}

dvec4 normalized(dvec4 turn) {
    precise double squares = turn.x * turn.x + turn.y * turn.y + turn.z * turn.z + turn.w * turn.w;
    precise dvec4 found = turn * (1.0LF / sqrt(squares));
    return found;
}

// The rotation of a node, x y z w.
dvec4 turn_of(FitNode node) {
    return normalized(dvec4(node.rotation[1], node.rotation[2], node.rotation[3], node.rotation[0]));
}

// The columns of a rotation.
dvec3[3] columns_of(dvec4 turn) {
    precise dvec3 twice = turn.xyz + turn.xyz;
    precise dvec3 x = turn.x * twice, y = turn.y * twice, w = turn.w * twice;
    precise double zz = turn.z * twice.z;
    precise dvec3 first = dvec3(1.0LF - (y.y + zz), x.y + w.z, x.z - w.y);
    precise dvec3 second = dvec3(x.y - w.z, 1.0LF - (x.x + zz), y.z + w.x);
    precise dvec3 third = dvec3(x.z + w.y, y.z - w.x, 1.0LF - (x.x + y.y));
    return dvec3[3](first, second, third);
}

dvec3 scaled(dvec3 vector, double factor) {
    precise dvec3 found = vector * factor;
    return found;
}
