// Numbers with the bits of those of src/lod on the host: no product is joined with a sum (`precise`), and quotients and
// roots go through 64-bit floats, as those of 32-bit floats are not rounded to the nearest on all devices.

const float FIT_ALPHA_MIN = 0.00392156862745098;  // 1 / 255
const float FIT_PER_ALPHA_MIN = 255.0;
const float FIT_MOST_DEVIATIONS = 6.0;  // standard deviations beyond which no alpha reaches the threshold
const float FIT_LEAST = 1e-24;  // smaller squared differences, and smaller sums over pixels, count as 0
const float LN_2 = 0.6931471805599453;
const float LOG_2_E = 1.4426950408889634;

float quotient(float a, float b) {
    return float(double(a) / double(b));
}

float root(float x) {
    return float(sqrt(double(x)));
}

// 2^x, as `exp2` in src/lod/raster.rs.
float power_of_two(float x) {
    const float ROUNDER = 12582912.0;
    precise float bounded = max(x, -126.0);
    precise float shifted = bounded + ROUNDER;
    precise float rest = bounded - (shifted - ROUNDER);
    float whole = uintBitsToFloat((floatBitsToUint(shifted) - floatBitsToUint(ROUNDER) + 127) << 23);
    precise float series =
        1.0 + rest * (LN_2 + rest * (0.2402265 + rest * (0.05550411 + rest * (0.00961813 + rest * 0.00133336))));
    precise float power = whole * series;
    return power;
}

// The logarithm of x >= 1 to base 2, as `log2` in src/lod/raster.rs.
float logarithm_to_two(float x) {
    precise float exponent = float(floatBitsToUint(x) >> 23) - 127.0;
    float mantissa = uintBitsToFloat(floatBitsToUint(x) & 0x007fffffu | 0x3f800000u);
    precise float logarithm = mantissa - 1.0;
    for (uint i = 0; i < 3; i++) logarithm += (mantissa * power_of_two(-logarithm) - 1.0) * LOG_2_E;
    precise float sum = exponent + logarithm;
    return sum;
}

double product(dvec3 a, dvec3 b) {
    precise double sum = a.x * b.x + a.y * b.y + a.z * b.z;
    return sum;
}

dvec3 cross_product(dvec3 a, dvec3 b) {
    precise dvec3 found = dvec3(a.y * b.z - b.y * a.z, a.z * b.x - b.z * a.x, a.x * b.y - b.x * a.y);
    return found;
}
