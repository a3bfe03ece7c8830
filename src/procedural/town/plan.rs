//! The plan of the town: streets between lines of an irregular grid, blocks in the order of a space-filling curve, and
//! the houses and trees of each block. It is small at any count: some thirty houses a block.

use glam::{DVec2, DVec3, dvec2, dvec3};

use super::hilbert;
use super::layout::{Block, FLOOR, GROUND_FLOOR, House, Manner, PITCH, Rect, Roof, Side, Street, Tree, Use, dice};
use crate::scene::Random;

/// Depth of a house from the street to the courtyard, metres.
pub const DEPTH: f64 = 11.0;

/// The plan of a town of `side` by `side` blocks around the origin.
#[derive(Debug)]
pub struct Layout {
    pub side: usize,
    /// Streets of constant x, and of constant z: one more than blocks.
    pub streets: [Vec<Street>; 2],
    /// In the order of the curve.
    pub blocks: Vec<Block>,
    /// The position in `blocks` of each cell, row by row.
    order: Vec<usize>,
}

impl Layout {
    pub fn new(side: usize) -> Self {
        let streets = [0, 1].map(|axis| (0..=side).map(|i| street(axis, i, side)).collect::<Vec<_>>());
        let cells = hilbert::cells(side);
        let mut order = vec![0; side * side];
        for (position, [i, j]) in cells.iter().enumerate() {
            order[j * side + i] = position;
        }
        let blocks = cells.iter().map(|[i, j]| block(&streets, [*i, *j], side)).collect();
        Self { side, streets, blocks, order }
    }

    /// Half the extent of the town, metres.
    pub fn half(&self) -> f64 {
        0.5 * PITCH * self.side as f64
    }

    /// The block whose cell contains this place.
    pub fn block_at(&self, at: DVec2) -> Option<&Block> {
        let cell = |axis: usize| {
            let streets = &self.streets[axis];
            let above = streets.partition_point(|street| street.at <= at[axis]);
            (1..=self.side).contains(&above).then(|| above - 1)
        };
        let (i, j) = (cell(0)?, cell(1)?);
        Some(&self.blocks[self.order[j * self.side + i]])
    }

    /// The height of the houses at this place; 0 in streets, yards and outside.
    pub fn height(&self, at: DVec2) -> f64 {
        let Some(block) = self.block_at(at).filter(|block| block.rect.contains(at)) else { return 0.0 };
        let houses = block.houses.iter().filter(|house| house.rect.contains(at));
        houses.map(|house| house.height(at)).fold(0.0, f64::max)
    }

    /// True if this point is in a house.
    pub fn is_in_house(&self, point: DVec3) -> bool {
        -point.y < self.height(dvec2(point.x, point.z))
    }

    /// The part of the sunlight that reaches a point, from 0 to 1: houses and trees cast shadows.
    pub fn sunlight(&self, point: DVec3, to_sun: DVec3) -> f64 {
        let highest = 70.0; // metres, over the top of every tower
        for distance in [0.7, 1.6, 2.8, 4.4, 6.4, 9.0, 12.0, 16.0, 21.0, 28.0, 37.0, 48.0, 60.0] {
            let at = point + distance * to_sun;
            if -at.y > highest {
                break;
            }
            if self.is_in_house(at) {
                return 0.0;
            }
        }
        let Some(block) = self.block_at(dvec2(point.x, point.z)) else { return 1.0 };
        let through = |tree: &Tree| {
            let centre = dvec3(tree.at.x, -tree.height, tree.at.y) - point;
            let along = centre.dot(to_sun);
            let miss = (centre - along * to_sun).length() / tree.radius;
            if along > 0.5 * tree.radius && miss < 1.0 { 0.35 + 0.65 * miss.powi(4) } else { 1.0 }
        };
        block.trees.iter().map(through).fold(1.0, f64::min)
    }
}

