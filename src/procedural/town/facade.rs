//! The texture of facades: brick, plaster and glass, windows with frames and sills, shutters, doors, shops with signs.

use glam::{DVec3, dvec3};

use super::layout::{FLOOR, GROUND_FLOOR, House, Manner, Roof, dice};

/// The appearance of a house.
#[derive(Clone, Copy)]
pub struct Style {
    wall: DVec3,
    trim: DVec3,
    shutter: DVec3,
    sign: DVec3,
    pub roof: DVec3,
    material: Material,
    /// Width of the strip of the facade that one window takes, and size of the window.
    bay: f64,
    window: [f64; 2],
    has_shutters: bool,
    has_shop: bool,
    seed: usize,
}

#[derive(Clone, Copy, PartialEq)]
enum Material {
    Brick,
    Plaster,
    Glass,
    /// The walls of a church.
    Stone,
}

/// A point of a texture.
pub struct Texel {
    pub albedo: DVec3,
    /// Distances to the next edges, sideways and upwards, metres.
    pub edges: [f64; 2],
    /// Distance out of the wall, metres.
    pub relief: f64,
    pub gloss: f64,
}

impl Texel {
    fn new(albedo: DVec3, edges: [f64; 2]) -> Self {
        Self { albedo, edges, relief: 0.0, gloss: 0.03 }
    }
}

const PLASTERS: [DVec3; 8] = [
    dvec3(0.86, 0.78, 0.62),
    dvec3(0.88, 0.84, 0.76),
    dvec3(0.82, 0.62, 0.46),
    dvec3(0.72, 0.74, 0.70),
    dvec3(0.87, 0.72, 0.60),
    dvec3(0.62, 0.70, 0.74),
    dvec3(0.90, 0.86, 0.66),
    dvec3(0.76, 0.54, 0.46),
];
const BRICKS: [DVec3; 4] =
    [dvec3(0.55, 0.27, 0.20), dvec3(0.62, 0.36, 0.26), dvec3(0.50, 0.33, 0.27), dvec3(0.70, 0.55, 0.40)];
const ROOFS: [DVec3; 5] = [
    dvec3(0.58, 0.33, 0.25),
    dvec3(0.50, 0.29, 0.23),
    dvec3(0.34, 0.35, 0.38),
    dvec3(0.60, 0.40, 0.30),
    dvec3(0.42, 0.32, 0.28),
];
const SIGNS: [DVec3; 6] = [
    dvec3(0.10, 0.32, 0.22),
    dvec3(0.62, 0.12, 0.12),
    dvec3(0.10, 0.20, 0.42),
    dvec3(0.16, 0.15, 0.15),
    dvec3(0.78, 0.58, 0.16),
    dvec3(0.36, 0.16, 0.30),
];

impl Style {
    pub fn of(house: &House) -> Self {
        let mut dice = dice(house.seed + (1 << 35));
        let mut pick = |from: &[DVec3]| from[(dice.unit() * from.len() as f64) as usize];
        let (plaster, brick, roof, sign, shutter) =
            (pick(&PLASTERS), pick(&BRICKS), pick(&ROOFS), pick(&SIGNS), pick(&SIGNS));
        let material = match dice.unit() {
            _ if house.manner == Manner::Modern => Material::Glass,
            _ if house.manner == Manner::Church => Material::Stone,
            d if d < 0.4 => Material::Brick,
            _ => Material::Plaster,
        };
        let wall = match material {
            Material::Brick => brick,
            Material::Plaster => plaster,
            Material::Glass => dvec3(0.62, 0.64, 0.66),
            Material::Stone => dvec3(0.74, 0.69, 0.60),
        };
        let is_light = dice.unit() < 0.7;
        Self {
            wall,
            trim: if is_light { dvec3(0.90, 0.88, 0.83) } else { dvec3(0.55, 0.50, 0.44) },
            shutter,
            sign,
            roof: if house.roof == Roof::Flat { dvec3(0.50, 0.48, 0.46) } else { roof },
            material,
            bay: 2.1 + 0.9 * dice.unit(),
            window: [0.95 + 0.3 * dice.unit(), 1.55 + 0.3 * dice.unit()],
            has_shutters: material == Material::Plaster && dice.unit() < 0.5,
            has_shop: dice.unit() < 0.62 || house.manner == Manner::Modern,
            seed: house.seed,
        }
    }

