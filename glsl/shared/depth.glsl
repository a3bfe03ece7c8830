// The view depth of a point, rounded once: the order of the splats is then the order of the exact depths, on every device.
// Plain f32 errs by a few units in the last place, which reorders what lies at nearly one depth (a table seen from
// above) and costs 30 dB there. Sums and products of two floats each (Dekker 1971, Knuth 1969), 80 operations.

// a + b = x + y exactly.
vec2 two_sum(float a, float b) {
    precise float sum = a + b;
    precise float b_in_sum = sum - a;
    precise float error = (a - (sum - b_in_sum)) + (b - b_in_sum);
    return vec2(sum, error);
}

// The upper 12 bits of a float.
float upper_half(float a) {
    precise float scaled = 4097.0 * a;  // 2^12 + 1
    precise float upper = scaled - (scaled - a);
    return upper;
}

// a * b = x + y exactly. Not by fma: a device may round it twice.
vec2 two_product(float a, float b) {
    precise float product = a * b;
    float ah = upper_half(a), bh = upper_half(b);
    precise float al = a - ah;
    precise float bl = b - bh;
    precise float error = ((ah * bh - product) + ah * bl + al * bh) + al * bl;
    return vec2(product, error);
}

float depth_of(vec3 mean, View view) {
    float sum = 0.0, rest = 0.0;
    for (int i = 0; i < 3; i++) {
        vec2 offset = two_sum(mean[i], -view.position_high[i]);
        precise float offset_low = offset.y - view.position_low[i];
        vec2 product = two_product(view.forward[i], offset.x);
        vec2 added = two_sum(sum, product.x);
        sum = added.x;
        precise float low = product.y + (view.forward[i] * offset_low + view.forward_low[i] * offset.x);
        precise float next = rest + (added.y + low);
        rest = next;
    }
    precise float depth = sum + rest;
    return depth;
}

// The distance of a point from the camera, rounded once in the same way.
float distance_of(vec3 mean, View view) {
    vec3 far = abs(mean - view.position_high);
    int exponent;
    frexp(max(far.x, max(far.y, far.z)), exponent);
    // Measured in a power of two near it: no square leaves the floats, and nothing is rounded by it.
    exponent = clamp(exponent, -120, 120);
    float unit = uintBitsToFloat(uint(127 + exponent) << 23), per_unit = uintBitsToFloat(uint(127 - exponent) << 23);
    float sum = 0.0, rest = 0.0;
    for (int i = 0; i < 3; i++) {
        vec2 offset = per_unit * two_sum(mean[i], -view.position_high[i]);
        precise float low = offset.y - per_unit * view.position_low[i];
        vec2 square = two_product(offset.x, offset.x);
        vec2 added = two_sum(sum, square.x);
        sum = added.x;
        precise float next = rest + (added.y + (square.y + 2.0 * offset.x * low));
        rest = next;
    }
    // A step of Newton's from the rounded root, in which only the correction is rounded.
    float root = sqrt(sum);
    vec2 square = two_product(root, root);
    precise float left = ((sum - square.x) - square.y) + rest;
    precise float distance = root + left / (2.0 * root);
    return unit * distance;
}
