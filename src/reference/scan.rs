//! Exclusive prefix sum.

/// Offset of each element when element `i` takes `counts[i]` places, and at the end the sum of all.
pub fn scan(counts: &[u32]) -> Vec<u64> {
    let mut offsets = vec![0];
    let mut sum = 0;
    for count in counts {
        sum += u64::from(*count);
        offsets.push(sum);
    }
    offsets
}
