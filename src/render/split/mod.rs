//! One frame on several devices: each device draws a band of the picture (sort-first, Molnar et al. 1994).
//!
//! - `balance` - [`Balance`]: the borders of the bands, moved by the times of the last frame
//! - `trial` - whether pictures in bands are faster than those of one device
//! - `band_memory` - the memory through which bands come from one device to another
//! - `worker` - the thread of a device that draws bands
//! - `renderer` - [`SplitRenderer`]: pictures in host memory, of devices that are equals
//! - `other_devices` - [`OtherDevices`]: pictures on the device of a renderer, with bands from other devices

mod balance;
mod band_memory;
mod other_devices;
mod renderer;
mod trial;
mod worker;

pub use balance::Balance;
pub use other_devices::{DeviceBand, OtherDevices};
pub use renderer::{SplitFrame, SplitRenderer};
pub use worker::{DrawnBand, LostDevice};
