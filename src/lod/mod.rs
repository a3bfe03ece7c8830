//! Levels of detail: fewer Gaussians in the place of many, with the error that this makes.
//!
//! | word | meaning |
//! |---|---|
//! | node | a Gaussian of the scene, or one that stands for others |
//! | parent, children | a node and the nodes that it stands for |
//! | family | neighbouring nodes whose parents are found, fitted and measured together |
//! | own error of a node | what drawing it instead of its children changes: [`Node::error`] |
//!
//! Errors never fall from children to parents. So a limit decides for each node alone whether it is drawn: if its own
//! error is within the limit, and its parent's is not.

mod density;
mod difference;
mod error_code;
mod fit;
mod median;
mod merge;
mod neighbours;
mod node;
mod pairs;
mod raster;
mod simplify;

pub use difference::squared_change;
pub use error_code::{CODES_PER_OCTAVE, FINEST, LOWEST_EXPONENT, NEVER, code, code_below, value};
pub use median::median;
pub use node::{Node, Nodes};
pub use simplify::{Parents, parents};
