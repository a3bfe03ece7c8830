//! Allocation of host memory that fails with an error instead of aborting.

use std::fmt;

use bytemuck::Zeroable;

/// The device or the host lacks the requested memory, or the request exceeds a limit of the device.
#[derive(Debug)]
pub struct OutOfMemory {
    /// The resource, or the call that failed.
    pub name: String,
    /// The size of the request, if known.
    pub bytes: Option<u64>,
    /// Why it failed, as a clause.
    pub reason: String,
}

impl std::error::Error for OutOfMemory {}

impl fmt::Display for OutOfMemory {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { name, bytes, reason } = self;
        match bytes {
            Some(bytes) => write!(f, "cannot allocate the {bytes} bytes of `{name}`: {reason}"),
            None => write!(f, "{name}: {reason}"),
        }
    }
}

/// An empty vector with capacity for `len` elements. `name` names it in the error.
///
/// # Errors
/// [`OutOfMemory`] if the allocation fails.
pub fn host_vec<T>(len: usize, name: &str) -> Result<Vec<T>, OutOfMemory> {
    let mut vec = Vec::new();
    vec.try_reserve_exact(len).map_err(|_| no_host_memory::<T>(len, name))?;
    ask_for_huge_pages(&vec);
    Ok(vec)
}

/// A vector of `len` zeros. The system maps its pages on first write, so threads that fill it share that work.
///
/// # Errors
/// [`OutOfMemory`] if the allocation fails.
pub fn host_zeros<T: Zeroable>(len: usize, name: &str) -> Result<Vec<T>, OutOfMemory> {
    let vec = bytemuck::allocation::try_zeroed_vec(len).map_err(|()| no_host_memory::<T>(len, name))?;
    ask_for_huge_pages(&vec);
    Ok(vec)
}

/// Fails if `bytes` of memory cannot be allocated now; keeps none. For code of libraries, whose own allocations abort.
///
/// # Errors
/// [`OutOfMemory`] if the allocation fails.
pub fn check_free(bytes: u64, name: &str) -> Result<(), OutOfMemory> {
    host_vec::<u8>(usize::try_from(bytes).unwrap_or(usize::MAX), name).map(drop)
}

/// Asks the system to back a large vector with pages of 2 MiB. Faulting in pages of 4 KiB took half of the time of
/// reading a scene.
#[cfg(target_os = "linux")]
fn ask_for_huge_pages<T>(vec: &Vec<T>) {
    const PAGE: usize = 2 << 20;
    let start = vec.as_ptr() as usize;
    let (first, end) = (start.next_multiple_of(PAGE), (start + vec.capacity() * size_of::<T>()) / PAGE * PAGE);
    if first < end {
        // SAFETY: the range lies inside the vector's allocation, and the advice changes none of its bytes. A system
        // without such pages returns an error, which is ignored.
        _ = unsafe { libc::madvise(first as *mut libc::c_void, end - first, libc::MADV_HUGEPAGE) };
    }
}

#[cfg(not(target_os = "linux"))]
fn ask_for_huge_pages<T>(_vec: &Vec<T>) {}

/// Lets all threads allocate from one arena if the addresses of this process are limited (`ulimit -v`). The allocator
/// of glibc reserves 64 MiB for an arena of a thread's own whenever it finds room for them: also after a check of free
/// memory, whose bytes are missing then.
#[cfg(all(target_os = "linux", target_env = "gnu"))]
pub fn share_arena_under_a_limit() {
    let mut limit = libc::rlimit { rlim_cur: 0, rlim_max: 0 };
    // SAFETY: the limit is written to a variable of its type, and the option has this value in the manual.
    unsafe {
        if libc::getrlimit(libc::RLIMIT_AS, &raw mut limit) == 0 && limit.rlim_cur != libc::RLIM_INFINITY {
            libc::mallopt(libc::M_ARENA_MAX, 1);
        }
    }
}

#[cfg(not(all(target_os = "linux", target_env = "gnu")))]
pub fn share_arena_under_a_limit() {}

fn no_host_memory<T>(len: usize, name: &str) -> OutOfMemory {
    OutOfMemory {
        name: name.to_owned(),
        bytes: Some((size_of::<T>() as u64).saturating_mul(len as u64)),
        reason: "the host has too little free memory".to_owned(),
    }
}