/// One street in five of those along z is an avenue.
fn street(axis: usize, number: usize, side: usize) -> Street {
    let mut dice = dice(number * 2 + axis);
    let at = (number as f64 - 0.5 * side as f64 + 0.22 * (dice.unit() - 0.5)) * PITCH;
    let (half, road) = if axis == 0 && number % 5 == 3 { (13.0, 8.0) } else { (6.6 + dice.unit(), 4.3) };
    Street { at, half, road }
}

fn block(streets: &[Vec<Street>; 2], [i, j]: [usize; 2], side: usize) -> Block {
    let [west, east, north, south] = [streets[0][i], streets[0][i + 1], streets[1][j], streets[1][j + 1]];
    let cell = Rect { low: dvec2(west.at, north.at), high: dvec2(east.at, south.at) };
    let rect = Rect { low: cell.low + dvec2(west.half, north.half), high: cell.high - dvec2(east.half, south.half) };
    let seed = 1 << 12 | j << 24 | i << 16;
    let middle = (side / 2) % 4;
    let kind = match [i % 4, j % 4] {
        at if at == [middle, middle] => Use::Square,
        at if at == [(middle + 3) % 4, (middle + 1) % 4] => Use::Park,
        _ if dice(seed).unit() < 0.16 => Use::Tower,
        _ => Use::Houses,
    };
    let houses = match kind {
        Use::Houses => houses_around(&rect, seed),
        Use::Tower => tower(&rect, seed),
        Use::Square => church(&rect, seed),
        Use::Park => Vec::new(),
    };
    let roads = [west.road, east.road, north.road, south.road];
    let mut block = Block { kind, cell, rect, roads, houses, trees: Vec::new(), seed };
    block.trees = trees(&block);
    block
}

/// Four rows of houses; the corners belong to the rows along x.
fn houses_around(rect: &Rect, seed: usize) -> Vec<House> {
    let inner = rect.shrunk(DEPTH);
    let mut houses = Vec::new();
    for (row, axis) in [0, 0, 1, 1].into_iter().enumerate() {
        let (from, to) = if axis == 0 { (rect.low.x, rect.high.x) } else { (inner.low.y, inner.high.y) };
        let is_low = row % 2 == 0;
        let count = ((to - from) / 12.5).round().max(1.0) as usize;
        let mut dice = dice(seed + 64 * row);
        let cut = |k: usize, dice: &mut Random| {
            let inside = if k == 0 || k == count { 0.0 } else { 0.3 * (dice.unit() - 0.5) };
            from + (to - from) * (k as f64 + inside) / count as f64
        };
        let mut begin = cut(0, &mut dice);
        let first = houses.len();
        for k in 0..count {
            let end = cut(k + 1, &mut dice);
            let floors = 3.0 + (2.7 * dice.unit()).floor() + f64::from(u8::from(dice.unit() < 0.2));
            let eaves = GROUND_FLOOR + (floors - 1.0) * FLOOR + 0.5 + 0.4 * dice.unit();
            let across = if axis == 0 { [rect.low.y, rect.high.y] } else { [rect.low.x, rect.high.x] };
            let [near, far] = if is_low { [across[0], across[0] + DEPTH] } else { [across[1] - DEPTH, across[1]] };
            let [low, high] =
                [dvec2(begin, near), dvec2(end, far)].map(|p| if axis == 0 { p } else { dvec2(p.y, p.x) });
            let is_flat = dice.unit() < 0.25;
            let mut sides = [Side::Neighbour(0.0); 4];
            let outer = 2 * (1 - axis) + usize::from(!is_low);
            sides[outer] = Side::Street;
            sides[outer ^ 1] = Side::Yard;
            if axis == 0 && k == 0 {
                sides[0] = Side::Street;
            }
            if axis == 0 && k + 1 == count {
                sides[1] = Side::Street;
            }
            let top = eaves + if is_flat { 0.0 } else { 2.6 + 1.6 * dice.unit() };
            let roof = if is_flat { Roof::Flat } else { Roof::Gable(axis) };
            let seed = seed + 64 * row + k;
            houses.push(House {
                rect: Rect { low, high },
                base: 0.0,
                eaves,
                top,
                roof,
                sides,
                seed,
                manner: Manner::Town,
            });
            begin = end;
        }
        for k in first + 1..houses.len() {
            let [left, right] = [houses[k - 1].eaves, houses[k].eaves];
            houses[k - 1].sides[2 * axis + 1] = Side::Neighbour(right);
            houses[k].sides[2 * axis] = Side::Neighbour(left);
        }
    }
    houses
}

