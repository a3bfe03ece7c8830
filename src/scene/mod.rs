//! Scenes in memory: Gaussians, validated and made canonical once when they are read or generated.
//!
//! - `gaussians` - the Gaussians of a scene as a structure of arrays
//! - `stored` - a Gaussian as files store it
//! - `canonical` - validates such values and makes them canonical: `Builder`
//! - `arrays` - Gaussians from arrays of training programs
//! - `from_canonical` - Gaussians from values that are canonical already
//! - `loaded` - a scene with its load report, and the errors of reading
//! - `watch` - progress, partial scenes and cancelling while a scene is read
//! - `transform`, `edit` - rigid transforms with a scale; flips, selections and joins
//! - `placement` - where the Gaussians of a file lie: axes, affine maps of nodes and of the caller
//! - `instances` - copies of a scene with a transform each
//! - `bounds` - the box of a scene, and the sphere that holds most of it
//! - `harmonics`, `rotation` - spherical harmonics; quaternions and their encoding
//! - `requirements` - number formats that store a scene without loss
//! - `grid`, `columns` - values that lie on a grid of 256 steps
//! - `morton` - the order of points along a space-filling curve
//! - `random` - seeded random numbers, equal on every machine

mod arrays;
mod bounds;
mod canonical;
mod columns;
mod edit;
mod from_canonical;
mod gaussians;
mod grid;
#[doc(hidden)]
pub mod harmonics;
mod instances;
mod loaded;
pub(crate) mod morton;
mod placement;
mod random;
mod requirements;
mod rotation;
mod stored;
mod transform;
mod watch;

pub use arrays::Arrays;
pub use bounds::{Bounds, FOCUSED, Focus};
pub use canonical::Builder;
pub use gaussians::{Gaussians, MAX_SH_DEGREE, USUAL_SH_DEGREE, sh_coefficients};
pub use instances::SceneInstances;
pub use loaded::{LoadReport, NoLevel, Scene, SceneLevel, Unreadable, remarks};
pub use stored::{Activated, Raw};
pub use transform::Transform;
pub use watch::{Cancelled, Watch};

#[doc(hidden)]
pub use bounds::percentiles;
#[doc(hidden)]
pub use edit::RIGHT_UP_BACK;
#[doc(hidden)]
pub use from_canonical::CanonicalBuilder;
#[doc(hidden)]
pub use grid::Grid;
#[doc(hidden)]
pub use instances::InstancesFile;
#[doc(hidden)]
pub use morton::{Curve, along_curve};
#[doc(hidden)]
pub use requirements::{Band, Colours, Requirements, SUMMED, StoredValues, bands};
#[doc(hidden)]
pub use rotation::{decode_rotation, encode_rotation};

pub(crate) use canonical::BLOCK;
pub(crate) use edit::{axis_signs, rotation_signs};
pub(crate) use gaussians::rest_values;
pub(crate) use placement::{Placement, Placer};
pub(crate) use random::Random;
pub(crate) use rotation::from_smallest_three;
pub(crate) use stored::logit;
