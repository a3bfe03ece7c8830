//! The stages that the baseline runs on the CPU, in one thread. They use the decisions that the GPU stored: which
//! Gaussian is visible and which tiles a splat touches is never computed twice.

/// Writes the positions of the set bits of `masks` into `ids` in ascending order, as many as fit. Returns the number of
/// set bits.
pub fn compact(masks: &[u32], ids: &mut [u32]) -> usize {
    let mut count = 0;
    for (index, mask) in masks.iter().enumerate() {
        let mut rest = *mask;
        while rest != 0 {
            if let Some(id) = ids.get_mut(count) {
                *id = index as u32 * 32 + rest.trailing_zeros();
            }
            count += 1;
            rest &= rest - 1;
        }
    }
    count
}

/// Writes tile and splat of every instance, splat after splat, as many as fit. `span_ranges` has for every splat its
/// first span, and in 16 bits each its first tile row and number of rows; a span is a range of columns in a row, in 16
/// bits each. Returns the number of instances.
pub fn duplicate(
    span_ranges: &[[u32; 2]],
    spans: &[u32],
    tiles_x: u32,
    tile_keys: &mut [u32],
    splat_ids: &mut [u32],
) -> usize {
    let mut count = 0;
    for (splat, [first, rows]) in span_ranges.iter().enumerate() {
        let (first_row, rows) = (rows & 0xffff, rows >> 16);
        for row in 0..rows {
            let span = spans[(first + row) as usize];
            for column in span & 0xffff..span >> 16 {
                if let (Some(key), Some(id)) = (tile_keys.get_mut(count), splat_ids.get_mut(count)) {
                    (*key, *id) = ((first_row + row) * tiles_x + column, splat as u32);
                }
                count += 1;
            }
        }
    }
    count
}