    /// The mean colour of a wall, for what lies behind it.
    pub fn ground(&self) -> DVec3 {
        0.8 * self.wall
    }

    /// The facade at `u` metres from the left end of a wall of this length, and `v` metres above the ground.
    /// `spacing`: that of splats; finer patterns are left out.
    pub fn facade(&self, [u, v]: [f64; 2], length: f64, eaves: f64, spacing: f64) -> Texel {
        if v > eaves - 0.45 {
            let edge = (v - eaves + 0.45).min(eaves - v).max(0.02);
            return Texel { relief: 0.18, ..Texel::new(self.trim, [f64::INFINITY, edge]) };
        }
        let count = ((length - 0.6) / self.bay).floor().max(1.0);
        let margin = 0.5 * (length - count * self.bay);
        let at = (u - margin).clamp(0.0, count * self.bay - 1e-9);
        let is_margin = u < margin || u > length - margin;
        let number = (at / self.bay).floor();
        let x = if is_margin { 0.5 * self.bay } else { at - (number + 0.5) * self.bay };
        if self.material == Material::Stone {
            return self.tall([x, v], [u, eaves], spacing);
        }
        if v < GROUND_FLOOR {
            let door = (count / 2.0).floor() == number;
            return self.ground_floor([x, v], [u, length], door, spacing);
        }
        let floor = ((v - GROUND_FLOOR) / FLOOR).floor();
        let y = v - GROUND_FLOOR - floor * FLOOR;
        if eaves - (v - y) < FLOOR {
            return self.plain([u, v], [x.abs(), y], spacing);
        }
        if self.material == Material::Glass {
            return self.curtain([x, y], [number, floor]);
        }
        if floor == 0.0 && y < 0.2 {
            return Texel { relief: 0.10, ..Texel::new(self.trim, [f64::INFINITY, y.min(0.2 - y)]) };
        }
        self.window([x, y], [number, floor]).unwrap_or_else(|| self.plain([u, v], self.beside_window([x, y]), spacing))
    }

    /// A wall without windows.
    pub fn plain(&self, [u, v]: [f64; 2], edges: [f64; 2], spacing: f64) -> Texel {
        let stain = 0.04 * ((0.9 * u + self.seed as f64).sin() * (0.7 * v).sin() + (2.3 * u).sin() * (0.31 * v).cos());
        let foot = 1.0 - 0.18 * (-v / 0.5).exp();
        let mut tone = (1.0 + stain) * foot;
        if self.material == Material::Brick {
            let row = (v / 0.075).floor();
            let column = (u / 0.25 + 0.5 * (row % 2.0)).floor();
            let pattern = ((row * 12.9898 + column * 78.233).sin() * 43_758.545).fract();
            tone *= 1.0 + 0.22 * pattern * (0.06 / spacing).min(1.0);
            let mortar = (v / 0.075).fract() < 0.14 || (u / 0.25 + 0.5 * (row % 2.0)).fract() < 0.05;
            if mortar && spacing < 0.035 {
                return Texel::new(dvec3(0.66, 0.62, 0.56) * foot, [0.1, 0.008]);
            }
        }
        Texel::new(self.wall * tone, edges)
    }

    /// The distances of a place in a wall to the frame of the window, where it is beside or above it.
    fn beside_window(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        let [p, q] = self.outside([x, y]);
        match (p < FRAME, q < FRAME) {
            (false, true) => [p - FRAME, f64::INFINITY],
            (true, false) => [f64::INFINITY, q - FRAME],
            _ => [f64::INFINITY; 2],
        }
    }

    /// The distance of a place from the opening of the window, sideways and upwards.
    fn outside(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        [x.abs() - 0.5 * self.window[0], (y - 1.75).abs() - 0.5 * self.window[1]]
    }

