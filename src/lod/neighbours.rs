//! Approximate nearest neighbours of points, found by their order along shifted Morton curves.

use super::node::corners;
use crate::scene::Curve;

/// Candidates before and after a point along each curve.
const WINDOW: usize = 6;
/// Shifts of the boxes of the curves, as fractions of the box: neighbours on both sides of a border of one curve are
/// close on another.
const SHIFTS: [f32; 3] = [0.0, 0.31, 0.17];

/// For each point, the indices of points near it, ascending.
pub fn neighbours(points: &[[f32; 3]]) -> Vec<Vec<u32>> {
    let (low, high) = corners(points.iter().copied());
    // A cube, so that cells of the curve are cubes.
    let side = (0..3).map(|i| high[i] - low[i]).fold(f32::MIN_POSITIVE, f32::max);
    let mut found = vec![Vec::with_capacity(2 * WINDOW * SHIFTS.len()); points.len()];
    for shift in SHIFTS {
        let from = low.map(|v| v - shift * side);
        let curve = Curve::through(from, from.map(|v| v + 2.0 * side));
        let mut order: Vec<(u64, u32)> = (0..points.len()).map(|i| (curve.key(points[i]), i as u32)).collect();
        order.sort_unstable();
        for place in 0..order.len() {
            let around = place.saturating_sub(WINDOW)..(place + WINDOW + 1).min(order.len());
            let own = order[place].1;
            found[own as usize].extend(order[around].iter().map(|(_, other)| *other).filter(|other| *other != own));
        }
    }
    for list in &mut found {
        list.sort_unstable();
        list.dedup();
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn most_of_the_nearest_are_found() {
        let noise = |i: u32| (i.wrapping_mul(2_654_435_761) >> 8 & 0xffff) as f32 / 65536.0;
        let points: Vec<[f32; 3]> = (0..800).map(|i| [noise(3 * i), noise(3 * i + 1), noise(3 * i + 2)]).collect();
        let near = neighbours(&points);
        let distance = |a: usize, b: usize| (0..3).map(|i| (points[a][i] - points[b][i]).powi(2)).sum::<f32>();
        let found = (0..points.len()).filter(|own| {
            let others = (0..points.len()).filter(|other| other != own);
            let nearest = others.min_by(|a, b| distance(*own, *a).total_cmp(&distance(*own, *b))).unwrap();
            near[*own].contains(&(nearest as u32))
        });
        assert!(found.count() > 700);
        assert!(near.iter().enumerate().all(|(own, list)| !list.contains(&(own as u32)) && list.is_sorted()));
        assert_eq!(neighbours(&[[1.0; 3]]), [Vec::<u32>::new()]);
        assert_eq!(neighbours(&[[1.0; 3]; 2]), [[1], [0]], "points in one place");
    }
}
