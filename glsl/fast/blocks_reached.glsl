// The blocks of a bin that an ellipse meets.
// Requires: GL_EXT_control_flow_attributes, fast/frame.glsl, push.block_height
// A row of blocks meets an ellipse in an interval (the idea of AccuTile, Hanson et al. 2024). The test is a bound: a
// block with a pixel that the splat is drawn on is never left out.

// The blocks of a bin whose pixel centres the ellipse meets, a bit each. Offsets d from its middle (px) with
// |(factor.x d.x + factor.y d.y, factor.z d.y)| <= border are in it. `corner`: of the bin, relative to the middle, px.
// `away`: px, of the middle from the edge of the picture. `off`: px, by which pixel centres may be elsewhere.
uint blocks_reached(vec2 corner, vec3 factor, float border, float away, float off) {
    float half_height = border / factor.z, per_x = 1.0 / factor.x, slope = factor.y * per_x;
    float rightmost_y = -factor.y * half_height * inversesqrt(factor.y * factor.y + factor.z * factor.z);
    float height = float(push.block_height);
    vec2 far = abs(corner) + vec2(BIN_COLUMNS * BLOCK_WIDTH, BIN_ROWS * height);
    float slack = 1e-6 * (away + far.x + abs(slope) * far.y) + 1e-3 + off;
    uint mask = 0;
    [[unroll]] for (uint row = 0; row < BIN_ROWS; row++) {
        float low = max(corner.y + float(row) * height + 0.5 - off, -half_height);
        float high = min(corner.y + float(row + 1) * height - 0.5 + off, half_height);
        float right_y = clamp(rightmost_y, low, high), left_y = clamp(-rightmost_y, low, high);
        float right_v = factor.z * right_y, left_v = factor.z * left_y;
        float right = sqrt(max(border * border - right_v * right_v, 0.0)) * per_x - slope * right_y + slack;
        float left = -sqrt(max(border * border - left_v * left_v, 0.0)) * per_x - slope * left_y - slack;
        // The pixel centres of block c lie from 8 c + 0.5 to 8 c + 7.5.
        float first = ceil((left - corner.x - (float(BLOCK_WIDTH) - 0.5)) / float(BLOCK_WIDTH));
        float end = floor((right - corner.x - 0.5) / float(BLOCK_WIDTH)) + 1.0;
        // The comparisons are written so that NaN reaches every block.
        uint from = first > 0.0 ? uint(min(first, 8.0)) : 0;
        uint to = end < 8.0 ? uint(max(end, 0.0)) : 8;
        if (from < to && !(low > high + slack)) mask |= ((1u << to) - (1u << from)) << 8 * row;
    }
    return mask;
}

// Slightly beyond the falloff `limit`: f32 weights of the blend may reach ALPHA_MIN by rounding.
float border_of(float limit) {
    return sqrt(max(limit, 0.0) + 1e-3);
}
