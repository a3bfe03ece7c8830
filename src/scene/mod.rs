//! Scenes: Gaussians, validated and made canonical once when they are read, and the file formats they come in.

mod bounds;
mod canonical;
mod columns;
mod edit;
mod from_canonical;
mod gaussians;
mod grid;
pub mod harmonics;
mod instances;
mod loaded;
pub(crate) mod morton;
mod random;
mod requirements;
mod rotation;
mod transform;
mod watch;

pub use bounds::{Bounds, Focus, percentiles};
pub(crate) use canonical::{BLOCK, logit};
pub use canonical::{Builder, Raw};
pub use edit::RIGHT_UP_BACK;
pub(crate) use edit::{axis_signs, rotation_signs};
pub use from_canonical::Parts;
pub(crate) use gaussians::rest_values;
pub use gaussians::{Gaussians, MAX_SH_DEGREE, sh_coefficients};
pub use grid::Grid;
pub use instances::{Place, Placements, PlacesFile};
pub use loaded::{Level, LoadReport, NoLevel, Scene, Unreadable, remarks};
pub use morton::{Curve, along_curve};
pub(crate) use random::Random;
pub use requirements::{Band, Colours, Requirements, SUMMED, StoredValues, bands};
pub(crate) use rotation::from_smallest_three;
pub use rotation::{decode_rotation, encode_rotation};
pub use transform::Transform;
pub use watch::{Cancelled, Watch};
