//! Exclusive prefix sum.

/// Where each element's run begins when run `i` has `counts[i]` places; one more entry for the end of the last.
pub fn scan(counts: &[u32]) -> Vec<u64> {
    let mut offsets = vec![0];
    let mut sum = 0;
    for count in counts {
        sum += u64::from(*count);
        offsets.push(sum);
    }
    offsets
}
