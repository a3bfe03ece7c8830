//! The ways of looking inside: what is shown in place of colours, and between which numbers.

use super::jobs::Side;
use super::pictures::Drawn;
use crate::camera::Camera;
use crate::render::{Attribute, Inspection, Look, Quantity, Scale, Work};

/// A way of looking, as it is listed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sight {
    pub name: &'static str,
    pub look: Look,
    pub numbers: Numbers,
}

/// What a pixel of it holds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Numbers {
    /// A colour.
    None,
    /// Counts, on a logarithmic scale.
    Counts,
    /// World units, or logarithms to base 2, or parts: the mean over what is seen, from low to high.
    Mean([f32; 2]),
    Coverage,
    Transmittance,
}

/// Every way of looking.
pub const SIGHTS: [Sight; 15] = [
    Sight { name: "colour", look: Look::Colour, numbers: Numbers::None },
    Sight { name: "tile-load", look: Look::Work(Work::TileLoad), numbers: Numbers::Counts },
    Sight { name: "evaluations", look: Look::Work(Work::Evaluations), numbers: Numbers::Counts },
    Sight { name: "contributions", look: Look::Work(Work::Contributions), numbers: Numbers::Counts },
    Sight { name: "transmittance-left", look: Look::Colour, numbers: Numbers::Transmittance },
    Sight { name: "alpha", look: Look::Colour, numbers: Numbers::Coverage },
    Sight { name: "depth", look: Look::Attribute(Attribute::Depth), numbers: Numbers::Mean([0.0, 10.0]) },
    Sight { name: "normals", look: Look::Attribute(Attribute::Normal), numbers: Numbers::None },
    Sight { name: "splat-centres", look: Look::Work(Work::Centres), numbers: Numbers::None },
    Sight { name: "ellipse-outlines", look: Look::Work(Work::Outlines), numbers: Numbers::None },
    Sight { name: "opacity", look: Look::Attribute(Attribute::Opacity), numbers: Numbers::Mean([0.0, 1.0]) },
    Sight { name: "size-log2", look: Look::Attribute(Attribute::Size), numbers: Numbers::Mean([-12.0, 0.0]) },
    Sight { name: "anisotropy-log2", look: Look::Attribute(Attribute::Anisotropy), numbers: Numbers::Mean([0.0, 8.0]) },
    Sight { name: "base-colour", look: Look::Attribute(Attribute::BaseColour), numbers: Numbers::None },
    Sight { name: "identity", look: Look::Attribute(Attribute::Identity), numbers: Numbers::None },
];

/// What they are called.
pub fn sight_names() -> impl Iterator<Item = &'static str> {
    SIGHTS.iter().map(|sight| sight.name)
}

/// How the pictures are looked at.
pub struct Looks {
    pub sight: usize,
    /// The ends of each sight's scale.
    pub ranges: [[f32; 2]; SIGHTS.len()],
    pub culled_from: Option<Camera>,
    pub isolated: Option<u32>,
}

impl Default for Looks {
    fn default() -> Self {
        let range = |sight: &Sight| match sight.numbers {
            Numbers::Counts => [1.0, 10_000.0],
            Numbers::Mean(range) => range,
            _ => [0.0, 1.0],
        };
        Self { sight: 0, ranges: std::array::from_fn(|i| range(&SIGHTS[i])), culled_from: None, isolated: None }
    }
}

impl Looks {
    pub fn sight(&self) -> &'static Sight {
        &SIGHTS[self.sight]
    }

    /// The next of the list, or the one before.
    pub fn step(&mut self, forward: bool) {
        self.sight = (self.sight + if forward { 1 } else { SIGHTS.len() - 1 }) % SIGHTS.len();
    }

    /// Depths of a scene of this radius.
    pub fn set_extent(&mut self, radius: f64) {
        for (sight, range) in SIGHTS.iter().zip(&mut self.ranges) {
            if sight.look == Look::Attribute(Attribute::Depth) {
                *range = [0.0, 4.0 * radius as f32];
            }
        }
    }

    pub fn inspection(&self) -> Inspection {
        let Self { culled_from, isolated, .. } = self;
        Inspection { look: self.sight().look, culled_from: culled_from.clone(), isolated: *isolated }
    }

    pub fn quantity(&self) -> Quantity {
        let [low, high] = self.ranges[self.sight];
        match self.sight().numbers {
            Numbers::None => Quantity::Colour,
            Numbers::Counts => Quantity::Number(Scale { low: low.max(1e-3), high, is_logarithmic: true }),
            Numbers::Mean(_) => Quantity::Mean(Scale { low, high, is_logarithmic: false }),
            Numbers::Coverage => Quantity::Coverage,
            Numbers::Transmittance => Quantity::Transmittance,
        }
    }

    /// Makes a picture be looked at so; whether it was not before. A Gaussian alone is one of the first picture's.
    pub fn apply(&self, side: Side, drawn: &mut Drawn) -> anyhow::Result<bool> {
        let mut wanted = self.inspection();
        let is_there = |index: u32| side == Side::First && (index as usize) < drawn.gaussians.len();
        wanted.isolated = wanted.isolated.filter(|index| is_there(*index));
        if drawn.inspection == wanted {
            return Ok(false);
        }
        drawn.still.set_inspection(wanted.clone())?;
        drawn.inspection = wanted;
        Ok(true)
    }
}
