//! What waits to be sent on a connection. Only the newest picture and the newest state wait.

use std::collections::VecDeque;
use std::sync::Mutex;
use std::time::Instant;

use tokio::sync::Notify;

use super::pictures::Exact;

/// Most texts that wait, and their bytes. A client that takes none for so long is not there any more.
const MAX_TEXTS: usize = 256;
const MAX_BYTES: usize = 8 << 20;

/// What waits to be sent, in this order.
#[derive(Default)]
struct Waiting {
    texts: VecDeque<String>,
    state: Option<String>,
    picture: Option<(u32, Vec<u8>)>,
    exact: Option<Exact>,
    /// The reason why the connection ends.
    end: Option<String>,
    /// Number of the newest picture that was put here.
    newest: u32,
    /// Numbers of the pictures that were sent and are not known to be shown, and when.
    sent: VecDeque<(u32, Instant)>,
}

/// A message to send.
#[derive(Debug, PartialEq)]
pub enum Outgoing {
    Text(String),
    Binary(Vec<u8>),
    /// End the connection for this reason.
    End(String),
}

/// The messages to a client, between the threads that make them and the connection.
#[derive(Default)]
pub struct Outbox {
    waiting: Mutex<Waiting>,
    news: Notify,
}

impl Outbox {
    fn change<T>(&self, change: impl FnOnce(&mut Waiting) -> T) -> T {
        let changed = change(&mut self.waiting.lock().expect("no holder of the outbox panics"));
        self.news.notify_one();
        changed
    }

    pub fn text(&self, text: String) {
        self.change(|waiting| {
            waiting.texts.push_back(text);
            let bytes: usize = waiting.texts.iter().map(String::len).sum();
            if waiting.texts.len() > MAX_TEXTS || bytes > MAX_BYTES {
                waiting.end.get_or_insert_with(|| "the client takes no messages".to_owned());
            }
        });
    }

    /// Replaces the state that was not sent yet.
    pub fn state(&self, text: String) {
        self.change(|waiting| waiting.state = Some(text));
    }

    /// Replaces the picture that was not sent yet, unless that is newer.
    pub fn picture(&self, number: u32, message: Vec<u8>) {
        self.change(|waiting| {
            if waiting.newest < number {
                (waiting.newest, waiting.picture, waiting.exact) = (number, Some((number, message)), None);
            }
        });
    }

    /// Sends the PNG of a picture, unless there is a newer one.
    pub fn exact(&self, exact: Exact) {
        self.change(|waiting| {
            if waiting.newest < exact.number() {
                waiting.newest = exact.number();
                waiting.exact = Some(exact);
            }
        });
    }

    pub fn end(&self, reason: String) {
        self.change(|waiting| {
            waiting.end.get_or_insert(reason);
        });
    }

    /// When the newest picture up to this number was sent, once for each.
    pub fn sent_at(&self, number: u32) -> Option<Instant> {
        self.change(|waiting| {
            let mut found = None;
            while waiting.sent.front().is_some_and(|(sent, _)| *sent <= number) {
                found = waiting.sent.pop_front().map(|(_, at)| at);
            }
            found
        })
    }

    fn take(&self) -> Option<Outgoing> {
        let waiting = &mut *self.waiting.lock().expect("no holder of the outbox panics");
        if let Some(reason) = &waiting.end {
            return Some(Outgoing::End(reason.clone()));
        }
        if let Some(text) = waiting.texts.pop_front().or_else(|| waiting.state.take()) {
            return Some(Outgoing::Text(text));
        }
        if let Some((number, message)) = waiting.picture.take() {
            waiting.sent.push_back((number, Instant::now()));
            return Some(Outgoing::Binary(message));
        }
        waiting.exact.as_mut()?.next().map(Outgoing::Binary)
    }

    /// The next message, once there is one.
    pub async fn next(&self) -> Outgoing {
        loop {
            let news = self.news.notified();
            if let Some(message) = self.take() {
                return message;
            }
            news.await;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_the_newest_picture_waits() {
        let outbox = Outbox::default();
        outbox.picture(1, vec![1]);
        outbox.picture(3, vec![3]);
        outbox.picture(2, vec![2]);
        (0..3).for_each(|i| outbox.state(i.to_string()));
        outbox.text("first".to_owned());
        let text = |text: &str| Some(Outgoing::Text(text.to_owned()));
        assert_eq!([outbox.take(), outbox.take()], [text("first"), text("2")]);
        assert_eq!([outbox.take(), outbox.take()], [Some(Outgoing::Binary(vec![3])), None]);
        assert!(outbox.sent_at(2).is_none() && outbox.sent_at(3).is_some() && outbox.sent_at(3).is_none());
    }

    #[test]
    fn a_newer_picture_stops_a_png() {
        let outbox = Outbox::default();
        outbox.exact(Exact::new([1, 0], [1, 1], vec![0; 100_000], true));
        assert!(matches!(outbox.take(), Some(Outgoing::Binary(part)) if part.len() > 28));
        outbox.picture(2, vec![2]);
        assert_eq!([outbox.take(), outbox.take()], [Some(Outgoing::Binary(vec![2])), None]);
        outbox.exact(Exact::new([1, 0], [1, 1], vec![0], true));
        assert_eq!(outbox.take(), None);
    }

    #[test]
    fn a_client_that_takes_nothing_is_given_up() {
        let outbox = Outbox::default();
        (0..10_000).for_each(|_| outbox.text(String::new()));
        assert!(matches!(outbox.take(), Some(Outgoing::End(_))));
    }
}
