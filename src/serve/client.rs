//! One viewer, and the pictures that its client gets.

use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering};
use std::time::{Duration, Instant};

use anyhow::Result;
use crossbeam_channel::Sender;

use super::admission::Admission;
use super::link::Link;
use super::outbox::Outbox;
use super::pictures::ShownPicture;
use super::session_event::{Said, SessionEvent};
use crate::gpu::{Device, DeviceLost};
use crate::viewer::remote::{ClientMessage, ServerMessage, State, drive, state, welcome};
use crate::viewer::{Offscreen, Setup};

/// Time without a change after which a picture is sent without loss.
const REST: Duration = Duration::from_millis(150);

/// Least time from one state to the next.
const STATES: Duration = Duration::from_millis(100);

/// Most messages that wait until the scenes are read.
const MAX_EARLY: usize = 256;

/// Sides and pixels of pictures.
const SIDES: [u32; 2] = [16, 7680];
const MAX_PIXELS: u64 = 3840 * 2400;

/// The viewer of one client.
pub struct Client {
    pub id: u64,
    offscreen: Offscreen,
    outbox: Arc<Outbox>,
    events: Sender<SessionEvent>,
    link: Link,
    /// What the user did since the last frame.
    input: Vec<egui::Event>,
    /// Number of the last message of what the user did.
    answered: u32,
    /// Number of the newest picture, also for the threads that compress older ones.
    newest: Arc<AtomicU32>,
    /// Number of the newest picture that the client shows.
    shown: u32,
    /// The pixels of the newest picture.
    picture: Option<Arc<ShownPicture>>,
    /// The newest picture is one without loss.
    is_exact: bool,
    changed: Instant,
    drawn: Instant,
    /// When the next frame is due; `None` if it waits for something to happen.
    due: Option<Instant>,
    /// The text that the client got last, and when.
    state: (String, Instant),
    cameras: usize,
    /// What the client said before the scenes were read; `None` once they are.
    early: Option<Vec<Said>>,
}

/// The size of pictures for a client that has room for this one.
pub fn allowed(size: [u32; 2]) -> [u32; 2] {
    let [width, height] = size.map(|side| side.clamp(SIDES[0], SIDES[1]));
    let rows = (MAX_PIXELS / u64::from(width)) as u32;
    [width, height.min(rows)]
}

impl Client {
    pub fn new(
        (id, outbox, events): (u64, Arc<Outbox>, Sender<SessionEvent>),
        (setup, device, admission): (Setup, &Device, &Admission),
        (size, view): ([u32; 2], Option<serde_json::Value>),
    ) -> Result<Self> {
        let wake = events.clone();
        // The receiver is gone when the server ends.
        let wake = Arc::new(move || drop(wake.send(SessionEvent::Wake(id))));
        let setup = Setup { scenes: Vec::new(), cameras: None, ..setup };
        let greeting = welcome(device, &setup.bindings, admission.folder.is_some());
        outbox.text(text(&ServerMessage::Welcome(Box::new(greeting))));
        let (now, input, picture) = (Instant::now(), Vec::new(), None);
        Ok(Self {
            id,
            offscreen: Offscreen::bare(setup, device, allowed(size), wake)?,
            outbox,
            events,
            link: Link::default(),
            input,
            answered: 0,
            newest: Arc::default(),
            shown: 0,
            picture,
            is_exact: false,
            changed: now,
            drawn: now,
            due: None,
            state: (String::new(), now - STATES),
            cameras: 0,
            early: Some(
                view.map(|view| Said { at: now, message: ClientMessage::View { view }, file: None })
                    .into_iter()
                    .collect(),
            ),
        })
    }

    /// True once [`Client::join`] was called.
    pub fn has_joined(&self) -> bool {
        self.early.is_none()
    }

    /// Shows what the first viewer of the server has read.
    pub fn join(&mut self, first: &Offscreen) {
        self.offscreen.join(first);
        self.early.take().into_iter().flatten().for_each(|said| self.say(said));
        self.due = Some(Instant::now());
    }

    pub fn wake(&mut self) {
        let now = Instant::now();
        self.due = Some(self.due.map_or(now, |due| due.min(now)));
    }

    /// Sends a state, unless it is that of the last time.
    pub fn send_state(&mut self, state: State) {
        let text = text(&ServerMessage::State(Box::new(state)));
        if text != self.state.0 {
            self.outbox.state(text.clone());
            self.state.0 = text;
        }
        self.state.1 = Instant::now();
    }

    /// Does what a message asks for.
    pub fn say(&mut self, said: Said) {
        if let Some(early) = &mut self.early {
            return if early.len() < MAX_EARLY {
                early.push(said)
            };
        }
        let Said { at, message, file } = said;
        if let ClientMessage::Input { number, .. } = message {
            self.answered = number;
        }
        let done = match message {
            ClientMessage::Shown { picture } => {
                self.shown = self.shown.max(picture.min(self.newest.load(Ordering::Relaxed)));
                if let Some(sent) = self.outbox.sent_at(picture) {
                    self.link.shown(sent, at);
                }
                Ok(Vec::new())
            }
            ClientMessage::Resize { size } => match self.offscreen.resize(allowed(size)) {
                Ok(()) => Ok(Vec::new()),
                Err(problem) => Err(format!("{problem:#}")),
            },
            ClientMessage::Open { .. } => {
                if let Some(file) = file {
                    self.offscreen.viewer().drop_file(&file);
                }
                Ok(Vec::new())
            }
            message => drive(&mut self.offscreen.session, message),
        };
        match done {
            Ok(events) => self.input.extend(events),
            Err(why) => self.outbox.text(text(&ServerMessage::Refused { why })),
        }
        self.wake();
    }

