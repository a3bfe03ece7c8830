//! The rays path: cameras with lenses, and by the response `ray` pinholes, drawn by the exact response of every
//! Gaussian along the ray of each pixel.
//!
//! It shares the stages of the portable path between projection and blend. No stage knows a lens: [`RayTables`] holds
//! what they need of it, made on the host in f64. So every lens is drawn by the same pipelines.
//!
//! - `tables` - [`LensTables`]: the rays of all pixels, footprints of directions; [`RayTables`]: cones around the rays
//!   of tiles, too
//! - `pipeline` - [`RaysPipeline`]: the stages that differ from the portable path's

mod pipeline;
mod tables;

pub(super) use pipeline::{RaysFrame, RaysPipeline, depth_keys};
pub(super) use tables::{LensTables, RayTables, rays, uploaded};