fn tower(rect: &Rect, seed: usize) -> Vec<House> {
    let mut dice = dice(seed + 1);
    let floors = 9.0 + (6.0 * dice.unit()).floor();
    let base = GROUND_FLOOR + FLOOR + 0.8;
    let corner = dvec2(0.12 + 0.2 * dice.unit(), 0.12 + 0.2 * dice.unit());
    let shaft = rect.part(corner, corner + dvec2(0.5, 0.45));
    let sides = [Side::Street; 4];
    let house = |rect: Rect, base: f64, eaves: f64, seed| House {
        rect,
        base,
        eaves,
        top: eaves,
        roof: Roof::Flat,
        sides,
        seed,
        manner: Manner::Modern,
    };
    vec![house(*rect, 0.0, base, seed), house(shaft, base - 0.5, base + floors * FLOOR + 1.0, seed + 1)]
}

/// A nave and a tower with a spire.
fn church(rect: &Rect, seed: usize) -> Vec<House> {
    let middle = rect.centre();
    let around = |at: DVec2, half: DVec2| Rect { low: at - half, high: at + half };
    let nave = around(middle + dvec2(4.0, 2.0), dvec2(11.0, 5.5));
    let belfry = around(middle + dvec2(-10.2, 2.0), dvec2(3.4, 3.4));
    let sides = [Side::Street; 4];
    vec![
        House {
            rect: nave,
            base: 0.0,
            eaves: 10.0,
            top: 16.5,
            roof: Roof::Gable(0),
            sides,
            seed,
            manner: Manner::Church,
        },
        House {
            rect: belfry,
            base: 0.0,
            eaves: 25.0,
            top: 38.0,
            roof: Roof::Spire,
            sides,
            seed,
            manner: Manner::Church,
        },
    ]
}

fn trees(block: &Block) -> Vec<Tree> {
    let mut dice = dice(block.seed + 2);
    let mut places = Vec::new();
    let (rect, cell) = (&block.rect, &block.cell);
    let mut scatter = |area: Rect, count: usize, dice: &mut Random| {
        places.extend((0..count).map(|_| area.low + area.size() * dvec2(dice.unit(), dice.unit())));
    };
    match block.kind {
        Use::Houses => scatter(rect.shrunk(DEPTH + 3.5), 3, &mut dice),
        Use::Park => scatter(rect.shrunk(3.0), 30, &mut dice),
        _ => {}
    }
    if block.kind == Use::Square {
        let frame = rect.shrunk(3.5);
        places.extend((0..5).flat_map(|k| {
            let along = frame.low.x + frame.size().x * f64::from(k) / 4.0;
            [dvec2(along, frame.low.y), dvec2(along, frame.high.y)]
        }));
    }
    // Rows along avenues: on the pavement, one metre from the kerb.
    for (side, sign) in [(0, 1.0), (1, -1.0)] {
        let (at, road) = (if side == 0 { cell.low.x } else { cell.high.x }, block.roads[side]);
        if road > 6.0 {
            let count = (rect.size().y / 9.0) as usize;
            let along = |k: usize| rect.low.y + rect.size().y * (k as f64 + 0.5) / count as f64;
            places.extend((0..count).map(|k| dvec2(at + sign * (road + 1.2), along(k))));
        }
    }
    // The pond of the park stays free, and trees keep away from houses.
    let is_free = |at: &DVec2| block.kind != Use::Park || at.distance(rect.centre()) > 9.0;
    let tree = |(k, at): (usize, DVec2)| {
        let radius = 2.0 + 1.1 * dice.unit();
        Tree { at, height: 2.0 + radius + 0.8 * dice.unit(), radius, seed: block.seed + 256 + k }
    };
    places.into_iter().filter(is_free).enumerate().map(tree).collect()
}
