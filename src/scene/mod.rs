//! Scenes: Gaussians, validated and made canonical once when they are read, and the file formats they come in.

mod beside;
mod bounds;
mod canonical;
mod edit;
mod gaussians;
mod gltf;
mod grid;
pub mod harmonics;
mod ksplat;
mod loaded;
mod loss;
mod morton;
mod places;
mod ply;
mod procedural;
mod random;
mod reading;
mod requirements;
mod rotation;
mod sog;
mod source;
mod splat;
mod spz;
pub mod synthetic;
mod town;
mod transform;
mod watch;
mod write;

pub use bounds::{Bounds, Focus, percentiles};
pub use canonical::{Builder, Raw};
pub use edit::RIGHT_UP_BACK;
pub use gaussians::{Gaussians, MAX_SH_DEGREE, sh_coefficients};
pub use grid::Grid;
pub use loaded::{Level, LoadReport, NoLevel, Scene, Unreadable};
pub use loss::Loss;
pub use procedural::Procedural;
pub use reading::{Reading, in_folder, read};
pub use requirements::{Band, Requirements, bands};
pub use rotation::{decode_rotation, encode_rotation};
pub use town::TownPath;
pub use transform::Transform;
pub use watch::{Cancelled, Watch};
pub use write::{SceneFile, write_sog_folder};

use gaussians::rest_values;
