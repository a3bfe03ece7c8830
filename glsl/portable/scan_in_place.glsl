// The exclusive prefix sum of a part of a buffer, in place, by one workgroup.
// Requires: workgroup.glsl, sums[]

const uint SCAN_ITEMS = 8;  // consecutive elements of a lane; one round covers 2048

// Replaces `length` elements of `sums`, from `first` on, by their exclusive sums. Returns the total. The whole
// workgroup must call it.
uint scan_in_place(uint first, uint length) {
    uint carry = 0;
    for (uint base = 0; base < length; base += WORKGROUP * SCAN_ITEMS) {
        uint start = base + lane() * SCAN_ITEMS;
        uint items[SCAN_ITEMS];
        uint sum = 0;
        for (uint k = 0; k < SCAN_ITEMS; k++) {
            items[k] = start + k < length ? sums[first + start + k] : 0;
            sum += items[k];
        }
        uint total;
        uint before = carry + workgroup_exclusive_add(sum, total);
        for (uint k = 0; k < SCAN_ITEMS; k++) {
            if (start + k < length) sums[first + start + k] = before;
            before += items[k];
        }
        carry += total;
    }
    return carry;
}
