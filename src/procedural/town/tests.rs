//! The town is the same every time, ordered in space, as dense as stated, and its cameras stay outside of houses.

use glam::{DVec3, dvec3};

use crate::procedural::town::*;

/// A hash of the means in millimetres and of the colours, which rounding in the last bit does not change.
fn hash(count: usize, range: Range<usize>) -> u64 {
    let (gaussians, _) = fill(count, range).unwrap();
    let means = gaussians.means().iter().flatten().map(|v| f64::from(*v) * 1e3);
    let colours = (0..gaussians.len()).flat_map(|i| gaussians.sh(i)[0]).map(|v| f64::from(v) * 1e3);
    means.chain(colours).fold(0xcbf2_9ce4_8422_2325, |hash: u64, value| {
        (hash ^ value.round() as i64 as u64).wrapping_mul(0x0000_0100_0000_01b3)
    })
}

#[test]
fn the_town_is_the_same_on_every_machine() {
    let found = [hash(1000, 0..1000), hash(MAX_COUNT, 0..500), hash(MAX_COUNT, MAX_COUNT - 500..MAX_COUNT)];
    assert_eq!(found.map(|hash| format!("{hash:016x}")), ["bff6fac4dcc276bf", "4298f51b46d1ce29", "6823d1f832ffebd4"]);
}

#[test]
fn towns_of_any_count_are_whole() {
    for count in [1, 2, 1000, 70_001] {
        let (gaussians, report) = fill(count, 0..count).unwrap();
        assert_eq!((gaussians.len(), report.dropped(), report.clamped_scale), (count, 0, 0));
    }
    for begin in (0..MAX_COUNT).step_by(MAX_COUNT / 40) {
        let (gaussians, _) = fill(MAX_COUNT, begin..begin + 3).unwrap();
        assert_eq!((gaussians.len(), gaussians.sh_degree()), (3, SH_DEGREE));
    }
}

#[test]
fn a_million_gaussians_in_a_row_are_near_each_other() {
    let first = Town::new(MAX_COUNT).outside[2];
    for k in 1..30 {
        let begin = first + k * (MAX_COUNT - first) / 31;
        let at = |i: usize| fill(MAX_COUNT, begin + i * 50_000..begin + i * 50_000 + 1).unwrap().0.means()[0];
        let points: Vec<DVec3> = (0..20).map(|i| DVec3::from(at(i).map(f64::from))).collect();
        let low = points.iter().copied().reduce(DVec3::min).unwrap();
        let high = points.iter().copied().reduce(DVec3::max).unwrap();
        assert!((high - low).max_element() < 2.6 * layout::PITCH, "{begin}: {low} to {high}");
    }
}

#[test]
fn large_towns_have_the_stated_density() {
    for count in [110_000_000, 150_000_000, 300_000_000, MAX_COUNT] {
        let town = Town::new(count);
        let weight = |block| parts::parts(block).iter().map(|part| part.weight).sum::<f64>();
        let whole: f64 = town.layout.blocks.iter().map(weight).sum();
        let density = (count - town.outside[2]) as f64 / whole;
        assert!((1.0..1.6).contains(&density), "{count}: {density} of the stated density");
    }
}

#[test]
fn cameras_and_the_ways_between_them_are_outside_of_houses() {
    let around = [-0.7, 0.0, 0.7];
    for side in [4, 5, 6, 9, 13] {
        let layout = Layout::new(side);
        for path in ["street", "roof", "air"].map(|name| TownPath::named(name).unwrap()) {
            let eyes: Vec<DVec3> = path.views(&layout, 150).iter().map(|[eye, _]| *eye).collect();
            for pair in eyes.windows(2) {
                for step in 0..4 {
                    let eye = pair[0].lerp(pair[1], f64::from(step) / 4.0);
                    for offset in around.iter().flat_map(|x| around.map(|z| dvec3(*x, 0.0, z))) {
                        assert!(!layout.is_in_house(eye + offset), "{side} {} {eye}", path.name());
                    }
                }
            }
        }
    }
}

#[test]
fn a_walk_is_at_eye_level_and_turns_at_crossings() {
    let views = TownPath::Street.views(&Layout::new(4), 100);
    let ahead: Vec<DVec3> = views.iter().map(|[eye, target]| (target - eye).normalize()).collect();
    assert!(views.iter().all(|[eye, _]| eye.y == -1.7));
    assert!(ahead[0].x > 0.99 && ahead[99].x < -0.99, "there and back: {} {}", ahead[0], ahead[99]);
    assert!(ahead.windows(2).all(|pair| pair[0].dot(pair[1]) > 0.7), "no jumps");
}

#[test]
fn facades_face_streets_without_overlap_of_houses() {
    for block in &Layout::new(8).blocks {
        for (i, house) in block.houses.iter().enumerate() {
            let outside = (block.rect.low - house.rect.low).max(house.rect.high - block.rect.high);
            assert!(outside.max_element() < 1e-9, "{:?} in {:?}", house.rect, block.rect);
            let others = block.houses[i + 1..].iter().filter(|other| other.base == house.base);
            for other in others.filter(|_| block.kind == layout::Use::Houses) {
                let shared = house.rect.high.min(other.rect.high) - house.rect.low.max(other.rect.low);
                assert!(shared.min_element() < 1e-9, "{:?} {:?}", house.rect, other.rect);
            }
        }
    }
}
