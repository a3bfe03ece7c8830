//! The parts of a block, in spatial order: ground, houses one after another, trees, cars, lamps.

use glam::{DVec2, DVec3, dvec2, dvec3};

use super::facade::Style;
use super::layout::{Block, GROUND_FLOOR, House, Manner, Rect, Roof, Side, Use, dice};
use super::objects::{CAR_AREA, Car, Cuboid, LAMP_AREA, lamp, tree, tree_area};
use super::plan::{DEPTH, Layout};
use super::splat::{Layer, Spot};
use super::{ground, roof};
use crate::scene::Random;

/// Splats per square metre of the largest towns, which get denser only when the town grows no more. Smaller ones have
/// the same ratios.
mod density {
    pub const GROUND_FLOOR: f64 = 2000.0;
    pub const FACADE: f64 = 700.0;
    pub const YARD_WALL: f64 = 300.0;
    pub const ROOF: f64 = 250.0;
    pub const STREET: f64 = 550.0;
    pub const YARD: f64 = 250.0;
    pub const TREE: f64 = 500.0;
    pub const THING: f64 = 2200.0;
}

/// Fraction of stray splats in the air of a block.
const STRAY: f64 = 0.01;

/// A part of a block.
pub struct Part {
    piece: Piece,
    /// Area that its splats cover together, metres squared.
    pub area: f64,
    /// Weight of its number of Gaussians.
    pub weight: f64,
    has_backing: bool,
}

enum Piece {
    Ground { rect: Rect, is_street: bool },
    Wall { house: House, style: Style, side: usize, from: f64, to: f64 },
    Roof { house: House, style: Style, slope: usize },
    Tree(usize),
    Car(Car),
    Lamp(DVec2),
    Cuboid(Cuboid),
    Strays,
}

/// Where a splat is in its part: its layer, its position in it, and the number of splats in it.
pub struct Place {
    pub layer: Layer,
    position: usize,
    pub count: usize,
}

impl Part {
    fn new(piece: Piece, area: f64, density: f64) -> Self {
        let has_backing = !matches!(piece, Piece::Tree(_) | Piece::Lamp(_) | Piece::Strays);
        Self { piece, area, weight: area * density, has_backing }
    }

    /// The place of splat `position` of `count`.
    pub fn place(&self, position: usize, count: usize) -> Place {
        if matches!(self.piece, Piece::Strays) {
            return Place { layer: Layer::Stray, position, count };
        }
        let behind = if self.has_backing { (count as f64 * super::splat::BACKING).round() as usize } else { 0 };
        if position < behind {
            return Place { layer: Layer::Backing, position, count: behind };
        }
        Place { layer: Layer::Front, position: position - behind, count: count - behind }
    }

    /// The spot of a splat, and the distance of its neighbours in metres.
    pub fn spot(&self, layout: &Layout, block: &Block, random: &mut Random, place: &Place) -> (Spot, f64) {
        let spacing = (self.area / place.count as f64).sqrt();
        let at = spread(random, place);
        let spot = match &self.piece {
            Piece::Ground { rect, is_street } => {
                ground_spot(block, rect.low + DVec2::from(at) * rect.size(), *is_street)
            }
            Piece::Wall { house, style, side, from, to } => {
                let mut spot = wall(house, style, *side, [*from, *to], at, spacing);
                if place.layer == Layer::Backing {
                    // It has the edges of the whole wall, not those of windows.
                    let up =
                        (house.height(DVec2::new(spot.point.x, spot.point.z)).max(house.eaves) + spot.point.y).max(0.0);
                    spot.albedo = style.ground();
                    (spot.grain, spot.limits) = (DVec3::Y, [up, f64::INFINITY]);
                    spot.gloss = 0.0;
                }
                spot
            }
            Piece::Roof { house, style, slope } => roof::spot(house, style, *slope, at),
            Piece::Tree(number) => tree(&block.trees[*number], random, at),
            Piece::Car(car) => car.spot(at),
            Piece::Lamp(post) => lamp(*post, at),
            Piece::Cuboid(cuboid) => cuboid.spot(at[0], at[1]),
            Piece::Strays => return (stray(layout, block, random), 0.12),
        };
        let is_open = matches!(self.piece, Piece::Ground { .. });
        let limits = if is_open && place.layer == Layer::Backing { [f64::INFINITY; 2] } else { spot.limits };
        (Spot { limits, ..spot }, spacing)
    }
}

/// Two numbers from 0 to 1, even over all splats of a layer: Roberts' R2 sequence with some disorder.
fn spread(random: &mut Random, place: &Place) -> [f64; 2] {
    let disorder = 0.25 / (place.count as f64).sqrt();
    [0.754_877_666_246_692_7, 0.569_840_290_998_053_2].map(|step| {
        let at = (0.5 + step * (place.position + 1) as f64).fract() + disorder * (2.0 * random.unit() - 1.0);
        at.clamp(0.0, 1.0)
    })
}

