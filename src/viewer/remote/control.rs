//! The control of a window by a program of the same machine: messages as lines of JSON on a local socket.

use std::fs::{self, Permissions};
use std::io::{self, BufRead, BufReader, ErrorKind, Read, Write};
use std::net::Shutdown;
use std::os::unix::fs::{FileTypeExt, PermissionsExt};
use std::os::unix::net::{UnixListener, UnixStream};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::thread;
use std::time::{Duration, Instant};

use anyhow::{Result, anyhow, ensure};
use egui::Event;

use super::drive::{check_fps, drive};
use super::messages::{ClientMessage, ServerMessage};
use super::news::{News, Told};
use super::state::welcome;
use crate::files::describe;
use crate::threads;
use crate::viewer::frame::Session;
use crate::viewer::model::Request;

/// Most bytes of a line.
const LINE: u64 = 1 << 20;

/// Most lines that wait to be read by a program, and by the window.
const LINES_OUT: usize = 1024;
const LINES_IN: usize = 64;

/// Time in which a program takes a line, or else is given up.
const SEND_TIME: Duration = Duration::from_secs(20);

/// Time after a connection that could not be accepted.
const PAUSE: Duration = Duration::from_millis(100);

/// A socket on which one program at a time controls a viewer.
pub struct Control {
    path: PathBuf,
    heard: Receiver<Heard>,
    program: Option<Program>,
    /// What is to be written, once the picture is at rest.
    held: Option<Held>,
    /// A picture or a film is being written.
    is_writing: bool,
    /// What is being written is a film.
    is_filming: bool,
    /// Something was changed since the last frame.
    has_input: bool,
    /// More lines may wait; or they wait until the picture is at rest.
    has_more: bool,
    waits: bool,
}

/// Something to write.
enum Held {
    Picture(PathBuf),
    /// A film of this many frames a second.
    Film(f64, PathBuf),
}

/// What the thread of the socket hears.
enum Heard {
    /// A program has connected; it takes these lines.
    Came(UnixStream, SyncSender<String>),
    Said(String),
    /// The program says nothing more.
    Finished,
}

/// A connected program.
struct Program {
    stream: UnixStream,
    lines: SyncSender<String>,
    news: News,
    /// It says nothing more, and waits for answers.
    has_finished: bool,
}

impl Control {
    /// Listens on a socket of this path, which only the user of this process can open. `wake` is called, from another
    /// thread, when a program has said something.
    ///
    /// # Errors
    /// The path is taken by something else than a socket without a listener, or no socket can be there.
    pub fn listen(path: &Path, wake: Arc<dyn Fn() + Send + Sync>) -> Result<Self> {
        let named = || format!("cannot listen on {}", path.display());
        let failed = |problem: io::Error| anyhow!("{}: {}", named(), describe(&problem));
        if let Ok(there) = path.symlink_metadata() {
            let refuses = || UnixStream::connect(path).is_err_and(|why| why.kind() == ErrorKind::ConnectionRefused);
            ensure!(there.file_type().is_socket() && refuses(), "{}: there is such a file already", named());
            // The process that listened here has ended.
            fs::remove_file(path).map_err(failed)?;
        }
        let listener = UnixListener::bind(path).map_err(failed)?;
        fs::set_permissions(path, Permissions::from_mode(0o600)).map_err(failed)?;
        let (said, heard) = sync_channel(LINES_IN);
        // The thread ends when the control is dropped, or with the process.
        threads::spawn(move || {
            let tell = |heard| {
                let is_told = said.send(heard).is_ok();
                wake();
                is_told
            };
            for stream in listener.incoming() {
                let Ok(stream) = stream else {
                    // The process has too many files open, perhaps for long.
                    thread::sleep(PAUSE);
                    continue;
                };
                if serve(stream, &tell).is_err() {
                    return;
                }
            }
        })?;
        let path = path.to_owned();
        Ok(Self {
            path,
            heard,
            program: None,
            held: None,
            is_writing: false,
            is_filming: false,
            has_input: false,
            has_more: false,
            waits: false,
        })
    }

    /// Does what the program has said. Returns the events for the next frame.
    pub fn hear(&mut self, session: &mut Session) -> Vec<Event> {
        self.hear_while(session, true)
    }

    /// Refuses what the program has said to a window without pixels.
    pub fn refuse(&mut self, session: &mut Session) {
        self.hear_while(session, false);
    }

