//! The ground of the town: roadways with markings, kerbs, pavements, the square, the park, courtyards.

use glam::{DVec2, DVec3, dvec3};

use super::layout::{Block, Use};

/// Height of a kerb, metres.
const KERB: f64 = 0.12;

/// A point of the ground.
pub struct Floor {
    pub albedo: DVec3,
    pub height: f64,
    /// Distances to the next edges along x and z, metres.
    pub edges: [f64; 2],
    pub gloss: f64,
}

fn floor(albedo: DVec3, height: f64, edges: [f64; 2]) -> Floor {
    Floor { albedo, height, edges, gloss: 0.02 }
}

/// A smooth pattern around 0, for stains and worn places.
fn blotch(at: DVec2) -> f64 {
    let wave = |x: f64, y: f64| (x * at.x + y * at.y).sin();
    0.3 * (wave(0.9, 0.37) + wave(-0.41, 1.13) + wave(2.3, -1.9) * wave(0.7, 0.3))
}

/// A number from 0 to 1 for each stone of this size.
fn stone(at: DVec2, size: DVec2) -> f64 {
    let row = (at.y / size.y).floor();
    let column = (at.x / size.x + 0.5 * row).floor();
    ((row * 12.9898 + column * 78.233).sin() * 43_758.545).fract().abs()
}

/// The street or the pavement in the cell of a block, outside of its facades.
pub fn street(block: &Block, at: DVec2) -> Floor {
    let cell = &block.cell;
    let from_low = at - cell.low;
    let from_high = cell.high - at;
    // The nearer street of each direction: the distance from its middle, and half the width of its roadway.
    let nearer = |low: f64, high: f64, roads: [f64; 2]| if low < high { (low, roads[0]) } else { (high, roads[1]) };
    let (across_x, road_x) = nearer(from_low.x, from_high.x, [block.roads[0], block.roads[1]]);
    let (across_z, road_z) = nearer(from_low.y, from_high.y, [block.roads[2], block.roads[3]]);
    let [on_x, on_z] = [across_x < road_x, across_z < road_z];
    if !on_x && !on_z {
        return pavement(at, [across_x - road_x, across_z - road_z]);
    }
    let worn = dvec3(0.37, 0.37, 0.38) * (1.0 + 0.10 * blotch(at) + 0.05 * blotch(3.1 * at));
    if on_x && on_z {
        return floor(worn, 0.0, [f64::INFINITY; 2]);
    }
    // Along the one street, `ahead` metres before the crossing with the other.
    let (across, road, ahead, is_along_z) =
        if on_x { (across_x, road_x, across_z - road_z, true) } else { (across_z, road_z, across_x - road_x, false) };
    let along = if is_along_z { at.y } else { at.x };
    let turned =
        |sideways: f64, lengthways: f64| if is_along_z { [sideways, lengthways] } else { [lengthways, sideways] };
    let white = dvec3(0.86, 0.86, 0.84) * (0.93 + 0.12 * blotch(2.0 * at));
    let tyre = 1.0 - 0.06 * (-((across - 0.45 * road) / 0.35).powi(2)).exp();
    if (1.0..4.2).contains(&ahead) {
        let bar = (across / 0.5 + 0.5).rem_euclid(2.0);
        let edge = 0.5 * (bar % 1.0).min(1.0 - bar % 1.0);
        let edges = turned(edge, (ahead - 1.0).min(4.2 - ahead));
        return floor(if bar < 1.0 && across < road - 0.3 { white } else { worn }, 0.0, edges);
    }
    if (5.0..5.35).contains(&ahead) && across < road - 0.3 {
        return floor(white, 0.0, turned(0.3, (ahead - 5.0).min(5.35 - ahead)));
    }
    let is_wide = road > 6.0;
    let line = if is_wide { (across - 0.15).abs() } else { across };
    let dash = (along / 3.0).rem_euclid(2.0);
    if line < 0.07 && ahead > 7.0 && (is_wide || dash < 1.0) {
        return floor(white, 0.0, turned(0.07 - line, 0.4));
    }
    let lane = (across - 0.5 * road).abs();
    if is_wide && lane < 0.07 && ahead > 7.0 && dash < 1.0 {
        return floor(white, 0.0, turned(0.07 - lane, 0.4));
    }
    let gutter = road - across;
    if gutter < 0.35 {
        return floor(0.8 * worn, 0.0, turned(gutter.min(0.35 - gutter), f64::INFINITY));
    }
    floor(worn * tyre, 0.0, turned((line - 0.07).abs().max(0.05), f64::INFINITY))
}

fn pavement(at: DVec2, from_kerb: [f64; 2]) -> Floor {
    let to_kerb = from_kerb[0].min(from_kerb[1]);
    if to_kerb < 0.22 {
        let edge = to_kerb.min(0.22 - to_kerb);
        let edges = if from_kerb[0] < from_kerb[1] { [edge, 0.6] } else { [0.6, edge] };
        return floor(dvec3(0.66, 0.65, 0.62), KERB, edges);
    }
    let slab = stone(at, DVec2::new(0.6, 0.4));
    let albedo = dvec3(0.56, 0.54, 0.51) * (0.93 + 0.10 * slab + 0.05 * blotch(at));
    floor(albedo, KERB, [0.4, 0.4])
}

/// The ground within the facades of a block.
pub fn inside(block: &Block, at: DVec2) -> Floor {
    match block.kind {
        Use::Park => park(block, at),
        Use::Square => square(block, at),
        Use::Houses | Use::Tower => {
            let grass = dvec3(0.27, 0.37, 0.17) * (1.0 + 0.2 * blotch(1.7 * at));
            let paved = dvec3(0.50, 0.47, 0.43) * (0.9 + 0.15 * stone(at, DVec2::splat(0.5)));
            let is_grass = blotch(0.25 * at) > -0.05;
            floor(if is_grass { grass } else { paved }, KERB, [f64::INFINITY; 2])
        }
    }
}

fn park(block: &Block, at: DVec2) -> Floor {
    let from = at - block.rect.centre();
    let radius = from.length();
    let grass = dvec3(0.30, 0.43, 0.17) * (1.0 + 0.16 * blotch(1.3 * at) + 0.08 * blotch(5.0 * at));
    let gravel = dvec3(0.72, 0.64, 0.50) * (1.0 + 0.06 * blotch(4.0 * at));
    if radius < 5.0 {
        let water = dvec3(0.20, 0.32, 0.38) * (1.0 + 0.05 * blotch(2.0 * at));
        return Floor { gloss: 0.4, ..floor(water, 0.02, [5.05 - radius; 2]) };
    }
    if radius < 5.5 {
        return floor(dvec3(0.68, 0.66, 0.62), 0.25, [0.12; 2]);
    }
    // A round path and two that cross.
    let diagonals = [(from.x - from.y).abs(), (from.x + from.y).abs()].map(|d| d / f64::sqrt(2.0) - 1.2);
    let ring = (radius - 7.5).abs() - 1.3;
    let path = diagonals[0].min(diagonals[1]).min(ring);
    floor(if path < 0.0 { gravel } else { grass }, KERB, [path.abs().max(0.06); 2])
}

/// Rings of light and dark stones around the church.
fn square(block: &Block, at: DVec2) -> Floor {
    let from = at - block.rect.centre();
    let ring = (from.x.abs().max(from.y.abs()) / 3.0).fract();
    let band = if ring < 0.14 { 0.72 } else { 1.0 };
    let albedo = dvec3(0.66, 0.60, 0.53) * band * (0.90 + 0.16 * stone(at, DVec2::new(0.35, 0.35)));
    floor(albedo, KERB, [0.3, 0.3])
}
