#version 460
#define WORKGROUP_SIZE 512
#include "shared/workgroup.glsl"
#extension GL_KHR_shader_subgroup_shuffle : require
#include "shared/ballot.glsl"
#include "fast/frame.glsl"
layout(constant_id = 0) const uint DIGIT_BITS = 8;  // bits of a key that one pass sorts by
#include "shared/digits.glsl"
// One workgroup per run of entries of a bin: sorts them by depth, then by Gaussian.
// Before: unsorted and list_starts from list: a list is its chunk lists, one after another; depth_keys from project.
// After: if the run is the whole list, its sorted splats are in splat_ids; otherwise the sorted run is in `entries`.
// An entry goes to the place that the distribution of depths predicts; entries that share a place are sorted by
// insertion.
// If too many share one, a radix sort of the run takes over. No two entries of a bin are equal in depth and Gaussian,
// so the result does not depend on the order of the input.

layout(constant_id = 1) const uint SUBGROUPS = 16;  // in a workgroup, at most

layout(binding = 0, scalar) readonly buffer RunBins { uint run_bins[]; };                   // [runs]
layout(binding = 1, scalar) readonly buffer Bins { Bin bins[]; };                           // [bins]
layout(binding = 2, scalar) readonly buffer Ids { uint gaussian_from_splat[]; };            // [visible_capacity]
layout(binding = 3, scalar) readonly buffer DepthKeys { uint depth_keys[]; };               // [visible_capacity]
layout(binding = 4, scalar) writeonly buffer Entries { uvec2 entries[]; };                  // [entry_capacity]
layout(binding = 5, scalar) writeonly buffer SplatIds { uint splat_ids[]; };                // [entry_capacity]
layout(binding = 6, scalar) readonly buffer DispatchesBlock { FastDispatches dispatches; };
layout(binding = 7, scalar) readonly buffer ListStarts { uint list_starts[]; };  // [(bins + 1) * chunks]
layout(binding = 8, scalar) readonly buffer Unsorted { uint unsorted[]; };                  // [entry_capacity]
layout(push_constant, scalar) uniform Push {
    uint bins;
} push;

#include "shared/subgroup_rank.glsl"

const uint SHARED_ALONE = 24;  // most entries that may share a place
const uint PLACE_BITS = 11;    // log2(BIN_RUN)
const uint NONE = 0xffffffff;  // after every key
const uint COUNTS = SUBGROUPS * DIGITS;
shared uint keys[BIN_RUN];
shared uint values[2 * BIN_RUN > COUNTS ? 2 * BIN_RUN : COUNTS];  // values; counts while keys are sorted
shared uint lowest, highest, is_crowded;

// The keys and values of the run, in registers: item k of a lane has the place own + k * gl_SubgroupSize. Each subgroup
// has consecutive items, so that (subgroup, item, lane) is their order. Indices are literals, because registers cannot
// be indexed.
#define EACH_ITEM(DO) DO(0) if (items > 1) { DO(1) } if (items > 2) { DO(2) } if (items > 3) { DO(3) }
uvec4 key, value;
uint count, items, own;

// The rank of this lane's key among the keys of its subgroup with the same digit, over all items so far.
uint count_digit(uint digit) {
    uvec4 same = same_digit(digit);
    uvec2 rank = rank_in(same);
    // The first lane of a digit adds for all lanes with it, so no two atomics of an item meet. The shuffle makes the
    // others wait for it, which keeps the items in order.
    uint before = 0;
    if (rank.x == 0) before = atomicAdd(values[gl_SubgroupID * DIGITS + digit], rank.y);
    return subgroupShuffle(before, subgroupBallotFindLSB(same)) + rank.x;
}

// Replaces the counts of every digit by their sums over the subgroups before, and sets `keys` to the sums over the
// digits before. Lane d handles digit d.
void scan_digits() {
    uint sum = 0, total;
    if (lane() < DIGITS) {
        for (uint s = 0; s < gl_NumSubgroups; s++) {
            uint here = values[s * DIGITS + lane()];
            values[s * DIGITS + lane()] = sum;
            sum += here;
        }
    }
    uint before = workgroup_exclusive_add(sum, total);
    if (lane() < DIGITS) keys[lane()] = before;
}

