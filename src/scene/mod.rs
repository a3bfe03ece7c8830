//! Scenes: Gaussians, validated and made canonical once when they are read, and the file formats they come in.

mod beside;
mod bounds;
mod canonical;
mod columns;
mod edit;
mod gaussians;
mod gltf;
mod grid;
pub mod harmonics;
mod ksplat;
mod loaded;
mod loss;
mod morton;
mod parts;
mod placements;
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
pub use loaded::{Level, LoadReport, NoLevel, Scene, Unreadable, remarks};
pub use loss::Loss;
pub use morton::{Curve, along_curve};
pub use parts::Parts;
pub use placements::{Place, Placements, PlacesFile};
pub use procedural::Procedural;
pub use reading::{Reading, in_folder, read};
pub use requirements::{Band, Colours, Requirements, SUMMED, StoredValues, bands};
pub use rotation::{decode_rotation, encode_rotation};
pub use town::TownPath;
pub use transform::Transform;
pub use watch::{Cancelled, Watch};
pub use write::{
    LOD_META, SceneFile, Streamed, WrittenFile, WrittenLevels, write_file, write_sog_folder, write_streamed_sog,
};

use gaussians::rest_values;
