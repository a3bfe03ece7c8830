//! Jobs: work on other threads that reports events. Frames never wait for a job.
//!
//! - `events` - handling of the events, and starting the builds of pictures
//! - `file_watch` - waiting for changes of scene files
//! - `measuring` - the costs of knobs in a view

pub(crate) mod events;
pub(crate) mod file_watch;
mod measuring;

pub(crate) use file_watch::FileStamp;
pub(crate) use measuring::{ALL_KNOBS, KnobCost, KnobCosts, costs};

use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;

use anyhow::{Result, anyhow};

use crate::camera::CameraFile;
use crate::options::Options;
use crate::pixels::Pixels;
use crate::scene::Gaussians;
use crate::viewer::frame::{Drawn, Side};
use crate::viewer::model::{
    Contributions, EditResult, Evaluation, OpenedScene, PairDifference, Photographs, Selection, SelectionMode,
};

/// A report of a job.
pub enum JobEvent {
    /// Layer number, and the fraction read, 0 to 1.
    Reading(u64, f64),
    /// Layer number, and the Gaussians read so far.
    Partial(u64, Arc<Gaussians>),
    /// Layer number, and the scene.
    Read(u64, Result<OpenedScene>),
    /// Contributions to the view, for a selection.
    Contributions(Selection, SelectionMode, Result<Contributions>),
    /// Number of a layer whose file has changed.
    Changed(u64, Result<()>),
    Cameras(PathBuf, Result<CameraFile>),
    /// A scene is on the GPU and can be drawn from any view.
    Built(Side, Result<Box<Drawn>>),
    /// A photograph or the reference: the number of the request, its name and pixels.
    Picture(u64, String, Result<Pixels>),
    /// The photographs of a folder.
    Photographs(Result<Photographs>),
    /// Camera index, and the thumbnail of its photograph.
    Thumbnail(usize, Result<Pixels>),
    Evaluated(Result<Evaluation>),
    /// Layer number, and the result of its edit.
    Edited(u64, Result<EditResult>),
    /// The measured difference of two pictures.
    Compared(Result<PairDifference>),
    /// The fraction of a measurement that is done, 0 to 1.
    Measuring(f64),
    Measured(Result<KnobCosts>),
    /// The options chosen for a budget, and the reason.
    Chosen(Result<(Options, String)>),
    /// The fraction of the files written, 0 to 1.
    Writing(f64),
    /// All files are written; the text names them.
    Written(Result<String>),
}

/// Starts jobs and receives their events.
pub struct Jobs {
    sender: Sender<JobEvent>,
    receiver: Receiver<JobEvent>,
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
#[derive(Clone)]
pub struct Reporter {
    sender: Sender<JobEvent>,
    wake: Arc<dyn Fn() + Send + Sync>,
}

impl Reporter {
    pub fn send(&self, event: JobEvent) {
        // The receiver is dropped when the window is closed.
        let _ = self.sender.send(event);
        (self.wake)();
    }
}

impl Jobs {
    /// `wake` is called, from any thread, after every event.
    pub fn new(wake: Arc<dyn Fn() + Send + Sync>) -> Self {
        let (sender, receiver) = channel();
        Self { sender, receiver, wake, running: Mutex::default() }
    }

    /// The events since the last call.
    pub fn poll(&self) -> Vec<JobEvent> {
        self.receiver.try_iter().collect()
    }

    /// Runs `work` on another thread. `to_event` turns its result into an event, which is sent even if `work` panics.
    pub fn start<T: Send + 'static>(
        &self,
        work: impl FnOnce(&Reporter) -> Result<T> + Send + 'static,
        to_event: impl FnOnce(Result<T>) -> JobEvent + Send + 'static,
    ) {
        let reporter = Reporter { sender: self.sender.clone(), wake: self.wake.clone() };
        let thread = std::thread::spawn(move || {
            let outcome = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| work(&reporter)));
            let outcome = outcome.unwrap_or_else(|_| Err(anyhow!("a defect of smalto ended this; see the terminal")));
            reporter.send(to_event(outcome));
        });
        let mut running = self.running.lock().expect("no holder of the threads panics");
        running.retain(|thread| !thread.is_finished());
        running.push(thread);
    }

    /// Waits until no job runs. A driver may crash if the program ends while a job uses the device.
    pub fn wait(&self) {
        for thread in self.running.lock().expect("no holder of the threads panics").drain(..) {
            // A job does not panic, and its result is no longer needed.
            _ = thread.join();
        }
    }
}