// Sorts stably by DIGIT_BITS bits of the keys, from bit `shift` on.
void sort_by_digit(uint shift) {
    uint bits = min(DIGIT_BITS, 32 - shift);
    for (uint i = lane(); i < COUNTS; i += WORKGROUP) values[i] = 0;
    barrier();
    uvec4 place;
#define COUNT(k) place[k] = count_digit(digit_of(key[k], shift, bits));
    EACH_ITEM(COUNT)
    barrier();
    scan_digits();
    barrier();
#define PLACE(k) { uint d = digit_of(key[k], shift, bits); place[k] += values[gl_SubgroupID * DIGITS + d] + keys[d]; }
    EACH_ITEM(PLACE)
    barrier();
#define PUT_KEY(k) keys[place[k]] = key[k];
    EACH_ITEM(PUT_KEY)
    barrier();
#define GET_KEY(k) key[k] = keys[own + k * gl_SubgroupSize];
    EACH_ITEM(GET_KEY)
    barrier();
#define PUT_VALUE(k) keys[place[k]] = value[k];
    EACH_ITEM(PUT_VALUE)
    barrier();
#define GET_VALUE(k) value[k] = keys[own + k * gl_SubgroupSize];
    EACH_ITEM(GET_VALUE)
}

bool exists(uint k) {
    return own + k * gl_SubgroupSize < count;
}

// The least power of 2 that is not below the number of chunks.
uint chunk_places() {
    return 1u << findMSB(2 * dispatches.chunks - 1);
}

// Sets, for every chunk, `values` to the number of entries of a bin in the chunks before it, and `keys` to the
// difference between the index of an entry of the chunk list in `unsorted` and in the list of the bin.
void load_chunk_lists(uint bin) {
    // Each lane handles consecutive chunks.
    uint chunks = dispatches.chunks;
    uint each = div_up(chunks, WORKGROUP), first = lane() * each, end = min(first + each, chunks);
    uvec4 begins = uvec4(0), counts = uvec4(0);
#define LOAD_STARTS(k) \
    if (first + k < end) { \
        begins[k] = list_starts[start_place(first + k, chunks, bin, push.bins)]; \
        counts[k] = list_starts[start_place(first + k, chunks, bin + 1, push.bins)] - begins[k]; \
    }
    LOAD_STARTS(0) LOAD_STARTS(1) LOAD_STARTS(2) LOAD_STARTS(3)
    uint total, before = workgroup_exclusive_add(counts.x + counts.y + counts.z + counts.w, total);
#define PUT_CHUNK(k) \
    if (first + k < end) { \
        values[first + k] = before; \
        keys[first + k] = begins[k] - before; \
        before += counts[k]; \
    }
    PUT_CHUNK(0) PUT_CHUNK(1) PUT_CHUNK(2) PUT_CHUNK(3)
    for (uint i = chunks + lane(); i < chunk_places(); i += WORKGROUP) values[i] = NONE;
    barrier();
}

// Loads the depth key of every item. Items past the end load some key, which is not used.
void load_depths() {
#define LOAD_DEPTH(k) key[k] = depth_keys[value[k]];
    EACH_ITEM(LOAD_DEPTH)
}

// Loads the items of the run, which begins with entry `begin` of a list.
void load(uint begin) {
    // The last chunk list that begins at the entry or before it is not empty: the next one begins after it.
    uint first = begin + own;
    uvec4 source = uvec4(0);
    for (uint step = chunk_places() / 2; step > 0; step /= 2) {
#define HALVE(k) if (values[source[k] + step] <= first + k * gl_SubgroupSize) source[k] += step;
        EACH_ITEM(HALVE)
    }
    // The splats of all items before the first depth, so that the loads of each kind are under way at once.
#define LOAD_SPLAT(k) if (exists(k)) value[k] = unsorted[keys[source[k]] + first + k * gl_SubgroupSize];
    EACH_ITEM(LOAD_SPLAT)
    load_depths();
}

// Subtracts the lowest key from all keys. Returns the number of bits that the largest then has.
uint lower_keys() {
    if (lane() == 0) {
        lowest = NONE;
        highest = 0;
    }
    barrier();
    uint low = NONE, high = 0;
#define REACH(k) if (exists(k)) { low = min(low, key[k]); high = max(high, key[k]); }
    EACH_ITEM(REACH)
    low = subgroupMin(low);
    high = subgroupMax(high);
    // A minimum and a maximum: order does not matter.
    if (subgroupElect()) {
        atomicMin(lowest, low);
        atomicMax(highest, high);
    }
    barrier();
    // Items past the end take the largest digits, which come after every key that exists.
#define LOWER(k) key[k] = exists(k) ? key[k] - lowest : NONE;
    EACH_ITEM(LOWER)
    return uint(findMSB(highest - lowest) + 1);
}

// Sorts the run stably by its keys alone.
void sort_by_keys() {
    uint bits = lower_keys();
    for (uint shift = 0; shift < bits; shift += DIGIT_BITS) {
        sort_by_digit(shift);
        barrier();
    }
}

