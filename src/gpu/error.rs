//! The failures of the GPU layer that a program handles differently from others.

use ash::vk;

use crate::host_memory::OutOfMemory;

/// No device can be used. The message says what is missing and what to install.
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
pub struct Unavailable(pub String);

/// The device cannot hold an image of this size, however much memory is free.
#[derive(Debug, thiserror::Error)]
#[error("{device} draws pictures of at most {limit} pixels a side, not {}x{}", size[0], size[1])]
pub struct TooLarge {
    /// Name of the device.
    pub device: String,
    /// Most pixels of a side.
    pub limit: u32,
    /// Width and height in pixels.
    pub size: [u32; 2],
}

/// The device has stopped and its content is lost. It can be opened again.
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
pub struct DeviceLost(pub String);

/// An error that names the failed call. [`OutOfMemory`] and [`DeviceLost`] keep their types.
pub(super) fn describe(call: &'static str, result: vk::Result) -> anyhow::Error {
    match result {
        vk::Result::ERROR_OUT_OF_DEVICE_MEMORY | vk::Result::ERROR_OUT_OF_HOST_MEMORY => {
            OutOfMemory { name: call.to_owned(), bytes: None, reason: result.to_string() }.into()
        }
        vk::Result::ERROR_DEVICE_LOST => DeviceLost(format!("the GPU was lost ({call})")).into(),
        _ => anyhow::Error::new(result).context(call),
    }
}
