//! The contribution of Gaussians to pictures, and pictures of a scene without some of them.
//!
//! - `pruner` - draws views with all Gaussians or without some; measures contributions and the largest changes

mod pruner;

pub use pruner::{Bounds, Pruner, Share};
