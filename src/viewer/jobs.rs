//! What takes long, on threads of its own: the window never waits for it, and hears of it when it is done.

use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, Sender, channel};

use anyhow::{Result, anyhow};

use super::measuring::Costs;
use super::pictures::Drawn;
use crate::camera::CameraFile;
use crate::options::Options;
use crate::pixels::Pixels;
use crate::scene::{Gaussians, Scene};

/// What threads report.
pub enum News {
    /// Of the reading of layer `.0`: the fraction done.
    Reading(u64, f64),
    /// The first Gaussians of layer `.0`.
    Partial(u64, Arc<Gaussians>),
    Read(u64, Result<Scene>),
    Cameras(PathBuf, Result<CameraFile>),
    /// A picture is ready to be drawn from anywhere.
    Built(Side, Result<Box<Drawn>>),
    /// A photograph or a drawing of the reference, and what it is called.
    Picture(String, Result<Pixels>),
    Measured(Result<Costs>),
    /// What a budget chose, and why.
    Chosen(Result<(Options, String)>),
    /// Of what writes files: the fraction done.
    Writing(f64),
    Written(Result<String>),
}

/// The two pictures that a window can show.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Side {
    First,
    Second,
}

/// Starts threads and hears of them.
pub struct Jobs {
    sender: Sender<News>,
    receiver: Receiver<News>,
    wake: Arc<dyn Fn() + Send + Sync>,
}

/// Tells a thread that nobody waits for it any more.
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

/// Reports what a thread has to say.
#[derive(Clone)]
pub struct Reporter {
    sender: Sender<News>,
    wake: Arc<dyn Fn() + Send + Sync>,
}

impl Reporter {
    pub fn tell(&self, news: News) {
        // Nobody listens once the window is closed.
        let _ = self.sender.send(news);
        (self.wake)();
    }
}

impl Jobs {
    /// `wake` is called, from any thread, when there is news.
    pub fn new(wake: Arc<dyn Fn() + Send + Sync>) -> Self {
        let (sender, receiver) = channel();
        Self { sender, receiver, wake }
    }

    /// What has been reported since the last time.
    pub fn news(&self) -> Vec<News> {
        self.receiver.try_iter().collect()
    }

    /// Runs `work` on a thread of its own and reports what `tell` makes of its outcome, even if it panics.
    pub fn start<T: Send + 'static>(
        &self,
        work: impl FnOnce(&Reporter) -> Result<T> + Send + 'static,
        tell: impl FnOnce(Result<T>) -> News + Send + 'static,
    ) {
        let reporter = Reporter { sender: self.sender.clone(), wake: self.wake.clone() };
        std::thread::spawn(move || {
            let outcome = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| work(&reporter)));
            let outcome = outcome.unwrap_or_else(|_| Err(anyhow!("a defect of smalto ended this; see the terminal")));
            reporter.tell(tell(outcome));
        });
    }
}
