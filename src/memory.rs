//! Memory that is not there is an error to be told, not an abort.

use std::fmt;

use bytemuck::Zeroable;

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
            Some(bytes) => write!(f, "there is no room for the {bytes} bytes of `{name}`: {reason}"),
            None => write!(f, "{name}: {reason}"),
        }
    }
}

/// An empty vector with host memory for `len` elements.
pub fn host_vec<T>(len: usize, name: &str) -> Result<Vec<T>, OutOfMemory> {
    let mut vec = Vec::new();
    vec.try_reserve_exact(len).map_err(|_| no_host_memory::<T>(len, name))?;
    Ok(vec)
}

/// A vector of `len` zeros that the system hands out page by page, to the threads that write them first.
pub fn host_zeros<T: Zeroable>(len: usize, name: &str) -> Result<Vec<T>, OutOfMemory> {
    bytemuck::allocation::try_zeroed_vec(len).map_err(|()| no_host_memory::<T>(len, name))
}

fn no_host_memory<T>(len: usize, name: &str) -> OutOfMemory {
    OutOfMemory {
        name: name.to_owned(),
        bytes: Some(size_of::<T>() as u64 * len as u64),
        reason: "this machine has not that much memory left".to_owned(),
    }
}
