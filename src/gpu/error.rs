//! The failures of the GPU layer that a program answers differently from others.

use std::fmt;

use ash::vk;

/// No device can be used: the sentence says what is missing and what to install.
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
pub struct Unavailable(pub String);

/// The device or the host has not the memory that was asked for, or a limit of the device is below it.
#[derive(Debug)]
pub struct OutOfMemory {
    /// The resource, or the call that failed.
    pub name: String,
    /// What it needs, if that is known.
    pub bytes: Option<u64>,
    pub reason: String,
}

impl std::error::Error for OutOfMemory {}

impl fmt::Display for OutOfMemory {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { name, bytes, reason } = self;
        match bytes {
            Some(bytes) => write!(f, "the GPU's memory does not hold the {bytes} bytes of `{name}`: {reason}"),
            None => write!(f, "{name}: {reason}"),
        }
    }
}

/// Says which call failed; running out of memory keeps its type.
pub(super) fn describe(call: &'static str, result: vk::Result) -> anyhow::Error {
    match result {
        vk::Result::ERROR_OUT_OF_DEVICE_MEMORY | vk::Result::ERROR_OUT_OF_HOST_MEMORY => {
            OutOfMemory { name: call.to_owned(), bytes: None, reason: result.to_string() }.into()
        }
        _ => anyhow::anyhow!("{call}: {result}"),
    }
}