    fn hear_while(&mut self, session: &mut Session, is_visible: bool) -> Vec<Event> {
        let mut events = Vec::new();
        (self.has_more, self.waits) = (false, false);
        // A program that says much does not keep the window from drawing.
        for _ in 0..LINES_IN {
            // A picture is that of all messages before it, and of none after it.
            let is_request = |request: &_| matches!(request, Request::WritePicture(_) | Request::WriteFilm(_));
            let is_requested = session.viewer.requests.iter().any(is_request);
            if is_requested || self.held.is_some() && (self.has_input || !session.is_settled()) {
                self.waits = true;
                return events;
            }
            if let Some(held) = self.held.take() {
                session.viewer.export.failure = None;
                self.is_filming = matches!(held, Held::Film(..));
                session.viewer.requests.push(match held {
                    Held::Picture(file) => Request::WritePicture(Some(file)),
                    Held::Film(fps, file) => {
                        session.viewer.film.fps = fps;
                        Request::WriteFilm(Some(file))
                    }
                });
                (self.is_writing, self.has_input, self.waits) = (true, true, true);
                return events;
            }
            let line = match self.heard.try_recv() {
                Ok(Heard::Came(stream, lines)) => {
                    let mut program = Program { stream, lines, news: News::default(), has_finished: false };
                    program.tell(welcome(session.screen.device(), &session.viewer.setup.bindings, false).text());
                    self.program = Some(program);
                    continue;
                }
                Ok(Heard::Finished) => {
                    self.program.iter_mut().for_each(|program| program.has_finished = true);
                    continue;
                }
                Ok(Heard::Said(line)) => line,
                Err(_) => return events,
            };
            let message = ClientMessage::parse(&line);
            let number = match &message {
                Ok(ClientMessage::Rest { number }) => Some(*number),
                _ => None,
            };
            let done = match message {
                Ok(ClientMessage::Ping { time }) => {
                    self.tell(ServerMessage::Pong { time }.text());
                    Ok(())
                }
                Ok(ClientMessage::StopFilm) if self.is_filming => {
                    session.viewer.export.cancel.cancel();
                    Ok(())
                }
                // The user may be writing a film.
                Ok(ClientMessage::StopFilm) => Err("no film of this program is being written".to_owned()),
                Ok(_) if !is_visible => Err("the window has no pixels now: it is minimized".to_owned()),
                Ok(message) => self.take(session, message).map(|taken| events.extend(taken)),
                Err(why) => Err(why),
            };
            if let Err(why) = done {
                self.tell(ServerMessage::Refused { why, number }.text());
            }
        }
        self.has_more = true;
        events
    }

    /// Does what a message asks for. Returns the events for the next frame.
    fn take(&mut self, session: &mut Session, message: ClientMessage) -> Result<Vec<Event>, String> {
        self.has_input = true;
        match message {
            ClientMessage::Rest { number } => {
                self.program.as_mut().map_or(Ok(()), |program| program.news.await_rest(number))?;
            }
            ClientMessage::Open { file } if !Path::new(&file).exists() => return Err(format!("there is no {file}")),
            ClientMessage::Open { file } => session.viewer.drop_file(Path::new(&file)),
            ClientMessage::Picture { file } => self.held = Some(Held::Picture(file)),
            ClientMessage::Film { file: None, .. } => return Err("a film of a window needs a file name".to_owned()),
            ClientMessage::Film { fps, file: Some(file) } => {
                check_fps(fps)?;
                self.held = Some(Held::Film(fps, file));
            }
            message => return drive(session, message),
        }
        Ok(Vec::new())
    }

    fn tell(&mut self, line: String) {
        if self.program.as_mut().is_some_and(|program| !program.tell(line)) {
            self.program = None;
        }
    }

    /// Tells the program what has changed. `is_handled` is true after a frame that has handled the events. Returns when
    /// another frame is needed.
    pub fn tell_news(&mut self, session: &mut Session, is_handled: bool) -> Option<Instant> {
        self.has_input &= !is_handled;
        let is_settled = !self.has_input && session.is_settled();
        if self.is_writing && is_settled {
            (self.is_writing, self.is_filming) = (false, false);
            if let Some(why) = session.viewer.export.failure.take() {
                self.tell(ServerMessage::refused(why).text());
            }
        }
        let mut next = None;
        if let Some(program) = &mut self.program {
            // A request for rest after a picture waits for the file.
            let has_input = self.has_input || self.held.is_some();
            let Told { texts, state, next: later } = program.news.of(session, has_input);
            next = later;
            texts.into_iter().chain(state).for_each(|line| self.tell(line));
        }
        let waits = |program: &mut Program| program.news.awaits_rest() || self.held.is_some() || self.is_writing;
        if self.program.as_mut().is_some_and(|program| program.has_finished && !waits(program)) {
            self.program = None;
        }
        if self.has_more || self.waits && is_settled { Some(Instant::now()) } else { next }
    }
}

impl Drop for Control {
    fn drop(&mut self) {
        _ = fs::remove_file(&self.path);
    }
}

impl Drop for Program {
    /// Ends the connection once all that was told is written, or at once for a program that reads nothing.
    fn drop(&mut self) {
        let way = if self.has_finished { Shutdown::Read } else { Shutdown::Both };
        _ = self.stream.shutdown(way);
    }
}

impl Program {
    /// False if the program is gone, or reads nothing.
    fn tell(&mut self, line: String) -> bool {
        self.lines.try_send(line).is_ok()
    }
}

/// Passes the lines of a program on, until it says nothing more and is told nothing more.
///
/// # Errors
/// The control is dropped.
fn serve(stream: UnixStream, tell: &dyn Fn(Heard) -> bool) -> Result<()> {
    let (lines, waiting) = sync_channel::<String>(LINES_OUT);
    let (Ok(mut out), Ok(own)) = (stream.try_clone(), stream.try_clone()) else { return Ok(()) };
    // Refused only for a time of zero.
    _ = stream.set_write_timeout(Some(SEND_TIME));
    let writer = threads::spawn(move || {
        for line in waiting {
            if out.write_all(line.as_bytes()).and_then(|()| out.write_all(b"\n")).is_err() {
                break;
            }
        }
        _ = out.shutdown(Shutdown::Both);
    })?;
    ensure!(tell(Heard::Came(own, lines)), "the control is dropped");
    let mut reader = BufReader::new(stream);
    loop {
        let mut line = Vec::new();
        let read = reader.by_ref().take(LINE).read_until(b'\n', &mut line);
        let is_whole = line.last() == Some(&b'\n');
        if !matches!(read, Ok(1..)) || !is_whole && line.len() as u64 == LINE {
            break;
        }
        ensure!(tell(Heard::Said(String::from_utf8_lossy(&line).into_owned())), "the control is dropped");
    }
    ensure!(tell(Heard::Finished), "the control is dropped");
    // The next program connects when this one has all answers.
    _ = writer.join();
    Ok(())
}
