//! What holds for the whole process: forks, locks, and work that Ctrl-C ends.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{RecvTimeoutError, sync_channel};
use std::sync::{Arc, Mutex, MutexGuard, OnceLock, PoisonError};
use std::thread;
use std::time::Duration;

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

/// How often Python is asked whether a signal arrived.
const SIGNALS: Duration = Duration::from_millis(50);
/// The stack of a main thread on Linux: shader compilers of drivers count on it.
const STACK_BYTES: usize = 8 << 20;

/// Runs `work` without the lock of Python, on a thread of its own. If a signal handler raises an exception, as that of
/// Ctrl-C does, the exception is returned at once; the work is told that it is cancelled, and ends in the background.
pub fn interruptible<T: Send + 'static>(
    py: Python,
    work: impl FnOnce(&AtomicBool) -> T + Send + 'static,
) -> PyResult<T> {
    let (done, mut result) = sync_channel(1);
    let is_cancelled = Arc::new(AtomicBool::new(false));
    let told = is_cancelled.clone();
    let run = move || {
        // Nobody waits for the result of cancelled work.
        let _ = done.send(work(&told));
    };
    let worker = thread::Builder::new().name("smalto-call".to_owned()).stack_size(STACK_BYTES).spawn(run)?;
    loop {
        let waited;
        (waited, result) = py.detach(move || (result.recv_timeout(SIGNALS), result));
        match waited {
            Ok(value) => {
                let _ = worker.join();
                return Ok(value);
            }
            Err(RecvTimeoutError::Timeout) => {
                py.check_signals().inspect_err(|_| is_cancelled.store(true, Ordering::Relaxed))?;
            }
            Err(RecvTimeoutError::Disconnected) => {
                let panic = worker.join().expect_err("work that ends without a result panicked");
                std::panic::resume_unwind(panic);
            }
        }
    }
}
