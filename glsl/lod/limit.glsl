// The search for a limit, and what a limit leaves of a page.
#extension GL_EXT_control_flow_attributes : require
// Requires: selection.glsl, error_code.glsl, state, errors[], steps[], push.given_squared, push.most_nodes, push.most_energy,
// push.searches, push.fade

// The squares of the limits that are searched are floats with these bits and SEARCH_SHIFT zeros behind.
const uint FIRST_BITS = 562036736;  // of 2^-60
const uint SEARCH_SHIFT = 15;
const uint BY_ENERGY = 0, BY_NODES = 1;  // the searches; push.searches has a bit for each
const uint SQUARE_STEPS = CODES_PER_OCTAVE / 2;  // of an octave of squares
const uint ENERGY_UNITS = 48;  // negative power of two of a unit

float limit_squared_of(uint number) {
    return uintBitsToFloat(FIRST_BITS + (number << SEARCH_SHIFT));
}

// The largest code whose square is not above this number, but never that of what is in no cut. An octave of squares has
// half as many codes as one of their roots.
uint code_below(float squared) {
    uint bits = floatBitsToUint(squared), significand = bits & 8388607;
    if (bits < 8388608) return 0;
    uint octave = (bits >> 23) + 1;  // 128 more than the exponent
    uint step = min(uint(log2(1.0 + float(significand) / 8388608.0) * float(SQUARE_STEPS)), SQUARE_STEPS - 1);
    // The logarithm is not exact.
    if (steps[step] > significand) step--;
    else if (step < SQUARE_STEPS - 1 && steps[step + 1] <= significand) step++;
    return min(octave * SQUARE_STEPS + step, 65534);
}

// Codes of a page, two in each word: loops over them are unrolled, so that they stay in registers.
#define CODE(words, i) (words[(i) / 2] >> 16 * ((i) % 2) & 65535)

// The part of the nodes whose error is at most `limit`, in 1/2048.
uint part_below(uint words[PARTS / 2], uint least, uint limit) {
    uint whole = 0, from = least, to = 65535;
    [[unroll]] for (uint i = 0; i < PARTS; i++) {
        uint largest = CODE(words, i);
        bool is_below = largest <= limit;
        whole += uint(is_below);
        from = is_below ? largest : from;
        to = is_below ? to : min(to, largest);
    }
    uint inside = limit > from ? min((limit - from) * 256 / max(to - from, 1), 256) : 0;
    return whole == PARTS ? 2048 : 256 * whole + inside;
}

// What limits leave of a page.
struct Left {
    uint within;   // the nodes within their limit, in 1/2048
    uint drawn;    // of these, those whose parents are not: nodes in sight, in parts of 1/2048/SAMPLES
};

bool is_in_cut(PageErrors page, uvec2 limits) {
    return page.least <= limits.x + push.fade && CODE(page.parents, PARTS - 1) > limits.y;
}

// The codes of a limit on a page: of its nodes, of their parents.
uvec2 limits_of(SeenPage seen, float limit_squared) {
    precise vec2 squares = limit_squared * seen.widths;
    return uvec2(code_below(squares.x), code_below(squares.y));
}

Left left_of(SeenPage seen, PageErrors page, uvec2 limits) {
    Left left = Left(0, 0);
    if (!is_in_cut(page, limits)) return left;
    left.within = part_below(page.errors, page.least, limits.x + push.fade);
    uint coarser = part_below(page.parents, 0, limits.y);
    left.drawn = page.count * (left.within - min(coarser, left.within)) * seen.weight;
    return left;
}

// Nodes that are left, in parts of 1/SAMPLES.
uint nodes_of(Left left) {
    return left.drawn / 2048;
}

// The squared error of a node in the picture: the mean over those within their limit.
float energy_of_node(Left left, SeenPage seen, PageErrors page) {
    float whole = float(left.within) / 256.0, sum = 0.0;
    [[unroll]] for (uint i = 0; i < PARTS; i++) {
        uint code = CODE(page.energies, i);
        sum += code > 0 ? value_of_code(code) * clamp(whole - float(i), 0.0, 1.0) : 0.0;
    }
    return left.within > 0 && seen.widths.x > 0.0 ? (sum / whole) / seen.widths.x : 0.0;
}

// The same of all that are drawn.
float energy_of(Left left, SeenPage seen, PageErrors page) {
    return float(left.drawn) / (2048.0 * float(SAMPLES)) * energy_of_node(left, seen, page);
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

shared uint digits[SEARCHES * ROUNDS];

// Reads what the rounds before `end` found. All invocations of a workgroup call it: each looks at one candidate.
void read_rounds(uint end) {
    if (lane() < SEARCHES * ROUNDS) digits[lane()] = 0;
    barrier();
    uint round = lane() / CANDIDATES % ROUNDS, search = lane() / (CANDIDATES * ROUNDS);
    if (search < SEARCHES && round < end && is_below(search, round, lane() % CANDIDATES)) {
        atomicAdd(digits[search * ROUNDS + round], 1);
    }
    barrier();
}

// The number that a search found in these rounds: three bits each, from the highest.
uint found_by(uint search) {
    uint number = 0;
    for (uint round = 0; round < ROUNDS; round++) number = 8 * number + digits[search * ROUNDS + round];
    return number;
}

// The square of the limit that the options ask for: the largest whose predicted error is not too large, or a larger one
// that leaves no more nodes than they allow. All rounds were read.
float limit_found() {
    float limit = push.given_squared;
    if ((push.searches & 1 << BY_ENERGY) != 0) {
        uint number = found_by(BY_ENERGY);
        limit = number == 0 ? 0.0 : limit_squared_of(number);
    }
    if ((push.searches & 1 << BY_NODES) != 0) {
        uint number = found_by(BY_NODES);
        if (number > 0) limit = max(limit, limit_squared_of(number + 1));
    }
    return limit;
}
