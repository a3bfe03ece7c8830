//! One viewer, and the pictures that its client gets.

use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering};
use std::time::{Duration, Instant};

use anyhow::Result;
use crossbeam_channel::Sender;
use rayon::ThreadPool;

use super::admission::Admission;
use super::films::{Film, Films};
use super::link::Link;
use super::outbox::Outbox;
use super::pictures::{Exact, ShownPicture};
use super::session_event::{Said, SessionEvent};
use crate::gpu::{Device, DeviceLost};
use crate::viewer::remote::{ClientMessage, News, ServerMessage, State, Told, check_fps, drive, is_of_render, welcome};
use crate::viewer::{FrameOutput, Offscreen, Request, Setup};

/// Time without a change after which a picture is sent without loss.
const REST: Duration = Duration::from_millis(150);

/// Most events that wait for a frame.
const MAX_INPUT: usize = 4096;

/// Most scenes of a client.
const MAX_SCENES: usize = 16;

/// Most messages that wait until the scenes are read.
const MAX_EARLY: usize = 256;

/// Most frames of a film: four minutes of 30 a second.
const MAX_FRAMES: usize = 7200;

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
    /// Compresses pictures.
    pool: Arc<ThreadPool>,
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
    news: News,
    films: Films,
    film: Option<Film>,
    /// What the client said before the scenes were read; `None` once they are.
    early: Option<Vec<Said>>,
}

/// The size of pictures for a client that has room for this one.
pub fn allowed(size: [u32; 2]) -> [u32; 2] {
    let size = size.map(|side| f64::from(side.clamp(SIDES[0], SIDES[1])));
    let factor = (MAX_PIXELS as f64 / (size[0] * size[1])).sqrt().min(1.0);
    size.map(|side| ((side * factor) as u32).max(SIDES[0]))
}

