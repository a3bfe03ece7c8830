// The search of an error limit, and the nodes and errors that remain of a page under a limit.
#extension GL_EXT_control_flow_attributes : require
// Requires: selection.glsl, error_code.glsl, state, errors[], steps[], push.given_squared, push.max_nodes,
// push.max_error, push.searches, push.fade

// The bits of squared candidate limits are FIRST_BITS plus a number followed by SEARCH_SHIFT zeros.
const uint FIRST_BITS = 562036736;  // of 2^-60
const uint SEARCH_SHIFT = 15;
const uint BY_ERROR = 0, BY_NODES = 1;  // the searches; push.searches has a bit for each
const uint SQUARE_STEPS = CODES_PER_OCTAVE / 2;  // of an octave of squares
const uint ERROR_UNITS = 48;  // negative exponent of a unit

float limit_squared_of(uint number) {
    return uintBitsToFloat(FIRST_BITS + (number << SEARCH_SHIFT));
}

// The largest code whose square is at most this number, except the code of errors above every limit. An octave of
// squares has half as many codes as an octave of their roots.
uint code_below(float squared) {
    uint bits = floatBitsToUint(squared), significand = bits & 8388607;
    if (bits < 8388608) return 0;
    uint octave = (bits >> 23) + 1;  // 128 more than the exponent
    uint step = min(uint(log2(1.0 + float(significand) / 8388608.0) * float(SQUARE_STEPS)), SQUARE_STEPS - 1);
    // Corrects the inexact logarithm.
    if (steps[step] > significand) step--;
    else if (step < SQUARE_STEPS - 1 && steps[step + 1] <= significand) step++;
    return min(octave * SQUARE_STEPS + step, 65534);
}

// A code of a page, two per word. Loops over them are unrolled, so that they stay in registers.
#define CODE(words, i) (words[(i) / 2] >> 16 * ((i) % 2) & 65535)

// The fraction of the nodes whose error is at most `limit`, in units of 1/2048.
uint fraction_below(uint words[PARTS / 2], uint least, uint limit) {
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

// The nodes of a page that remain under error limits.
struct Remaining {
    uint within;   // nodes within their limit, in units of 1/2048 of the page
    uint drawn;    // of these, nodes in the image whose parents are not within theirs, in units of 1/2048/SAMPLES nodes
};

bool is_in_cut(PageErrors page, uvec2 limits) {
    return page.least_error <= limits.x + push.fade && CODE(page.parent_errors, PARTS - 1) > limits.y;
}

// The codes of an error limit on a page: for its nodes, for their parents.
uvec2 limits_of(PageInView in_view, float limit_squared) {
    precise vec2 squares = limit_squared * in_view.widths;
    return uvec2(code_below(squares.x), code_below(squares.y));
}

Remaining remaining_of(PageInView in_view, PageErrors page, uvec2 limits) {
    Remaining remaining = Remaining(0, 0);
    if (!is_in_cut(page, limits)) return remaining;
    remaining.within = fraction_below(page.errors, page.least_error, limits.x + push.fade);
    uint coarser = fraction_below(page.parent_errors, 0, limits.y);
    remaining.drawn = page.count * (remaining.within - min(coarser, remaining.within)) * in_view.weight;
    return remaining;
}

// The drawn nodes, in units of 1/SAMPLES.
uint nodes_of(Remaining remaining) {
    return remaining.drawn / 2048;
}

// The squared error of a node in the image: the mean over the nodes within their limit.
float squared_error_of_node(Remaining remaining, PageInView in_view, PageErrors page) {
    float whole = float(remaining.within) / 256.0, sum = 0.0;
    [[unroll]] for (uint i = 0; i < PARTS; i++) {
        uint code = CODE(page.squared_errors, i);
        sum += code > 0 ? value_of_code(code) * clamp(whole - float(i), 0.0, 1.0) : 0.0;
    }
    return remaining.within > 0 && in_view.widths.x > 0.0 ? (sum / whole) / in_view.widths.x : 0.0;
}

// The squared error of all drawn nodes of the page.
float squared_error_of(Remaining remaining, PageInView in_view, PageErrors page) {
    return float(remaining.drawn) / (2048.0 * float(SAMPLES)) * squared_error_of_node(remaining, in_view, page);
}

// A squared error in units of SelectionState.
uvec2 error_in_units(float squared_error) {
    float values = 3.0 * float(push.pixels);
    float units = min(squared_error / values * exp2(float(ERROR_UNITS)), exp2(52.0));
    uint high = uint(units * exp2(-32.0));
    return uvec2(uint(units - float(high) * exp2(32.0)), high);
}

uint sum_of(uint search, uint round, uint candidate, uint word) {
    return state.sums[((search * ROUNDS + round) * CANDIDATES + candidate) * 2 + word];
}

// True if the searched limit is at or above a candidate.
bool is_below(uint search, uint round, uint candidate) {
    uvec2 sum = uvec2(sum_of(search, round, candidate, 0), sum_of(search, round, candidate, 1));
    if (search == BY_ERROR) {
        return sum.y < push.max_error.y || sum.y == push.max_error.y && sum.x <= push.max_error.x;
    }
    return sum.y > push.max_nodes.y || sum.y == push.max_nodes.y && sum.x > push.max_nodes.x;
}

shared uint digits[SEARCHES * ROUNDS];

// Reads the results of the rounds before `end`. All invocations of a workgroup call it, each for one candidate.
void read_rounds(uint end) {
    if (lane() < SEARCHES * ROUNDS) digits[lane()] = 0;
    barrier();
    uint round = lane() / CANDIDATES % ROUNDS, search = lane() / (CANDIDATES * ROUNDS);
    if (search < SEARCHES && round < end && is_below(search, round, lane() % CANDIDATES)) {
        atomicAdd(digits[search * ROUNDS + round], 1);
    }
    barrier();
}

// The number found by a search in these rounds: three bits per round, the highest first.
uint found_by(uint search) {
    uint number = 0;
    for (uint round = 0; round < ROUNDS; round++) number = 8 * number + digits[search * ROUNDS + round];
    return number;
}

// The square of the requested limit: the largest limit with an allowed predicted error, or a larger one if more nodes
// than allowed would remain. Before: read_rounds(ROUNDS).
float limit_found() {
    float limit = push.given_squared;
    if ((push.searches & 1 << BY_ERROR) != 0) {
        uint number = found_by(BY_ERROR);
        limit = number == 0 ? 0.0 : limit_squared_of(number);
    }
    if ((push.searches & 1 << BY_NODES) != 0) {
        uint number = found_by(BY_NODES);
        if (number > 0) limit = max(limit, limit_squared_of(number + 1));
    }
    return limit;
}
