//! Messages in the window: notes and errors.

use std::time::{Duration, Instant};

/// A message, and the time at which it was shown.
pub struct Message {
    pub text: String,
    pub is_error: bool,
    since: Instant,
}

/// The messages that are shown. Notes disappear after a while; errors stay until they are closed.
#[derive(Default)]
pub struct Messages {
    all: Vec<Message>,
    /// Messages since the last [`Messages::take_new`]: true for an error, and its text.
    new: Vec<(bool, String)>,
    /// The first failure to open or build something, for callers without a window.
    pub failure: Option<anyhow::Error>,
}

const NOTE_DURATION: Duration = Duration::from_secs(6);

impl Messages {
    pub fn note(&mut self, text: impl Into<String>) {
        self.show(text.into(), false);
    }

    pub fn error(&mut self, text: impl Into<String>) {
        self.show(text.into(), true);
    }

    /// Shows the messages of another viewer, too: all of them, or those since a time.
    pub fn share(&mut self, other: &Self, since: Option<Instant>) {
        let shared = other.all.iter().filter(|message| since.is_none_or(|since| message.since >= since));
        shared.for_each(|message| self.show(message.text.clone(), message.is_error));
    }

    fn show(&mut self, text: String, is_error: bool) {
        self.new.push((is_error, text.clone()));
        // A repeated message starts its time again.
        self.all.retain(|message| message.text != text);
        self.all.push(Message { text, is_error, since: Instant::now() });
    }

    /// The visible messages, the oldest first.
    pub fn shown(&mut self) -> &[Message] {
        self.all.retain(|message| message.is_error || message.since.elapsed() < NOTE_DURATION);
        &self.all
    }

    /// Removes a message that no longer holds.
    pub fn retract(&mut self, text: &str) {
        self.all.retain(|message| message.text != text);
    }

    pub fn close(&mut self, index: usize) {
        self.all.remove(index);
    }

    pub fn close_errors(&mut self) {
        self.all.retain(|message| !message.is_error);
    }

    /// The time until the next note disappears; `None` without notes.
    pub fn next_change(&self) -> Option<Duration> {
        let notes = self.all.iter().filter(|message| !message.is_error);
        notes.map(|message| NOTE_DURATION.saturating_sub(message.since.elapsed())).min()
    }

    /// The messages since the last call: true for an error, and its text.
    pub fn take_new(&mut self) -> Vec<(bool, String)> {
        std::mem::take(&mut self.new)
    }
}
