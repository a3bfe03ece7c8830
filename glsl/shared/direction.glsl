// The unit vector along `p`. The square of its length may overflow, so `p` is scaled first.
vec3 direction(vec3 p) {
    vec3 size = abs(p);
    return normalize(p / max(size.x, max(size.y, size.z)));
}
