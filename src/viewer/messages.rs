//! What the window says in sentences.

use std::time::{Duration, Instant};

/// A sentence, and since when it is shown.
pub struct Message {
    pub text: String,
    pub is_error: bool,
    since: Instant,
}

/// Notes leave after a while; errors stay until they are closed.
#[derive(Default)]
pub struct Messages {
    all: Vec<Message>,
    /// Said since they were last asked for, to be told elsewhere too.
    fresh: Vec<(bool, String)>,
}

const NOTE_STAYS: Duration = Duration::from_secs(6);

impl Messages {
    pub fn note(&mut self, text: impl Into<String>) {
        self.say(text.into(), false);
    }

    pub fn error(&mut self, text: impl Into<String>) {
        self.say(text.into(), true);
    }

    fn say(&mut self, text: String, is_error: bool) {
        self.fresh.push((is_error, text.clone()));
        // Said again, it is as if said now.
        self.all.retain(|message| message.text != text);
        self.all.push(Message { text, is_error, since: Instant::now() });
    }

    /// What is to be shown now, the oldest first.
    pub fn shown(&mut self) -> &[Message] {
        self.all.retain(|message| message.is_error || message.since.elapsed() < NOTE_STAYS);
        &self.all
    }

    pub fn close(&mut self, place: usize) {
        self.all.remove(place);
    }

    /// When the next note leaves.
    pub fn next_change(&self) -> Option<Duration> {
        let notes = self.all.iter().filter(|message| !message.is_error);
        notes.map(|message| NOTE_STAYS.saturating_sub(message.since.elapsed())).min()
    }

    /// What has been said since the last time: whether it is an error, and the sentence.
    pub fn fresh(&mut self) -> Vec<(bool, String)> {
        std::mem::take(&mut self.fresh)
    }
}
