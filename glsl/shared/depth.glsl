// The view depth of a point, rounded once: on every device, splats are then in the order of their exact depths.
// Requires: frame.glsl
// Plain f32 errs by a few units in the last place. That reorders splats at nearly the same depth (a table seen from
// above) and costs 30 dB there. Here every number is a sum of two floats (Dekker 1971, Knuth 1969): 80 operations.

// (x, y) with a + b = x + y exactly, where x is the rounded sum.
vec2 two_sum(float a, float b) {
    precise float sum = a + b;
    precise float b_in_sum = sum - a;
    precise float error = (a - (sum - b_in_sum)) + (b - b_in_sum);
    return vec2(sum, error);
}

// `a` with only the upper 12 bits of its significand.
float upper_half(float a) {
    precise float scaled = 4097.0 * a;  // 2^12 + 1
    precise float upper = scaled - (scaled - a);
    return upper;
}

// (x, y) with a * b = x + y exactly, where x is the rounded product. It avoids fma, which a device may round twice.
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
    // Lengths are measured in a power of two near the largest: no square overflows, and the scaling rounds nothing.
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
    // One Newton step from the rounded root, in which only the correction is rounded.
    float root = sqrt(sum);
    vec2 square = two_product(root, root);
    precise float left = ((sum - square.x) - square.y) + rest;
    precise float distance = root + left / (2.0 * root);
    return unit * distance;
}
