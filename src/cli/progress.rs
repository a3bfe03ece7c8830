//! A progress bar on stderr for long work.

use std::cell::OnceCell;
use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressStyle};

/// A bar that appears after half a second, on a terminal only, and is removed when dropped.
pub(super) struct Bar {
    label: String,
    started: Instant,
    bar: OnceCell<ProgressBar>,
}

const PATIENCE: Duration = Duration::from_millis(500);

impl Bar {
    pub fn new(label: impl Into<String>) -> Self {
        Self { label: label.into(), started: Instant::now(), bar: OnceCell::new() }
    }

    pub fn set(&self, fraction: f64) {
        if self.started.elapsed() > PATIENCE {
            let bar = self.bar.get_or_init(|| {
                let style = ProgressStyle::with_template("{msg} [{bar:40}] {percent:>3} %");
                let style = style.unwrap_or_else(|_| ProgressStyle::default_bar()).progress_chars("=> ");
                ProgressBar::new(1000).with_style(style).with_message(self.label.clone())
            });
            bar.set_position((fraction * 1000.0) as u64);
        }
    }
}

impl Drop for Bar {
    fn drop(&mut self) {
        if let Some(bar) = self.bar.get() {
            bar.finish_and_clear();
        }
    }
}