    /// A picture of this client was compressed to this many bytes.
    pub fn compressed(&mut self, pixels: u64, bytes: usize) {
        self.link.compressed(pixels, bytes);
    }

    /// The time at which [`Client::step`] has something to do.
    pub fn due(&self) -> Option<Instant> {
        let under_way = self.newest.load(Ordering::Relaxed) - self.shown;
        // A client that does not show its pictures gets no more of them.
        self.due
            .filter(|_| self.has_joined() && under_way < self.link.window())
            .map(|due| due.max(self.drawn + self.link.interval()))
    }

    /// Draws a frame, and sends what has changed.
    ///
    /// # Errors
    /// [`DeviceLost`]. Other problems end the connection.
    pub fn step(&mut self) -> Result<()> {
        match self.advance() {
            Err(problem) if problem.is::<DeviceLost>() => Err(problem),
            Err(problem) => {
                self.outbox.end(format!("{problem:#}"));
                self.due = None;
                Ok(())
            }
            Ok(()) => Ok(()),
        }
    }

    fn advance(&mut self) -> Result<()> {
        self.drawn = Instant::now();
        let before = self.offscreen.viewer().timing.pace.shown;
        let input = std::mem::take(&mut self.input);
        let repaint_delay = self.offscreen.frame(input)?.repaint_delay;
        // The values of a picture are read back in the frame after it.
        let has_news = self.offscreen.session.retire_frames(true)?;
        let now = Instant::now();
        if self.offscreen.viewer().timing.pace.shown > before && self.offscreen.session.pair.first.is_some() {
            let (size, rgba) = (self.offscreen.size(), self.offscreen.screen()?);
            if self.picture.as_ref().is_none_or(|last| last.size != size || last.rgba != rgba) {
                self.send_compressed(Arc::new(ShownPicture { size, rgba }));
                self.changed = now;
            }
        }
        let is_settled = self.offscreen.session.is_settled();
        let exact_at = (is_settled && !self.is_exact && self.picture.is_some()).then_some(self.changed + REST);
        if exact_at.is_some_and(|at| at <= now) {
            self.send_exact();
        }
        let state_at = self.state.1 + STATES;
        let state = state(&mut self.offscreen.session);
        let is_new = text(&ServerMessage::State(Box::new(state.clone()))) != self.state.0;
        if is_new && state_at <= now {
            self.send_state(state);
        }
        self.send_cameras();
        let waits = [
            has_news.then_some(now),
            (repaint_delay < Duration::from_secs(3600)).then(|| now + repaint_delay),
            exact_at.filter(|_| !self.is_exact),
            (is_new && state_at > now).then_some(state_at),
        ];
        self.due = waits.into_iter().flatten().min();
        Ok(())
    }

    fn send_cameras(&mut self) {
        let cameras = &self.offscreen.session.viewer.cameras.list;
        if cameras.len() != self.cameras {
            self.cameras = cameras.len();
            let names = cameras.iter().map(|camera| camera.name.clone()).collect();
            self.outbox.text(text(&ServerMessage::Cameras { names }));
        }
    }

    /// Compresses and sends a picture on other threads, and measures its loss if it is still the newest.
    fn send_compressed(&mut self, picture: Arc<ShownPicture>) {
        let number = self.newest.fetch_add(1, Ordering::Relaxed) + 1;
        let pixels = picture.size.map(u64::from).iter().product();
        let (coding, answered) = (self.link.coding(pixels), self.answered);
        self.picture = Some(picture.clone());
        self.is_exact = false;
        let (id, outbox, newest, events) = (self.id, self.outbox.clone(), self.newest.clone(), self.events.clone());
        rayon::spawn(move || {
            let jpeg = match picture.compressed([number, answered], coding) {
                Ok(jpeg) => jpeg,
                Err(problem) => return outbox.end(format!("{problem:#}")),
            };
            let message = jpeg.message();
            _ = events.send(SessionEvent::Compressed { id, pixels, bytes: message.len() });
            outbox.picture(number, message);
            if newest.load(Ordering::Relaxed) == number
                && let Ok(psnr) = picture.loss(&jpeg)
            {
                outbox.text(text(&ServerMessage::Loss { picture: number, psnr }));
            }
        });
    }

    /// Sends the newest picture without loss.
    fn send_exact(&mut self) {
        let Some(picture) = self.picture.clone() else { return };
        let number = self.newest.fetch_add(1, Ordering::Relaxed) + 1;
        self.is_exact = true;
        let (outbox, answered) = (self.outbox.clone(), self.answered);
        rayon::spawn(move || match picture.png() {
            Ok(file) => outbox.exact([number, answered], picture.size, file),
            Err(problem) => outbox.end(format!("{problem:#}")),
        });
    }
}

/// A message as text.
pub fn text(message: &ServerMessage) -> String {
    serde_json::to_string(message).expect("messages are plain data")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pictures_have_a_bounded_size() {
        assert_eq!(allowed([1920, 1080]), [1920, 1080]);
        assert_eq!(allowed([0, 0]), [16, 16]);
        for wanted in [[u32::MAX; 2], [u32::MAX, 1], [1, u32::MAX], [5000, 5000]] {
            let size = allowed(wanted);
            assert!(size.map(u64::from).iter().product::<u64>() <= MAX_PIXELS, "{wanted:?}: {size:?}");
        }
    }
}
