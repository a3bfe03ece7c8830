//! Camera paths through the town: along streets, around on a roof, and over it.

use std::f64::consts::TAU;

use glam::{DVec2, DVec3, dvec2, dvec3};

use super::layout::{House, Roof, Use};
use super::plan::Layout;

/// A camera path of a town.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TownPath {
    /// A walk along streets, with turns at crossings.
    Street,
    /// One turn on a roof.
    Roof,
    /// A flight over the town.
    Air,
}

/// Height of the eyes above the ground or a roof, metres.
const EYES: f64 = 1.7;

/// Corners of a walk are rounded over this distance before and after them, metres.
const ROUNDING: f64 = 4.0;

impl TownPath {
    /// The name on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Street => "street",
            Self::Roof => "roof",
            Self::Air => "air",
        }
    }

    /// The path of this name.
    pub fn named(name: &str) -> Option<Self> {
        [Self::Street, Self::Roof, Self::Air].into_iter().find(|path| path.name() == name)
    }

    /// The eyes and targets of `views` cameras along the path.
    pub(crate) fn views(self, layout: &Layout, views: usize) -> Vec<[DVec3; 2]> {
        let part = |view: usize| view as f64 / views.max(2) as f64;
        match self {
            Self::Street => {
                let walk = walk(layout);
                let length = length(&walk) - ROUNDING - 12.0;
                (0..views).map(|view| street(&walk, ROUNDING + (length - ROUNDING) * part(view))).collect()
            }
            Self::Roof => {
                let eye = on_roof(layout);
                (0..views).map(|view| [eye, eye + ahead(TAU * part(view) + 3.6, 0.16)]).collect()
            }
            Self::Air => {
                let half = layout.half();
                let height = (0.75 * half).clamp(60.0, 150.0);
                let eye = |t: f64| dvec3(half * (1.0 - t), -height, half * (0.85 - 0.8 * t));
                (0..views).map(|view| [eye(part(view)), eye(part(view)) + ahead(0.62 * TAU, 0.55)]).collect()
            }
        }
    }
}

/// A direction at this angle from x towards z, this much below the horizon.
fn ahead(angle: f64, below: f64) -> DVec3 {
    10.0 * dvec3(angle.cos(), below, angle.sin()).normalize()
}

/// The corners of the walk: along a street, then the avenue, then back along the next street.
fn walk(layout: &Layout) -> Vec<DVec2> {
    let [across, along] = &layout.streets;
    let middle = layout.side / 2;
    let wide = |number: &usize| across[*number].road > 6.0;
    let avenue = (2..=layout.side).filter(wide).min_by_key(|number| number.abs_diff(middle)).unwrap_or(middle);
    let at = |x: usize, z: usize| dvec2(across[x].at, along[z].at);
    vec![at(avenue - 2, middle), at(avenue, middle), at(avenue, middle + 1), at(avenue - 2, middle + 1)]
}

fn length(walk: &[DVec2]) -> f64 {
    walk.windows(2).map(|ends| ends[0].distance(ends[1])).sum()
}

/// The point of a walk this far from its begin.
fn point(walk: &[DVec2], mut distance: f64) -> DVec2 {
    for ends in walk.windows(2) {
        let length = ends[0].distance(ends[1]);
        if distance <= length {
            return ends[0].lerp(ends[1], distance / length);
        }
        distance -= length;
    }
    walk[walk.len() - 1]
}

/// The eye and its target this far from the begin of the walk.
fn street(walk: &[DVec2], distance: f64) -> [DVec3; 2] {
    let rounded = |distance: f64| {
        let steps = 16;
        let shift = |k: i32| ROUNDING * (f64::from(2 * k + 1) / f64::from(steps) - 1.0);
        (0..steps).map(|k| point(walk, distance + shift(k))).sum::<DVec2>() / f64::from(steps)
    };
    let [eye, target] = [rounded(distance), rounded(distance + 8.0)];
    [dvec3(eye.x, -EYES, eye.y), dvec3(target.x, -EYES - 0.35, target.y)]
}

/// On the flat roof that is highest, near the middle of the town; above the ridge if there is none.
fn on_roof(layout: &Layout) -> DVec3 {
    let is_near = |at: DVec2| at.abs().max_element() < 0.62 * layout.half();
    let blocks = layout.blocks.iter().filter(|block| block.kind == Use::Houses);
    let houses = blocks.flat_map(|block| &block.houses).filter(|house| is_near(house.rect.centre()));
    let rank = |house: &&House| house.top + if house.roof == Roof::Flat { 100.0 } else { 0.0 };
    let best = houses.max_by(|a, b| rank(a).total_cmp(&rank(b)));
    let (at, top) = best.map_or((DVec2::ZERO, 70.0), |house| (house.rect.centre(), house.top));
    dvec3(at.x, -(top + 1.5 * EYES), at.y)
}
