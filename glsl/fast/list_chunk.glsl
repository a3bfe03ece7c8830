// Lists the splats of a chunk in their bins.
// Requires: the bindings and push constants of fast/list.comp, and as a macro
//   IS_LISTED(bin)  false for bins whose lists stay empty

shared uint next[MAX_BINS];  // the entries counted in each bin; then the next one to write
shared uint region;          // the first entry of the chunk

void visit(uint bin, uint splat, bool writes) {
    if (!IS_LISTED(bin)) return;
    uint entry = atomicAdd(next[bin], 1);  // any order is right: sort orders the entries
    if (writes) unsorted[entry] = splat;
}

#include "fast/walk_bins.glsl"

void main() {
    uint visible = min(counters.visible, push.visible_capacity);
    uint chunk = workgroup(), chunks = bin_chunks(visible, push.bins), each = div_up(visible, chunks);
    if (chunk >= chunks) return;
    uint first = min(visible, chunk * each), past = min(visible, first + each);
    for (uint bin = lane(); bin < push.bins; bin += WORKGROUP) next[bin] = 0;
    barrier();
    visit_splats(first, past, false);
    barrier();
    // Each lane handles consecutive bins, so that chunk lists lie in the order of the bins.
    uint bins = div_up(push.bins, WORKGROUP), begin = min(lane() * bins, push.bins), end = min(begin + bins, push.bins);
    uint mine = 0, all;
    for (uint bin = begin; bin < end; bin++) mine += next[bin];
    uint start = workgroup_exclusive_add(mine, all);
    // Counts, here and below: order does not matter, and neither does the order of the regions.
    if (start + mine < start) atomicAdd(counters.listed_high, 1);
    if (lane() == 0) {
        region = atomicAdd(counters.listed_low, all);
        if (region + all < region) atomicAdd(counters.listed_high, 1);
    }
    barrier();
    start += region;
    for (uint bin = begin; bin < end; bin++) {
        uint listed = next[bin];
        if (listed > 0) atomicAdd(listed_in_bins[bin], listed);
        list_starts[start_place(chunk, chunks, bin, push.bins)] = next[bin] = start;
        start += listed;
    }
    if (lane() == 0) list_starts[start_place(chunk, chunks, push.bins, push.bins)] = region + all;
    // A frame that needs more entries is drawn again.
    if (region > push.entry_capacity || all > push.entry_capacity - region) return;
    barrier();
    visit_splats(first, past, true);
}
