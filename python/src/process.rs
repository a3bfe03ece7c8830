//! What holds for the whole process.

use std::sync::{Mutex, MutexGuard, OnceLock, PoisonError};

use pyo3::prelude::*;

use crate::errors::Error;

/// The process in which the first scene was read or drawn.
static PROCESS: OnceLock<u32> = OnceLock::new();

/// A process that was forked has neither the threads nor the device of its parent.
pub fn check_process() -> PyResult<()> {
    if *PROCESS.get_or_init(std::process::id) != std::process::id() {
        return Err(Error::new_err(
            "this process was forked from one that draws, and cannot draw: start processes with the method 'spawn' \
             (multiprocessing.set_start_method)",
        ));
    }
    Ok(())
}

/// A panic of another holder leaves nothing half done that would be used.
pub fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}
