// Exclusive sum of `length` elements of `sums`, a buffer that the including shader declares, from `first` on, in place,
// by one workgroup. Returns the total.
const uint SCAN_ITEMS = 8;  // consecutive elements a lane, so that one round covers 2048

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