impl Client {
    pub fn new(
        (id, outbox, events): (u64, Arc<Outbox>, Sender<SessionEvent>),
        (setup, device, admission): (Setup, &Device, &Admission),
        (pool, films): (Arc<ThreadPool>, Films),
        (size, view): ([u32; 2], Option<serde_json::Value>),
    ) -> Result<Self> {
        let wake = events.clone();
        // The receiver is gone when the server ends.
        let wake = Arc::new(move || drop(wake.send(SessionEvent::Wake(id))));
        // The first viewer waits for changes of files, for all. A browser sees no files outside its folder.
        let setup = Setup {
            scenes: Vec::new(),
            cameras: None,
            photographs: None,
            searches_photographs: false,
            watches_files: false,
            ..setup
        };
        let greeting = welcome(device, &setup.bindings, admission.folder.is_some());
        outbox.text(greeting.text());
        let (now, input, picture) = (Instant::now(), Vec::new(), None);
        Ok(Self {
            id,
            offscreen: Offscreen::bare(setup, device, allowed(size), wake)?,
            outbox,
            events,
            link: Link::default(),
            pool,
            input,
            answered: 0,
            newest: Arc::default(),
            shown: 0,
            picture,
            is_exact: false,
            changed: now,
            drawn: now,
            due: None,
            news: News::default(),
            films,
            film: None,
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

    /// Frees the memory of a lost device, before it is opened again.
    pub fn close(&mut self) {
        self.offscreen.session.close();
    }

    /// Draws on the device that is opened again. What fails ends the connection.
    ///
    /// # Errors
    /// [`DeviceLost`].
    pub fn reopen(&mut self, device: &Device) -> Result<()> {
        let reopened = self.offscreen.reopen(device);
        self.end_unless_lost(reopened)
    }

    /// Ends the connection after a failure.
    ///
    /// # Errors
    /// [`DeviceLost`].
    fn end_unless_lost(&mut self, outcome: Result<()>) -> Result<()> {
        match outcome {
            Err(problem) if !problem.is::<DeviceLost>() => {
                self.outbox.end(format!("{problem:#}"));
                self.due = None;
                Ok(())
            }
            outcome => outcome,
        }
    }

    /// Shows what the first viewer of the server has read again, and what it has said since a time.
    pub fn follow(&mut self, first: &Offscreen, since: Instant) {
        self.offscreen.follow(first, since);
        self.wake();
    }

    /// Says why something is not done.
    pub fn refuse(&self, why: String) {
        self.outbox.text(ServerMessage::refused(why).text());
    }

    pub fn wake(&mut self) {
        let now = Instant::now();
        self.due = Some(self.due.map_or(now, |due| due.min(now)));
    }

    /// Sends a state of the first viewer, unless it is that of the last time.
    pub fn send_state(&mut self, state: State) {
        if let (Some(text), _) = self.news.of_state(&state) {
            self.outbox.state(text);
        }
    }

    /// Does what a message asks for.
    pub fn say(&mut self, said: Said) {
        if let Some(early) = &mut self.early {
            if early.len() < MAX_EARLY {
                early.push(said);
            }
            return;
        }
        let Said { at, message, file } = said;
        if let ClientMessage::Shown { picture } = message {
            return self.confirm(picture, at);
        }
        if let ClientMessage::Input { number, .. } = message {
            self.answered = number;
        }
        let done = match message {
            ClientMessage::Resize { size } => match self.offscreen.resize(allowed(size)) {
                Ok(()) => Ok(Vec::new()),
                Err(problem) => Err(format!("{problem:#}")),
            },
            ClientMessage::Open { .. } => self.open(file).map(|()| Vec::new()),
            ClientMessage::Film { file: Some(_), .. } => Err("films of a server have no file name".to_owned()),
            ClientMessage::Film { fps, file: None } => self.write_film(fps).map(|()| Vec::new()),
            ClientMessage::Rest { number } => self.news.await_rest(number).map(|()| Vec::new()),
            message => drive(&mut self.offscreen.session, message),
        };
        match done {
            Ok(events) if self.input.len() + events.len() > MAX_INPUT => {
                self.outbox.end("the client shows no pictures, and sends input".to_owned());
            }
            Ok(events) => self.input.extend(events),
            Err(why) => self.refuse(why),
        }
        self.wake();
    }

    /// A picture is shown: a frame that is due may be drawn. It makes none due.
    fn confirm(&mut self, picture: u32, at: Instant) {
        self.shown = self.shown.max(picture.min(self.newest.load(Ordering::Relaxed)));
        if let Some(sent) = self.outbox.sent_at(picture) {
            self.link.shown(sent, at);
        }
    }

    /// Opens a file in addition to the open ones, one after another.
    fn open(&mut self, file: Option<PathBuf>) -> Result<(), String> {
        let viewer = self.offscreen.viewer();
        if viewer.scenes.are_loading() || viewer.comparison.requests_under_way > 0 {
            return Err("a file is being read, or a picture drawn: ask again when that is done".to_owned());
        }
        if viewer.scenes.layers.len() >= MAX_SCENES {
            return Err(format!("{MAX_SCENES} scenes are open: close one first"));
        }
        file.iter().for_each(|file| viewer.drop_file(file));
        Ok(())
    }

    /// Starts to write the camera path as a video.
    fn write_film(&mut self, fps: f64) -> Result<(), String> {
        check_fps(fps)?;
        let viewer = self.offscreen.viewer();
        let frames = viewer.film.timeline.frames(fps).len();
        if !(2..=MAX_FRAMES).contains(&frames) {
            return Err(format!("this film has {frames} frames: a film has 2 to {MAX_FRAMES}"));
        }
        let film = Film::new(&self.films).map_err(|problem| format!("{problem:#}"))?;
        viewer.film.fps = fps;
        viewer.requests.push(Request::WriteFilm(Some(film.file().to_owned())));
        self.film = Some(film);
        Ok(())
    }

    /// True while a film of this client is being written.
    pub fn is_filming(&self) -> bool {
        self.film.as_ref().is_some_and(|film| !film.is_written)
    }

    /// Ends what runs for a client that has left.
    pub fn leave(&mut self) {
        self.offscreen.viewer().export.cancel.cancel();
        self.offscreen.viewer().measuring.running.iter().for_each(|running| running.cancel.cancel());
    }

    /// True while options are being chosen.
    pub fn is_choosing(&self) -> bool {
        self.offscreen.session.viewer.measuring.choosing().is_some()
    }

    /// True while the float64 reference is drawn or a picture is read, also if it will not be shown.
    pub fn is_comparing(&self) -> bool {
        self.offscreen.session.viewer.comparison.requests_under_way > 0
    }

    /// True while a job of the viewer runs.
    pub fn has_jobs(&self) -> bool {
        self.offscreen.session.viewer.jobs.are_running()
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
        let outcome = self.advance();
        self.end_unless_lost(outcome)
    }

    fn advance(&mut self) -> Result<()> {
        self.drawn = Instant::now();
        let before = self.offscreen.viewer().timing.pace.shown;
        let input = std::mem::take(&mut self.input);
        let FrameOutput { platform, repaint_delay, .. } = self.offscreen.frame(input)?;
        // The values of a picture are read back in the frame after it.
        let has_news = self.offscreen.session.retire_frames(true)?;
        let now = Instant::now();
        let is_shown = self.offscreen.viewer().timing.pace.shown > before;
        // The screen is black while no scene is shown, but also before a picture is built, which is not sent.
        let session = &self.offscreen.session;
        let is_picture = session.pair.first.is_some() || self.picture.is_some() && session.draws_nothing();
        if is_shown && is_picture {
            let (size, rgba) = (self.offscreen.size(), self.offscreen.screen()?);
            if self.picture.as_ref().is_none_or(|last| last.size != size || last.rgba != rgba) {
                self.send_compressed(Arc::new(ShownPicture { size, rgba }));
                self.changed = now;
            }
        }
        let is_at_rest = self.offscreen.session.is_at_rest();
        let exact_at = (is_at_rest && !self.is_exact && self.picture.is_some()).then_some(self.changed + REST);
        if exact_at.is_some_and(|at| at <= now) {
            self.send_exact();
        }
        let Told { texts, state, next } = self.news.of(&mut self.offscreen.session, platform.is_none());
        texts.into_iter().for_each(|text| self.outbox.text(text));
        state.into_iter().for_each(|text| self.outbox.state(text));
        self.send_film();
        let waits = [
            has_news.then_some(now),
            (repaint_delay < Duration::from_secs(3600)).then(|| now + repaint_delay),
            exact_at.filter(|_| !self.is_exact),
            next,
        ];
        self.due = waits.into_iter().flatten().min();
        Ok(())
    }

    /// Sends the address of a film that is written. What went wrong otherwise is a message of the viewer.
    fn send_film(&mut self) {
        let viewer = &self.offscreen.session.viewer;
        if viewer.export.progress.is_some() || !viewer.requests.is_empty() {
            return;
        }
        if let Some(file) = self.film.as_mut().filter(|film| !film.is_written).and_then(Film::publish) {
            self.outbox.text(ServerMessage::Film { file }.text());
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
        self.pool.spawn(move || {
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
                outbox.text(ServerMessage::Loss { picture: number, psnr }.text());
            }
        });
    }

    /// Sends the newest picture without loss. The next one does not wait until it is shown.
    fn send_exact(&mut self) {
        let Some(picture) = self.picture.clone() else { return };
        let number = self.newest.fetch_add(1, Ordering::Relaxed) + 1;
        (self.is_exact, self.shown) = (true, number);
        let (outbox, answered) = (self.outbox.clone(), self.answered);
        let is_of_render = is_of_render(&self.offscreen.session);
        self.pool.spawn(move || match picture.png() {
            Ok(file) => outbox.exact(Exact::new([number, answered], picture.size, file, is_of_render)),
            Err(problem) => outbox.end(format!("{problem:#}")),
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pictures_have_a_bounded_size() {
        assert_eq!(allowed([1920, 1080]), [1920, 1080]);
        assert_eq!(allowed([5120, 2880]), [4047, 2276]);
        assert_eq!(allowed([0, 0]), [16, 16]);
        for wanted in [[u32::MAX; 2], [u32::MAX, 1], [1, u32::MAX], [5000, 5000]] {
            let size = allowed(wanted);
            assert!(size.map(u64::from).iter().product::<u64>() <= MAX_PIXELS, "{wanted:?}: {size:?}");
        }
    }
}
