//! Scenes that are packed on the device, from arrays that another API wrote there.
//!
//! - `device_arrays` - [`DeviceArrays`]: arrays in device memory, and the scenes that are packed from them
//! - `examination` - what the layout of a scene follows from, and the reasons to leave the arrays to the host

mod device_arrays;
mod examination;

pub use device_arrays::DeviceArrays;
pub use examination::{Examination, HostNeeded};
