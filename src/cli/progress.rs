//! The progress of long work on stderr.

use std::io::{IsTerminal, stderr};
use std::sync::{Mutex, OnceLock, PoisonError};
use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressStyle};

use super::remark;

/// On a terminal a bar that appears after half a second and is removed when dropped; elsewhere a line every ten
/// seconds.
pub(super) struct Bar {
    label: String,
    started: Instant,
    is_terminal: bool,
    bar: OnceLock<ProgressBar>,
    lines: Lines,
}

const PATIENCE: Duration = Duration::from_millis(500);

impl Bar {
    pub fn new(label: impl Into<String>) -> Self {
        Self {
            label: label.into(),
            started: Instant::now(),
            is_terminal: stderr().is_terminal(),
            bar: OnceLock::new(),
            lines: Lines::default(),
        }
    }

    /// Shows the completed fraction, how many of the `things` are completed in a second, and an estimate of the time
    /// left.
    pub fn set_counted(&self, done: usize, all: usize, things: &str) {
        let rate = done as f64 / self.started.elapsed().as_secs_f64();
        self.show(done as f64 / all as f64, &format!(", {rate:.1} {things}/s"));
    }

    /// Shows the completed fraction and an estimate of the time left.
    pub fn set(&self, fraction: f64) {
        self.show(fraction, "");
    }

    /// As [`set`](Self::set), for work that an error would end.
    pub fn advance(&self, fraction: f64) -> anyhow::Result<()> {
        self.set(fraction);
        Ok(())
    }

    fn show(&self, fraction: f64, rate: &str) {
        let elapsed = self.started.elapsed();
        if self.is_terminal && elapsed > PATIENCE {
            let bar = self.bar.get_or_init(|| {
                let style = ProgressStyle::with_template("{msg} [{bar:40}] {percent:>3} %{prefix}");
                let style = style.unwrap_or_else(|_| ProgressStyle::default_bar()).progress_chars("=> ");
                ProgressBar::new(1000).with_style(style).with_message(self.label.clone())
            });
            bar.set_prefix(rate.to_owned() + &left(elapsed, fraction));
            bar.set_position((fraction * 1000.0) as u64);
        } else if let Some(line) = self.lines.next(&self.label, elapsed, fraction, rate).filter(|_| !self.is_terminal) {
            remark(&line);
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

/// The lines of progress where there is no terminal.
#[derive(Default)]
struct Lines {
    last: Mutex<Duration>,
}

impl Lines {
    const EVERY: Duration = Duration::from_secs(10);

    /// The line that is due after `elapsed`, if any.
    fn next(&self, label: &str, elapsed: Duration, fraction: f64, rate: &str) -> Option<String> {
        let mut last = self.last.lock().unwrap_or_else(PoisonError::into_inner);
        if elapsed < *last + Self::EVERY {
            return None;
        }
        *last = elapsed;
        Some(format!("{label}: {:.0} %{rate}{}", fraction * 100.0, left(elapsed, fraction)))
    }
}

/// The time left if the rest is as fast as what is done: ", 2 min left".
fn left(elapsed: Duration, fraction: f64) -> String {
    let seconds = elapsed.as_secs_f64() * (1.0 - fraction) / fraction;
    match seconds {
        s if !s.is_finite() => String::new(),
        s if s < 99.5 => format!(", {s:.0} s left"),
        s => format!(", {:.0} min left", s / 60.0),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn without_a_terminal_there_is_a_line_every_ten_seconds() {
        let lines = Lines::default();
        let at = |seconds: u64, fraction: f64| lines.next("choosing", Duration::from_secs(seconds), fraction, "");
        assert_eq!(at(0, 0.0), None);
        assert_eq!(at(9, 0.3), None);
        assert_eq!(at(12, 0.4).as_deref(), Some("choosing: 40 %, 18 s left"));
        assert_eq!(at(21, 0.5), None);
        assert_eq!(at(300, 0.5).as_deref(), Some("choosing: 50 %, 5 min left"));
        assert_eq!(at(400, 0.0).as_deref(), Some("choosing: 0 %"));
    }
}
