//! The failures of the GPU layer that a program answers differently from others.

use ash::vk;

/// No device can be used: the sentence says what is missing and what to install.
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
pub struct Unavailable(pub String);

/// The device or the host has not the memory that was asked for, or a limit of the device is below it.
#[derive(Debug, thiserror::Error)]
#[error("{name} needs {bytes} bytes on the GPU: {reason}")]
pub struct OutOfMemory {
    pub name: String,
    pub bytes: u64,
    pub reason: String,
}

/// Says which call failed; running out of memory keeps its type.
pub(super) fn describe(call: &'static str, result: vk::Result) -> anyhow::Error {
    match result {
        vk::Result::ERROR_OUT_OF_DEVICE_MEMORY | vk::Result::ERROR_OUT_OF_HOST_MEMORY => {
            OutOfMemory { name: call.to_owned(), bytes: 0, reason: result.to_string() }.into()
        }
        _ => anyhow::anyhow!("{call}: {result}"),
    }
}
