//! The elements of the plan of the town: streets, blocks, houses, trees.

use glam::DVec2;

use crate::scene::Random;

/// Mean distance of two parallel streets, metres.
pub const PITCH: f64 = 62.0;

/// Heights of the ground floor and of each floor above it, metres.
pub const GROUND_FLOOR: f64 = 4.0;
pub const FLOOR: f64 = 3.2;

/// A street: a line of constant x or z.
#[derive(Clone, Copy, Debug)]
pub struct Street {
    /// The coordinate of the middle of the street.
    pub at: f64,
    /// Half the distance of the facades.
    pub half: f64,
    /// Half the width of the roadway.
    pub road: f64,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Use {
    /// Houses around a courtyard.
    Houses,
    /// A tower on two floors of shops.
    Tower,
    Park,
    /// A paved square with a church.
    Square,
}

/// A rectangle on the ground: x and z from `low` to `high`.
#[derive(Clone, Copy, Debug)]
pub struct Rect {
    pub low: DVec2,
    pub high: DVec2,
}

impl Rect {
    pub fn size(&self) -> DVec2 {
        self.high - self.low
    }

    pub fn centre(&self) -> DVec2 {
        0.5 * (self.low + self.high)
    }

    pub fn contains(&self, at: DVec2) -> bool {
        at.cmpge(self.low).all() && at.cmple(self.high).all()
    }

    pub fn part(&self, from: DVec2, to: DVec2) -> Self {
        Self { low: self.low + from * self.size(), high: self.low + to * self.size() }
    }

    pub fn shrunk(&self, by: f64) -> Self {
        Self { low: self.low + by, high: self.high - by }
    }
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Roof {
    /// Behind a parapet.
    Flat,
    /// Two slopes; the ridge runs along this axis, 0 for x and 1 for z.
    Gable(usize),
    Spire,
}

/// The manner in which a house is built.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Manner {
    Town,
    Modern,
    Church,
}

/// The neighbour of a wall of a house.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Side {
    Street,
    Yard,
    /// Another house up to this height.
    Neighbour(f64),
}

#[derive(Clone, Copy, Debug)]
pub struct House {
    pub rect: Rect,
    /// Heights of the foot, of the eaves and of the top of the roof.
    pub base: f64,
    pub eaves: f64,
    pub top: f64,
    pub roof: Roof,
    /// The walls at low x, high x, low z, high z.
    pub sides: [Side; 4],
    /// Seed of its appearance.
    pub seed: usize,
    pub manner: Manner,
}

impl House {
    /// The height of the roof above a place within the house.
    pub fn height(&self, at: DVec2) -> f64 {
        let t = ((at - self.rect.low) / self.rect.size() * 2.0 - 1.0).abs();
        match self.roof {
            Roof::Flat => self.eaves,
            Roof::Gable(axis) => self.eaves + (self.top - self.eaves) * (1.0 - t[1 - axis]).max(0.0),
            Roof::Spire => self.eaves + (self.top - self.eaves) * (1.0 - t.max_element()).max(0.0),
        }
    }
}

#[derive(Clone, Debug)]
pub struct Tree {
    pub at: DVec2,
    pub height: f64,
    pub radius: f64,
    pub seed: usize,
}

/// A block and the halves of the streets around it.
#[derive(Clone, Debug)]
pub struct Block {
    pub kind: Use,
    /// Up to the middles of the streets.
    pub cell: Rect,
    /// Within the facades.
    pub rect: Rect,
    /// Half the widths of the roadways at low x, high x, low z, high z.
    pub roads: [f64; 4],
    pub houses: Vec<House>,
    pub trees: Vec<Tree>,
    pub seed: usize,
}

/// Random numbers of an element of the plan, independent of those of Gaussians.
pub fn dice(seed: usize) -> Random {
    Random::of((1 << 37) + seed)
}
