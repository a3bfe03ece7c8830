//! What a client was told of a viewer, so that it is told only what has changed.

use std::time::{Duration, Instant};

use super::messages::{ServerMessage, State};
use super::state::state;
use crate::camera::Timeline;
use crate::viewer::frame::Session;

/// Least time from one state to the next.
const STATES: Duration = Duration::from_millis(100);

/// Most requests for rest that wait.
const MAX_RESTS: usize = 64;

/// What a client was told of a viewer.
#[derive(Default)]
pub struct News {
    /// The last state as text, and when it was told.
    state: Option<(String, Instant)>,
    cameras: usize,
    path: Timeline,
    /// Numbers of the requests for rest that are not answered yet.
    rests: Vec<u32>,
}

/// What a client is told after a frame.
pub struct Told {
    pub texts: Vec<String>,
    pub state: Option<String>,
    /// When a state can be told that came too soon after another one.
    pub next: Option<Instant>,
}

impl News {
    /// Answers a request for rest later.
    ///
    /// # Errors
    /// Too many of them wait.
    pub fn await_rest(&mut self, number: u32) -> Result<(), String> {
        if self.rests.len() >= MAX_RESTS {
            return Err("too much is asked for at once".to_owned());
        }
        self.rests.push(number);
        Ok(())
    }

    /// True if a request for rest is not answered yet.
    pub fn awaits_rest(&self) -> bool {
        !self.rests.is_empty()
    }

    /// The state as text, if it is to be told now; or when it can be told.
    pub fn of_state(&mut self, state: &State) -> (Option<String>, Option<Instant>) {
        let text = ServerMessage::State(Box::new(state.clone())).text();
        let now = Instant::now();
        match &self.state {
            Some((last, _)) if *last == text => (None, None),
            Some((_, at)) if *at + STATES > now => (None, Some(*at + STATES)),
            _ => {
                self.state = Some((text.clone(), now));
                (Some(text), None)
            }
        }
    }

    /// What has changed in a viewer. `has_input` is true while something waits for the next frame.
    pub fn of(&mut self, session: &mut Session, has_input: bool) -> Told {
        let now_shown = state(session);
        let (state, next) = self.of_state(&now_shown);
        let mut texts = Vec::new();
        let viewer = &session.viewer;
        let cameras = &viewer.cameras.list;
        if cameras.len() != self.cameras {
            self.cameras = cameras.len();
            let names = cameras.iter().map(|camera| camera.name.clone()).collect();
            texts.push(ServerMessage::Cameras { names }.text());
        }
        if viewer.film.timeline != self.path {
            self.path.clone_from(&viewer.film.timeline);
            texts.push(ServerMessage::Path { keys: self.path.to_value() }.text());
        }
        if !self.rests.is_empty() && !has_input && session.is_settled() {
            let state = Box::new(now_shown);
            let rests = self.rests.drain(..);
            texts.extend(rests.map(|number| ServerMessage::Rests { number, state: state.clone() }.text()));
        }
        Told { texts, state, next }
    }
}
