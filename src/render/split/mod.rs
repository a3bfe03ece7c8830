//! One frame on several devices: each device draws a band of the picture (sort-first, Molnar et al. 1994).
//!
//! - `balance` - [`Balance`]: the borders of the bands, moved by the times of the last frame
//! - `renderer` - [`SplitRenderer`]: draws the bands at the same time, and draws again what a lost device leaves

mod balance;
mod renderer;

pub use balance::Balance;
pub use renderer::{DrawnBand, LostDevice, SplitFrame, SplitRenderer};
