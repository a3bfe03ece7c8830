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
    ask_for_huge_pages(&vec);
    Ok(vec)
}

/// A vector of `len` zeros that the system hands out page by page, to the threads that write them first.
pub fn host_zeros<T: Zeroable>(len: usize, name: &str) -> Result<Vec<T>, OutOfMemory> {
    let vec = bytemuck::allocation::try_zeroed_vec(len).map_err(|()| no_host_memory::<T>(len, name))?;
    ask_for_huge_pages(&vec);
    Ok(vec)
}

/// Has the system back a large vector with pages of 2 MiB: to hand out pages of 4 KiB took half of the time in which a scene
/// is read.
#[cfg(target_os = "linux")]
fn ask_for_huge_pages<T>(vec: &Vec<T>) {
    const PAGE: usize = 2 << 20;
    let start = vec.as_ptr() as usize;
    let (first, end) = (start.next_multiple_of(PAGE), (start + vec.capacity() * size_of::<T>()) / PAGE * PAGE);
    if first < end {
        // SAFETY: the range lies inside the vector's allocation, and the advice changes no byte of it. A system that has no
        // such pages refuses, and nothing is lost.
        _ = unsafe { libc::madvise(first as *mut libc::c_void, end - first, libc::MADV_HUGEPAGE) };
    }
}

#[cfg(not(target_os = "linux"))]
fn ask_for_huge_pages<T>(_vec: &Vec<T>) {}

fn no_host_memory<T>(len: usize, name: &str) -> OutOfMemory {
    OutOfMemory {
        name: name.to_owned(),
        bytes: Some(size_of::<T>() as u64 * len as u64),
        reason: "this machine has not that much memory left".to_owned(),
    }
}