    /// The window, its frame, sill and shutters; `None` in the wall around them.
    fn window(&self, [x, y]: [f64; 2], place: [f64; 2]) -> Option<Texel> {
        let [p, q] = self.outside([x, y]);
        if p < 0.0 && q < 0.0 {
            let bars = [x.abs() - 0.035, (y - 2.15).abs() - 0.035];
            if bars[0] < 0.0 || bars[1] < 0.0 {
                let edges = [if bars[0] < 0.0 { -bars[0] } else { -p }, if bars[1] < 0.0 { -bars[1] } else { -q }];
                return Some(Texel { relief: -0.05, ..Texel::new(dvec3(0.88, 0.87, 0.84), edges) });
            }
            return Some(Texel { relief: -0.07, ..self.pane([bars[0].min(-p), bars[1].min(-q)], place, y / FLOOR) });
        }
        let is_sill = y < 1.75 && (FRAME..FRAME + 0.1).contains(&q) && p < 0.25;
        if is_sill {
            let edges = [f64::INFINITY, (q - FRAME).min(FRAME + 0.1 - q)];
            return Some(Texel { relief: 0.12, ..Texel::new(0.85 * self.trim, edges) });
        }
        if p < FRAME && q < FRAME {
            let side = if p > 0.0 { p.min(FRAME - p) } else { f64::INFINITY };
            let above = if q > 0.0 { q.min(FRAME - q) } else { f64::INFINITY };
            return Some(Texel { relief: 0.04, ..Texel::new(self.trim, [side, above]) });
        }
        let leaf = 0.46 * self.window[0];
        if self.has_shutters && p < FRAME + leaf && q < 0.04 {
            let slat = if (y / 0.09).fract() < 0.3 { 0.82 } else { 1.0 };
            let edges = [(p - FRAME).min(FRAME + leaf - p), 0.04 - q];
            return Some(Texel { relief: 0.07, ..Texel::new(1.1 * slat * self.shutter, edges) });
        }
        None
    }

    /// Glass: the room behind it, a curtain, or the sky that it mirrors.
    fn pane(&self, edges: [f64; 2], [number, floor]: [f64; 2], height: f64) -> Texel {
        let key = self.seed + ((number * 31.0 + floor * 7.0) as usize) + (1 << 34);
        let (kind, tone) = {
            let mut dice = dice(key);
            (dice.unit(), dice.unit())
        };
        let sky = dvec3(0.40, 0.50, 0.62) * (0.55 + 0.5 * height);
        let albedo = match kind {
            k if k < 0.3 => dvec3(0.72, 0.69, 0.62) * (0.8 + 0.2 * tone),
            k if k < 0.36 => dvec3(0.85, 0.66, 0.36),
            _ => dvec3(0.10, 0.12, 0.15).lerp(sky, 0.25 + 0.5 * tone),
        };
        Texel { gloss: 0.35, ..Texel::new(albedo, edges) }
    }

    /// A wall of glass between slabs and posts.
    fn curtain(&self, [x, y]: [f64; 2], place: [f64; 2]) -> Texel {
        let [post, slab] = [0.5 * self.bay - x.abs(), y];
        if slab < 0.55 {
            return Texel { relief: 0.05, ..Texel::new(self.wall, [f64::INFINITY, slab.min(0.55 - slab)]) };
        }
        if post < 0.07 {
            return Texel { relief: 0.08, ..Texel::new(0.7 * self.wall, [post.max(0.07 - post), f64::INFINITY]) };
        }
        let halves = (x.abs() - 0.03).abs();
        let mut pane = self.pane([(post - 0.07).min(halves), (slab - 0.55).min(FLOOR - y)], place, y / FLOOR);
        pane.albedo = pane.albedo.lerp(dvec3(0.30, 0.44, 0.56), 0.65);
        pane
    }

    /// A wall with tall round-headed windows.
    fn tall(&self, [x, v]: [f64; 2], [u, eaves]: [f64; 2], spacing: f64) -> Texel {
        let (half, foot, head) = (0.55, (eaves - 6.8).max(2.6), eaves - 2.4);
        let outside = if v > head { x.hypot(v - head) - half } else { (x.abs() - half).max(foot - v) };
        match outside {
            d if d < 0.0 => self.pane([-d; 2], [x.signum(), 1.0], 0.3),
            d if d < 0.16 => Texel { relief: 0.05, ..Texel::new(0.88 * self.wall, [d.min(0.16 - d); 2]) },
            d => self.plain([u, v], [(d - 0.16).max(0.05), f64::INFINITY], spacing),
        }
    }

