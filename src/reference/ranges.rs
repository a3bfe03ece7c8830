//! Finds the range of instances of each tile.

/// First and one past the last instance of each of `tiles` tiles; an empty tile has (0, 0).
///
/// `tile_keys` must be sorted.
///
/// # Panics
/// If a key is not below `tiles`.
pub fn ranges(tile_keys: &[u32], tiles: usize) -> Vec<[u32; 2]> {
    let mut ranges = vec![[0, 0]; tiles];
    let mut begin = 0;
    for run in tile_keys.chunk_by(|a, b| a == b) {
        let end = begin + run.len() as u32;
        ranges[run[0] as usize] = [begin, end];
        begin = end;
    }
    ranges
}
