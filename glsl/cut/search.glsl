// The search for a limit, and what a limit leaves of a page.
#extension GL_EXT_control_flow_attributes : require
// Requires: cut.glsl, state, errors[], steps[], push.given_squared, push.most_nodes, push.most_energy, push.searches

// The squares of the limits that are searched are floats with these bits and SEARCH_SHIFT zeros behind.
const uint FIRST_BITS = 562036736;  // of 2^-60
const uint SEARCH_SHIFT = 15;
const uint BY_ENERGY = 0, BY_NODES = 1;  // the searches; push.searches has a bit for each
const uint ENERGY_UNITS = 48;  // negative power of two of a unit

float limit_squared_of(uint number) {
    return uintBitsToFloat(FIRST_BITS + (number << SEARCH_SHIFT));
}

// The largest code whose square is not above this number, but never that of what is in no cut: codes are logarithms in
// steps of 1/512 (src/levels/codes.rs), so those of squares are in steps of 1/256.
uint code_below(float squared) {
    uint bits = floatBitsToUint(squared), significand = bits & 8388607;
    if (bits < 8388608) return 0;
    uint octave = (bits >> 23) + 1;  // 128 more than the exponent
    uint step = min(uint(log2(1.0 + float(significand) / 8388608.0) * 256.0), 255);
    // The logarithm is not exact.
    if (steps[step] > significand) step--;
    else if (step < 255 && steps[step + 1] <= significand) step++;
    return min(octave * 256 + step, 65534);
}

uint half_of(uint words[PARTS / 2], uint i) {
    return words[i / 2] >> 16 * (i % 2) & 65535;
}

// The part of the nodes whose error is at most `limit`, in 1/2048.
uint part_below(uint words[PARTS / 2], uint least, uint limit) {
    uint whole = 0, from = least, to = 0;
    for (uint i = 0; i < PARTS; i++) {
        uint largest = half_of(words, i);
        if (largest > limit) {
            to = largest;
            break;
        }
        from = largest;
        whole++;
    }
    if (whole == PARTS) return 2048;
    uint inside = limit > from ? (limit - from) * 256 / max(to - from, 1) : 0;
    return 256 * whole + min(inside, 256);
}

// What a limit leaves of a page.
struct Left {
    uvec2 limits;  // codes: of its nodes, of their parents
    uint nodes;    // in sight, in parts of 1/SAMPLES
    float energy;  // their squared error
};

bool is_in_cut(PageErrors page, uvec2 limits) {
    return page.least <= limits.x && half_of(page.parents, PARTS - 1) > limits.y;
}

Left left_of(SeenPage seen, float limit_squared) {
    PageErrors page = errors[seen.page];
    precise vec2 squares = limit_squared * seen.widths;
    Left left = Left(uvec2(code_below(squares.x), code_below(squares.y)), 0, 0.0);
    if (!is_in_cut(page, left.limits)) return left;
    uint within = part_below(page.errors, page.least, left.limits.x);
    uint coarser = part_below(page.parents, 0, left.limits.y);
    uint drawn = page.count * (within - min(coarser, within)) * seen.weight;  // in parts of 1/2048/SAMPLES
    left.nodes = drawn / 2048;
    float whole = float(within) / 256.0, sum = 0.0;
    for (uint i = 0; i < PARTS; i++) {
        uint code = half_of(page.energies, i);
        if (code > 0) sum += exp2(float(code) / 512.0 - 64.0) * clamp(whole - float(i), 0.0, 1.0);
    }
    if (whole > 0.0 && seen.widths.x > 0.0) left.energy = float(drawn) / (2048.0 * float(SAMPLES)) * (sum / whole) / seen.widths.x;
    return left;
}

// A squared error in units of the state.
uvec2 in_units(float energy) {
    float values = 3.0 * float(push.pixels);
    float units = min(energy / values * exp2(float(ENERGY_UNITS)), exp2(52.0));
    uint high = uint(units * exp2(-32.0));
    return uvec2(uint(units - float(high) * exp2(32.0)), high);
}

uint sum_of(uint search, uint round, uint candidate, uint word) {
    return state.sums[((search * ROUNDS + round) * CANDIDATES + candidate) * 2 + word];
}

// True if the limit to find is at or above a candidate.
bool is_below(uint search, uint round, uint candidate) {
    uvec2 sum = uvec2(sum_of(search, round, candidate, 0), sum_of(search, round, candidate, 1));
    if (search == BY_ENERGY) {
        return sum.y < push.most_energy.y || sum.y == push.most_energy.y && sum.x <= push.most_energy.x;
    }
    return sum.y > push.most_nodes.y || sum.y == push.most_nodes.y && sum.x > push.most_nodes.x;
}

// The number that a search found in the rounds before `end`: three bits each, from the highest.
uint found_before(uint search, uint end) {
    uint number = 0;
    // Without branches between them, all loads are on their way at the same time.
    [[unroll]] for (uint round = 0; round < ROUNDS; round++) {
        uint digit = 0;
        [[unroll]] for (uint candidate = 0; candidate < CANDIDATES; candidate++) {
            digit += uint(is_below(search, round, candidate));
        }
        if (round < end) number |= digit << 3 * (ROUNDS - 1 - round);
    }
    return number;
}

// The square of the limit that the options ask for: the largest whose predicted error is not too large, or a larger one
// that leaves no more nodes than they allow.
float limit_found() {
    float limit = push.given_squared;
    if ((push.searches & 1 << BY_ENERGY) != 0) {
        uint number = found_before(BY_ENERGY, ROUNDS);
        limit = number == 0 ? 0.0 : limit_squared_of(number);
    }
    if ((push.searches & 1 << BY_NODES) != 0) {
        uint number = found_before(BY_NODES, ROUNDS);
        if (number > 0) limit = max(limit, limit_squared_of(number + 1));
    }
    return limit;
}