    fn ground_floor(&self, [x, v]: [f64; 2], [u, length]: [f64; 2], is_door: bool, spacing: f64) -> Texel {
        if self.has_shop {
            return self.shop([x, v], [u, length], is_door, spacing);
        }
        let [p, top] = [x.abs() - 0.55, v - 2.35];
        if is_door && p < 0.14 && top < 0.14 {
            if p < 0.0 && top < 0.0 {
                let panel = if (x.abs() - 0.28).abs() < 0.16 && (v / 0.75).fract() > 0.18 { 0.75 } else { 1.0 };
                return Texel { relief: -0.10, ..Texel::new(1.2 * panel * self.shutter, [-p, -top]) };
            }
            let edges = [if p > 0.0 { p.min(0.14 - p) } else { f64::INFINITY }, 0.05];
            return Texel { relief: 0.05, ..Texel::new(self.trim, edges) };
        }
        if v < 0.6 {
            return Texel { relief: 0.05, ..Texel::new(dvec3(0.50, 0.48, 0.46), [f64::INFINITY, 0.6 - v]) };
        }
        let window = if is_door { None } else { self.window([x, v - 0.35], [u / self.bay, 99.0]) };
        window.unwrap_or_else(|| {
            let edges = if is_door { [f64::INFINITY; 2] } else { self.beside_window([x, v - 0.35]) };
            self.plain([u, v], edges, spacing)
        })
    }

    /// Show windows between piers under a sign with letters.
    fn shop(&self, [x, v]: [f64; 2], [u, length]: [f64; 2], is_door: bool, spacing: f64) -> Texel {
        let pier = 0.5 * self.bay - x.abs();
        let inside = u.min(length - u);
        if (3.05..3.75).contains(&v) && inside > 0.3 {
            let edge = (v - 3.05).min(3.75 - v);
            let is_letter = (v - 3.4).abs() < 0.18 && (u - 0.5 * length).abs() < 0.22 * length;
            let stroke = ((u * 5.3 + self.seed as f64).sin() + (v * 17.0 + u * 3.0).sin()) > 0.15;
            let colour = if is_letter && stroke { dvec3(0.95, 0.92, 0.82) } else { self.sign };
            let fine = if is_letter { [0.05, 0.08] } else { [f64::INFINITY, edge] };
            return Texel { relief: 0.14, ..Texel::new(colour, fine) };
        }
        if pier < 0.14 || inside < 0.3 {
            let albedo = 0.9 * self.trim;
            return Texel { relief: 0.04, ..Texel::new(albedo, [pier.max(0.06), f64::INFINITY]) };
        }
        if v > 2.9 || v < 0.45 && !is_door {
            let edge = if v > 2.9 { v - 2.9 } else { 0.45 - v };
            return Texel::new(
                if v > 2.9 { self.plain([u, v], [0.3; 2], spacing).albedo } else { 0.8 * self.sign },
                [f64::INFINITY, edge.max(0.05)],
            );
        }
        if is_door && (x.abs() > 0.5 || v > 2.3) {
            return Texel::new(1.1 * self.sign, [(x.abs() - 0.5).abs().max(0.05), f64::INFINITY]);
        }
        // Goods on shelves behind the glass.
        let shelf = ((v / 0.5).floor() * 5.7 + (u / 0.35).floor() * 3.3 + self.seed as f64).sin();
        let goods = dvec3(0.45 + 0.3 * shelf, 0.36 + 0.1 * (7.0 * shelf).sin(), 0.28 + 0.2 * (3.0 * shelf).cos());
        let albedo = if v < 1.7 { 0.75 * goods } else { dvec3(0.26, 0.27, 0.28) + 0.1 * goods };
        let edges = [(pier - 0.14).min(0.2), (v - 0.45).abs().min(2.9 - v).min(0.25)];
        Texel { gloss: 0.3, relief: -0.08, ..Texel::new(albedo, edges) }
    }
}

/// Width of the frame around a window, metres.
const FRAME: f64 = 0.11;
