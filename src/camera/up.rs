//! The up axis of a world.

use std::fmt;

use glam::DVec3;

/// The world axis that points up in the image. By default -y: scenes of COLMAP have y down.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Up {
    PlusX,
    MinusX,
    PlusY,
    #[default]
    MinusY,
    PlusZ,
    MinusZ,
}

impl Up {
    /// All axes, each next to its opposite.
    pub const ALL: [Self; 6] = [Self::PlusX, Self::MinusX, Self::PlusY, Self::MinusY, Self::PlusZ, Self::MinusZ];

    /// The axis as a vector of unit length.
    pub fn vector(self) -> DVec3 {
        match self {
            Self::PlusX => DVec3::X,
            Self::MinusX => DVec3::NEG_X,
            Self::PlusY => DVec3::Y,
            Self::MinusY => DVec3::NEG_Y,
            Self::PlusZ => DVec3::Z,
            Self::MinusZ => DVec3::NEG_Z,
        }
    }

    /// The opposite axis.
    pub fn flipped(self) -> Self {
        match self {
            Self::PlusX => Self::MinusX,
            Self::MinusX => Self::PlusX,
            Self::PlusY => Self::MinusY,
            Self::MinusY => Self::PlusY,
            Self::PlusZ => Self::MinusZ,
            Self::MinusZ => Self::PlusZ,
        }
    }
}

/// Writes the axis like "-y".
impl fmt::Display for Up {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::PlusX => "+x",
            Self::MinusX => "-x",
            Self::PlusY => "+y",
            Self::MinusY => "-y",
            Self::PlusZ => "+z",
            Self::MinusZ => "-z",
        })
    }
}
