//! The contribution of Gaussians to pictures, and pictures of a scene without some of them.

mod pruner;

pub use pruner::{Bounds, Pruner, Share};
