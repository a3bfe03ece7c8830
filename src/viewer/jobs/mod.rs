//! Jobs: work on other threads that reports events. Frames never wait for a job.
//!
//! - `file_watch` - waiting for changes of scene files
//! - `measuring` - the costs of knobs in a view

pub(crate) mod file_watch;
mod measuring;

pub(crate) use file_watch::FileStamp;
pub(crate) use measuring::{ALL_KNOBS, KnobCost, KnobCosts, costs};

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;

use anyhow::{Result, anyhow};

use crate::threads;

/// Starts jobs and receives their events.
pub struct Jobs<E> {
    sender: Sender<E>,
    receiver: Receiver<E>,
    wake: Arc<dyn Fn() + Send + Sync>,
    running: Mutex<Vec<JoinHandle<()>>>,
}

/// A flag that cancels a job.
#[derive(Clone, Default)]
pub struct Cancel(Arc<AtomicBool>);

impl Cancel {
    pub fn cancel(&self) {
        self.0.store(true, Ordering::Relaxed);
    }

    pub fn is_cancelled(&self) -> bool {
        self.0.load(Ordering::Relaxed)
    }
}

/// Sends the events of a job.
pub struct Reporter<E> {
    sender: Sender<E>,
    wake: Arc<dyn Fn() + Send + Sync>,
}

impl<E> Reporter<E> {
    pub fn send(&self, event: E) {
        // The receiver is dropped when the window is closed.
        let _ = self.sender.send(event);
        (self.wake)();
    }
}

impl<E: Send + 'static> Jobs<E> {
    /// `wake` is called, from any thread, after every event.
    pub fn new(wake: Arc<dyn Fn() + Send + Sync>) -> Self {
        let (sender, receiver) = channel();
        Self { sender, receiver, wake, running: Mutex::default() }
    }

    /// The events since the last call.
    pub fn poll(&self) -> Vec<E> {
        self.receiver.try_iter().collect()
    }

    /// Runs `work` on another thread. `to_event` turns its result into an event, which is sent even if `work` panics or
    /// the system refuses the thread.
    pub fn start<T: Send + 'static>(
        &self,
        work: impl FnOnce(&Reporter<E>) -> Result<T> + Send + 'static,
        to_event: impl FnOnce(Result<T>) -> E + Send + 'static,
    ) {
        let reporter = Reporter { sender: self.sender.clone(), wake: self.wake.clone() };
        // A refused thread drops what it owns, so it takes its work when it runs.
        let job = Arc::new(Mutex::new(Some((work, to_event, reporter))));
        let own = job.clone();
        let started = threads::spawn(move || {
            let (work, to_event, reporter) = taken(&own).expect("the thread is started once");
            let outcome = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| work(&reporter)));
            let outcome = outcome.unwrap_or_else(|_| Err(anyhow!("a defect of smalto ended this; see the terminal")));
            reporter.send(to_event(outcome));
        });
        let thread = match started {
            Ok(thread) => thread,
            Err(refused) => {
                let (_, to_event, reporter) = taken(&job).expect("no thread took the job");
                return reporter.send(to_event(Err(refused.into())));
            }
        };
        let mut running = self.running.lock().expect("no holder of the threads panics");
        running.retain(|thread| !thread.is_finished());
        running.push(thread);
    }

    /// True while a job runs.
    pub fn are_running(&self) -> bool {
        self.running.lock().expect("no holder of the threads panics").iter().any(|thread| !thread.is_finished())
    }

    /// Waits until no job runs. A driver may crash if the program ends while a job uses the device.
    pub fn wait(&self) {
        for thread in self.running.lock().expect("no holder of the threads panics").drain(..) {
            // A job does not panic, and its result is no longer needed.
            _ = thread.join();
        }
    }
}

fn taken<T>(job: &Mutex<Option<T>>) -> Option<T> {
    job.lock().expect("no holder of a job panics").take()
}