fn ground_spot(block: &Block, at: DVec2, is_street: bool) -> Spot {
    let floor = if is_street { ground::street(block, at) } else { ground::inside(block, at) };
    let mut spot = Spot::matte(dvec3(at.x, -floor.height, at.y), DVec3::NEG_Y, DVec3::X, floor.albedo);
    let [x, z] = floor.edges.map(|edge| 0.55 * edge);
    (spot.grain, spot.limits) = if x >= z { (DVec3::X, [x, z]) } else { (DVec3::Z, [z, x]) };
    spot.gloss = floor.gloss;
    spot
}

/// A spot of a wall: below the eaves or, at the end of a gable, below the roof.
fn wall(house: &House, style: &Style, side: usize, [from, to]: [f64; 2], [u, v]: [f64; 2], spacing: f64) -> Spot {
    let (axis, is_high, rect) = (side / 2, side % 2 == 1, &house.rect);
    let length = rect.size()[1 - axis];
    let mut at = rect.low;
    at[axis] = if is_high { rect.high[axis] } else { rect.low[axis] };
    at[1 - axis] += u * length;
    let to = if to > house.eaves { house.height(at).max(house.eaves) } else { to };
    let height = from + v * (to - from);
    let mut normal = DVec3::ZERO;
    normal[2 * axis] = if is_high { 1.0 } else { -1.0 };
    let along = [u * length, height];
    let is_blind = matches!(house.sides[side], Side::Neighbour(_)) || height > house.eaves;
    let texel = if is_blind {
        style.plain(along, [f64::INFINITY; 2], spacing)
    } else {
        style.facade(along, length, house.eaves, spacing)
    };
    let point = dvec3(at.x, -height, at.y) + texel.relief * normal;
    let sideways = if axis == 0 { DVec3::Z } else { DVec3::X };
    // Splats end at the edges of the wall, too.
    let above = to - height;
    let beside = if height > house.eaves { above * 0.5 * length / (house.top - house.eaves) } else { f64::INFINITY };
    let outer = [(u.min(1.0 - u) * length).min(beside).max(0.02), above.max(0.02)];
    let [x, y] = [0, 1].map(|k| 0.55 * texel.edges[k].min(outer[k]));
    let mut spot = Spot::matte(point, normal, if x > y { sideways } else { DVec3::Y }, texel.albedo);
    spot.limits = if x > y { [x, y] } else { [y, x] };
    spot.gloss = texel.gloss;
    spot
}

/// A stray splat in the air, above the ground or the roofs.
fn stray(layout: &Layout, block: &Block, random: &mut Random) -> Spot {
    let at = block.cell.low + block.cell.size() * dvec2(random.unit(), random.unit());
    let height = layout.height(at) + 0.2 + 12.0 * random.unit().powi(2);
    let tone = dvec3(0.66, 0.66, 0.66) + 0.1 * random.direction();
    let mut spot = Spot::matte(dvec3(at.x, -height, at.y), random.direction(), random.direction(), tone);
    spot.shape = dvec3(0.4, 0.2, 0.05);
    spot.lighting = super::splat::Lighting::Unlit;
    spot.gloss = 0.0;
    spot
}

/// All parts of a block.
pub fn parts(block: &Block) -> Vec<Part> {
    let mut parts = Vec::new();
    grounds(block, &mut parts);
    block.houses.iter().for_each(|house| house_parts(house, &mut parts));
    furniture(block, &mut parts);
    let tree = |(number, tree)| Part::new(Piece::Tree(number), tree_area(tree), density::TREE);
    parts.extend(block.trees.iter().enumerate().map(tree));
    cars(block, &mut parts);
    let strays = STRAY * parts.iter().map(|part| part.weight).sum::<f64>();
    parts.push(Part { piece: Piece::Strays, area: 1.0, weight: strays, has_backing: false });
    parts
}

fn grounds(block: &Block, parts: &mut Vec<Part>) {
    let (cell, rect) = (&block.cell, &block.rect);
    let strips = [
        (cell.low, dvec2(cell.high.x, rect.low.y)),
        (dvec2(cell.low.x, rect.high.y), cell.high),
        (dvec2(cell.low.x, rect.low.y), dvec2(rect.low.x, rect.high.y)),
        (dvec2(rect.high.x, rect.low.y), dvec2(cell.high.x, rect.high.y)),
    ];
    let mut add = |rect: Rect, is_street, density| {
        let size = rect.size();
        parts.push(Part::new(Piece::Ground { rect, is_street }, size.x * size.y, density));
    };
    strips.into_iter().for_each(|(low, high)| add(Rect { low, high }, true, density::STREET));
    match block.kind {
        Use::Houses => add(Rect { low: rect.low + DEPTH, high: rect.high - DEPTH }, false, density::YARD),
        Use::Park | Use::Square => add(*rect, false, density::STREET),
        Use::Tower => {}
    }
}

