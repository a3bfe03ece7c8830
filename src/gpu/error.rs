//! The failures of the GPU layer that a program answers differently from others.

use ash::vk;

use crate::host_memory::OutOfMemory;

/// No device can be used: the sentence says what is missing and what to install.
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
pub struct Unavailable(pub String);

/// The device has stopped for good: all that was on it is gone, and it can be opened anew.
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
pub struct DeviceLost(pub String);

/// Says which call failed; running out of memory and a lost device keep their types.
pub(super) fn describe(call: &'static str, result: vk::Result) -> anyhow::Error {
    match result {
        vk::Result::ERROR_OUT_OF_DEVICE_MEMORY | vk::Result::ERROR_OUT_OF_HOST_MEMORY => {
            OutOfMemory { name: call.to_owned(), bytes: None, reason: result.to_string() }.into()
        }
        vk::Result::ERROR_DEVICE_LOST => DeviceLost(format!("the GPU was lost ({call})")).into(),
        _ => anyhow::Error::new(result).context(call),
    }
}
