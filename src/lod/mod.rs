//! Mathematics of levels of detail: nodes that stand for several Gaussians, and the errors that this makes. Knows no
//! file and no GPU.
//!
//! - `node` - a node, and lists of nodes with their spherical harmonics
//! - `simplify` - replaces the nodes of a group by fewer parents; uses `pairs`, `merge` and `fit`
//! - `pairs` - which nodes are merged, the cheapest pair first
//! - `density`, `neighbours` - the cost of a merge, and the candidates
//! - `merge` - the parent of several nodes
//! - `fit` - fits parents to pictures of their children, and measures their errors; `descent` also fits their shapes,
//!   by `gradient`
//! - `replacement` - the error of whole groups of nodes that a source has in place of others
//! - `raster`, `difference` - these small pictures, and their differences
//! - `error_code` - errors in 16 bits
//!
//! A node is a Gaussian of the scene, or stands for several: its children. Errors never fall from children to parents,
//! so an error limit decides for each node alone whether it is drawn: if its own error is within the limit, and the
//! error of its parent is not.

mod density;
mod descent;
mod difference;
mod error_code;
mod fit;
mod gradient;
mod merge;
mod neighbours;
mod node;
mod pairs;
mod raster;
mod replacement;
mod simplify;

pub use descent::{Descent, LEAST_GRADIENT, MOST_CHANGE, REPLACED, ROUND_DIRECTIONS, Round};
pub use difference::{LEAST, SUM_TILE, Sums, squared_difference, total};
pub use error_code::{CODES_PER_OCTAVE, FINEST, LOWEST_EXPONENT, NEVER, code_below, code_of, value_of_code};
pub use fit::{
    COLOUR_ROUNDS, FitOptions, Fitter, Group, LEAST_ALPHA, LEAST_COVERED, MOST_FACTOR, Measured, RESIDUALS, VIEWS,
};
pub use gradient::CLAMPED;
pub use node::{Node, Nodes, median};
pub use raster::{LANES, MOST_DEVIATIONS, PER_ALPHA_MIN, Window};
pub use replacement::{Replacement, replacement};
pub use simplify::{Simplified, simplify};