fn house_parts(house: &House, parts: &mut Vec<Part>) {
    let style = Style::of(house);
    for (side, kind) in house.sides.into_iter().enumerate() {
        let (length, foot) = (house.rect.size()[1 - side / 2], house.base);
        let is_gable = house.roof == Roof::Gable(side / 2);
        let eaves = house.eaves + if house.roof == Roof::Flat { 0.6 } else { 0.0 };
        let mean_top = if is_gable { 0.5 * (eaves + house.top) } else { eaves };
        let to = if is_gable { house.top } else { house.eaves };
        let mut add = |from: f64, to: f64, mean: f64, density: f64| {
            if mean - from > 0.05 {
                let piece = Piece::Wall { house: *house, style, side, from, to };
                parts.push(Part::new(piece, length * (mean - from), density));
            }
        };
        match kind {
            Side::Street if foot < GROUND_FLOOR => {
                add(foot, GROUND_FLOOR, GROUND_FLOOR, density::GROUND_FLOOR);
                add(GROUND_FLOOR, to, mean_top, density::FACADE);
            }
            Side::Street => add(foot, to, mean_top, density::FACADE),
            Side::Yard => add(foot, to, mean_top, density::YARD_WALL),
            Side::Neighbour(height) => add(height.min(house.eaves - 0.2), to, mean_top, density::YARD_WALL),
        }
    }
    for slope in 0..roof::slopes(house) {
        let area = roof::area(house);
        parts.push(Part::new(Piece::Roof { house: *house, style, slope }, area, density::ROOF));
    }
    let mut dice = dice(house.seed + (1 << 33));
    let count = if house.roof == Roof::Spire { 0 } else { 1 + (2.0 * dice.unit()) as usize };
    for _ in 0..count {
        let at = house.rect.low + house.rect.size() * dvec2(0.15 + 0.7 * dice.unit(), 0.4 + 0.2 * dice.unit());
        let foot = dvec3(at.x, 0.3 - house.height(at), at.y);
        let is_modern = house.manner == Manner::Modern || house.roof == Roof::Flat;
        let (half, colour) = if is_modern {
            (dvec2(1.0 + dice.unit(), 0.8 + dice.unit()), dvec3(0.62, 0.63, 0.64))
        } else {
            (dvec2(0.45, 0.35), dvec3(0.50, 0.30, 0.24))
        };
        let chimney = Cuboid { foot, half, height: 1.7 + 0.5 * dice.unit(), colour, top: 0.5 * colour };
        parts.push(Part::new(Piece::Cuboid(chimney), chimney.area(), density::ROOF));
    }
}

/// Lamps at the kerbs, and the stalls of the square.
fn furniture(block: &Block, parts: &mut Vec<Part>) {
    let (rect, cell) = (&block.rect, &block.cell);
    for k in 0..4 {
        let t = rect.low.x + rect.size().x * (f64::from(k) + 0.3) / 4.0;
        let at = if k % 2 == 0 { cell.low.y + block.roads[2] + 0.6 } else { cell.high.y - block.roads[3] - 0.6 };
        parts.push(Part::new(Piece::Lamp(dvec2(t, at)), LAMP_AREA, density::THING));
    }
    if block.kind != Use::Square {
        return;
    }
    let mut dice = dice(block.seed + 3);
    for k in 0..8 {
        let at = rect.low + rect.size() * dvec2(0.12 + 0.11 * f64::from(k), 0.16);
        let cloth = [dvec3(0.80, 0.22, 0.18), dvec3(0.88, 0.86, 0.80), dvec3(0.18, 0.38, 0.52)];
        let top = cloth[(dice.unit() * 3.0) as usize];
        let wood = dvec3(0.46, 0.33, 0.22);
        let table =
            Cuboid { foot: dvec3(at.x, -0.1, at.y), half: dvec2(1.2, 0.7), height: 0.9, colour: wood, top: 0.8 * top };
        let roof = Cuboid { foot: dvec3(at.x, -2.3, at.y), half: dvec2(1.5, 1.1), height: 0.25, colour: top, top };
        for cuboid in [table, roof] {
            parts.push(Part::new(Piece::Cuboid(cuboid), cuboid.area(), density::THING));
        }
    }
}

/// Cars that park at the kerbs, away from crossings.
fn cars(block: &Block, parts: &mut Vec<Part>) {
    let mut dice = dice(block.seed + 4);
    let (rect, cell) = (&block.rect, &block.cell);
    let kerbs = [
        cell.low.x + block.roads[0] - 1.05,
        cell.high.x - block.roads[1] + 1.05,
        cell.low.y + block.roads[2] - 1.05,
        cell.high.y - block.roads[3] + 1.05,
    ];
    for (side, kerb) in kerbs.into_iter().enumerate() {
        let axis = 1 - side / 2;
        let mut at = rect.low[axis] + 4.5 + 3.0 * dice.unit();
        while at < rect.high[axis] - 4.5 {
            if dice.unit() < 0.55 {
                let place = if axis == 1 { dvec2(kerb, at) } else { dvec2(at, kerb) };
                let car = Car::new(place, axis == 1, &mut dice);
                parts.push(Part::new(Piece::Car(car), CAR_AREA, density::THING));
            }
            at += 5.4 + dice.unit();
        }
    }
}
