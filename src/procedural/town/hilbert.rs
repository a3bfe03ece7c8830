//! The Hilbert curve through a square of cells.

/// The cells of a square of `side` by `side` in the order of the Hilbert curve through the next larger power of two.
pub fn cells(side: usize) -> Vec<[usize; 2]> {
    let whole = side.next_power_of_two();
    let cells = (0..whole * whole).map(|at| cell(at, whole));
    cells.filter(|cell| cell.iter().all(|at| *at < side)).collect()
}

/// The cell at a position of the curve through `side` by `side` cells, a power of two.
fn cell(position: usize, side: usize) -> [usize; 2] {
    let ([mut x, mut y], mut rest) = ([0, 0], position);
    let mut size = 1;
    while size < side {
        let right = rest / 2 % 2;
        let up = (rest ^ right) % 2;
        if up == 0 {
            if right == 1 {
                (x, y) = (size - 1 - x, size - 1 - y);
            }
            (x, y) = (y, x);
        }
        (x, y) = (x + size * right, y + size * up);
        rest /= 4;
        size *= 2;
    }
    [x, y]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_curve_meets_every_cell_and_steps_to_neighbours() {
        for side in [1, 2, 3, 4, 7, 8, 16] {
            let cells = cells(side);
            let mut sorted = cells.clone();
            sorted.sort_unstable();
            sorted.dedup();
            assert_eq!(sorted.len(), side * side);
            let step = |pair: &[[usize; 2]]| pair[0][0].abs_diff(pair[1][0]) + pair[0][1].abs_diff(pair[1][1]);
            assert!(!side.is_power_of_two() || cells.windows(2).all(|pair| step(pair) == 1), "{side}");
        }
    }
}
