//! Threads whose start fails with an error where the system allows no more of them. The functions of the standard
//! library panic there, and so do those of the pool that shares work.

use std::error::Error;
use std::thread::{Builder, JoinHandle, ScopedJoinHandle};

use rayon::{ThreadPool, ThreadPoolBuilder};

use crate::host_memory::OutOfMemory;

/// Starts a thread.
///
/// # Errors
/// [`OutOfMemory`] if the system refuses it.
pub fn spawn<T: Send + 'static>(work: impl FnOnce() -> T + Send + 'static) -> Result<JoinHandle<T>, OutOfMemory> {
    Builder::new().spawn(work).map_err(|_| refused())
}

/// The scope of threads that may borrow.
pub struct Scope<'scope, 'env>(&'scope std::thread::Scope<'scope, 'env>);

/// Runs `work`, which may start threads that borrow, and waits for them. If `work` returns early because a thread was
/// refused, the threads that it has started must end without the others.
pub fn scope<'env, T>(work: impl for<'scope> FnOnce(&Scope<'scope, 'env>) -> T) -> T {
    std::thread::scope(|scope| work(&Scope(scope)))
}

impl<'scope> Scope<'scope, '_> {
    /// Starts a thread.
    ///
    /// # Errors
    /// [`OutOfMemory`] if the system refuses it.
    pub fn spawn<T: Send + 'scope>(
        &self,
        work: impl FnOnce() -> T + Send + 'scope,
    ) -> Result<ScopedJoinHandle<'scope, T>, OutOfMemory> {
        Builder::new().spawn_scoped(self.0, work).map_err(|_| refused())
    }
}

/// The result of a thread. A panic of the thread goes on in this one.
pub fn joined<T>(thread: ScopedJoinHandle<T>) -> T {
    thread.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic))
}

/// A pool of threads.
///
/// # Errors
/// [`OutOfMemory`] if the system refuses them.
pub fn pool(threads: usize) -> Result<ThreadPool, OutOfMemory> {
    ThreadPoolBuilder::new().num_threads(threads).build().map_err(|_| refused())
}

/// Starts the pool that shares work in this process, if it is not started.
///
/// # Errors
/// [`OutOfMemory`] if the system refuses its threads.
pub fn start_pool() -> Result<(), OutOfMemory> {
    match ThreadPoolBuilder::new().build_global() {
        // Without a source, the error is that the pool runs already.
        Err(error) if error.source().is_some() => Err(refused()),
        _ => Ok(()),
    }
}

fn refused() -> OutOfMemory {
    OutOfMemory {
        name: "threads".to_owned(),
        bytes: None,
        reason: "the host has too little free memory, or allows too few of them".to_owned(),
    }
}