// Replaces BIN_RUN counts in `values`, from `first` on, by their exclusive sums.
void scan_counts(uint first) {
    const uint EACH = BIN_RUN / WORKGROUP;
    uint sum = 0, total;
    for (uint i = 0; i < EACH; i++) sum += values[first + lane() * EACH + i];
    uint before = workgroup_exclusive_add(sum, total);
    for (uint i = 0; i < EACH; i++) {
        uint here = values[first + lane() * EACH + i];
        values[first + lane() * EACH + i] = before;
        before += here;
    }
    barrier();
}

// The number of entries before a place, or before a part of the keys' range, by the sums from `first` on.
uint count_before(uint first, uint place) {
    return place < BIN_RUN ? values[first + place] : count;
}

// Puts every entry at the place that is expected if keys are spread evenly within each of BIN_RUN equal parts of their
// range. Leaves the number of entries before each place in `values`, from BIN_RUN on.
void sort_by_distribution() {
    uint bits = lower_keys(), shift = bits - min(bits, PLACE_BITS);
    for (uint i = lane(); i < 2 * BIN_RUN; i += WORKGROUP) values[i] = 0;
    barrier();
    // Counts, and ranks among entries that are sorted later: order does not matter.
#define COUNT_PART(k) if (exists(k)) atomicAdd(values[key[k] >> shift], 1);
    EACH_ITEM(COUNT_PART)
    barrier();
    scan_counts(0);
    uvec4 place, rank;
    // The product has at most 32 bits: `shift` <= 21 of the key and 11 of the count. A count has 12 bits only if all
    // keys are equal; the product is then 0.
#define EXPECT(k) \
    if (exists(k)) { \
        uint part = key[k] >> shift, before = values[part]; \
        uint here = min(count_before(0, part + 1) - before, BIN_RUN - 1); \
        place[k] = before + ((key[k] & ((1u << shift) - 1)) * here >> shift); \
        rank[k] = atomicAdd(values[BIN_RUN + place[k]], 1); \
    }
    EACH_ITEM(EXPECT)
    barrier();
    scan_counts(BIN_RUN);
#define PUT(k) \
    if (exists(k)) { \
        uint here = values[BIN_RUN + place[k]] + rank[k]; \
        keys[here] = key[k]; \
        values[here] = value[k]; \
    }
    EACH_ITEM(PUT)
    barrier();
}

// True if an entry comes before another, by depth and then by Gaussian.
bool is_before(uint one_key, uint one_value, uint other_key, uint other_value) {
    if (one_key != other_key) return one_key < other_key;
    return gaussian_from_splat[one_value] < gaussian_from_splat[other_value];
}

// Sorts `few` entries from `first` on by insertion.
void sort_few(uint first, uint few) {
    for (uint i = first + 1; i < first + few; i++) {
        uint its_key = keys[i], its_value = values[i], place = i;
        while (place > first && is_before(its_key, its_value, keys[place - 1], values[place - 1])) {
            keys[place] = keys[place - 1];
            values[place] = values[place - 1];
            place--;
        }
        keys[place] = its_key;
        values[place] = its_value;
    }
}

void main() {
    uint run = workgroup();
    if (IS_SURPLUS(dispatches.runs)) return;
    uint number = run_bins[run];
    load_chunk_lists(number);
    Bin bin = bins[number];
    uint begin = (run - bin.first_run) * BIN_RUN;
    count = min(bin.count - begin, BIN_RUN);
    items = div_up(count, WORKGROUP);
    own = gl_SubgroupID * gl_SubgroupSize * items + gl_SubgroupInvocationID;
    value = uvec4(0);
    load(begin);
    if (lane() == 0) is_crowded = 0;
    sort_by_distribution();
    for (uint i = lane(); i < count; i += WORKGROUP) {
        uint begins = values[BIN_RUN + i], here = count_before(BIN_RUN, i + 1) - begins;
        if (here > SHARED_ALONE) is_crowded = 1;
        if (here > 1 && here <= SHARED_ALONE) sort_few(begins, here);
    }
    barrier();
    if (is_crowded == 1) {
        // The sort by Gaussian comes first: the sort by depth is stable and keeps its order at equal depths.
#define LOAD_GAUSSIAN(k) key[k] = gaussian_from_splat[value[k]];
        EACH_ITEM(LOAD_GAUSSIAN)
        sort_by_keys();
        load_depths();
        sort_by_keys();
#define KEEP(k) keys[own + k * gl_SubgroupSize] = key[k]; values[own + k * gl_SubgroupSize] = value[k];
        EACH_ITEM(KEEP)
        barrier();
    }
    bool alone = bin.count <= BIN_RUN;
    for (uint i = lane(); i < count; i += WORKGROUP) {
        if (alone) {
            splat_ids[bin.first + i] = values[i];
        } else {
            entries[bin.first + begin + i] = uvec2(keys[i] + lowest, values[i]);
        }
    }
}
