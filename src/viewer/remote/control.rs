//! The control of a window by a program of the same machine: messages as lines of JSON on a local socket.

use std::fs::{self, Permissions};
use std::io::{BufRead, BufReader, ErrorKind, Read, Write};
use std::os::unix::fs::{FileTypeExt, PermissionsExt};
use std::os::unix::net::{UnixListener, UnixStream};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::mpsc::{Receiver, SyncSender, TrySendError, sync_channel};
use std::time::Instant;

use anyhow::{Context, Result, bail, ensure};
use egui::Event;

use super::drive::drive;
use super::messages::{ClientMessage, ServerMessage};
use super::news::{News, Told};
use super::state::welcome;
use crate::threads;
use crate::viewer::frame::Session;
use crate::viewer::model::Request;

/// Most bytes of a line.
const LINE: u64 = 1 << 20;

/// Most lines that wait to be read by a program, and by the window.
const LINES_OUT: usize = 1024;
const LINES_IN: usize = 64;

/// A socket on which one program at a time controls a viewer.
pub struct Control {
    path: PathBuf,
    heard: Receiver<Heard>,
    program: Option<Program>,
    /// A message that waits until the picture is at rest.
    held: Option<ClientMessage>,
    /// Something was changed since the last frame.
    has_input: bool,
}

/// What the thread of the socket hears.
enum Heard {
    /// A program has connected; it takes these lines.
    Came(SyncSender<String>),
    Said(String),
    Left,
}

/// A connected program.
struct Program {
    lines: SyncSender<String>,
    news: News,
}

impl Control {
    /// Listens on a socket of this path, which only the user of this process can open. `wake` is called, from another
    /// thread, when a program has said something.
    ///
    /// # Errors
    /// The path is taken by something else than a socket without a listener, or no socket can be there.
    pub fn listen(path: &Path, wake: Arc<dyn Fn() + Send + Sync>) -> Result<Self> {
        let named = || format!("cannot listen on {}", path.display());
        if let Ok(there) = path.symlink_metadata() {
            let refuses = || UnixStream::connect(path).is_err_and(|why| why.kind() == ErrorKind::ConnectionRefused);
            ensure!(there.file_type().is_socket() && refuses(), "{}: there is such a file already", named());
            // The process that listened here has ended.
            fs::remove_file(path).with_context(named)?;
        }
        let listener = UnixListener::bind(path).with_context(named)?;
        fs::set_permissions(path, Permissions::from_mode(0o600)).with_context(named)?;
        let (said, heard) = sync_channel(LINES_IN);
        // The thread ends when the control is dropped, or with the process.
        threads::spawn(move || {
            let tell = |heard| {
                let is_told = said.send(heard).is_ok();
                wake();
                is_told
            };
            for stream in listener.incoming().flatten() {
                let served = serve(stream, &tell);
                if served.is_err() || !tell(Heard::Left) {
                    return;
                }
            }
        })?;
        Ok(Self { path: path.to_owned(), heard, program: None, held: None, has_input: false })
    }

    /// Does what the program has said. Returns the events for the next frame.
    pub fn hear(&mut self, session: &mut Session) -> Vec<Event> {
        let mut events = Vec::new();
        loop {
            if let Some(message) = self.held.take() {
                // A picture is that of all messages before it, and one after another.
                if self.has_input || !session.is_settled() {
                    self.held = Some(message);
                    break;
                }
                self.answer(session, message, &mut events);
            }
            match self.heard.try_recv() {
                Ok(Heard::Came(lines)) => {
                    let mut program = Program { lines, news: News::default() };
                    let bindings = &session.viewer.setup.bindings;
                    program.tell(welcome(session.screen.device(), bindings, true).text());
                    self.program = Some(program);
                }
                Ok(Heard::Left) => self.program = None,
                Ok(Heard::Said(line)) => match ClientMessage::parse(&line) {
                    Ok(message @ ClientMessage::Picture { .. }) => self.held = Some(message),
                    Ok(message) => self.answer(session, message, &mut events),
                    Err(why) => self.tell(ServerMessage::Refused { why }.text()),
                },
                Err(_) => break,
            }
        }
        self.has_input |= !events.is_empty();
        events
    }

    fn answer(&mut self, session: &mut Session, message: ClientMessage, events: &mut Vec<Event>) {
        self.has_input = true;
        let done = match message {
            ClientMessage::Ping { time } => {
                self.tell(ServerMessage::Pong { time }.text());
                Ok(())
            }
            ClientMessage::Rest { number } => self.program.as_mut().map_or(Ok(()), |it| it.news.await_rest(number)),
            ClientMessage::Open { file } => {
                session.viewer.drop_file(Path::new(&file));
                Ok(())
            }
            ClientMessage::Picture { file } => {
                session.viewer.requests.push(Request::WritePicture(Some(file)));
                Ok(())
            }
            message => drive(session, message).map(|driven| events.extend(driven)),
        };
        if let Err(why) = done {
            self.tell(ServerMessage::Refused { why }.text());
        }
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
        let Told { texts, state, next } = self.program.as_mut()?.news.of(session, self.has_input);
        texts.into_iter().chain(state).for_each(|line| self.tell(line));
        if self.held.is_some() && session.is_settled() { Some(Instant::now()) } else { next }
    }
}

impl Drop for Control {
    fn drop(&mut self) {
        _ = fs::remove_file(&self.path);
    }
}

impl Program {
    /// False if the program is gone, or reads nothing.
    fn tell(&mut self, line: String) -> bool {
        !matches!(self.lines.try_send(line), Err(TrySendError::Disconnected(_) | TrySendError::Full(_)))
    }
}

/// Passes the lines of a program on until it leaves.
///
/// # Errors
/// The control is dropped.
fn serve(stream: UnixStream, tell: &dyn Fn(Heard) -> bool) -> Result<()> {
    let (lines, waiting) = sync_channel::<String>(LINES_OUT);
    let Ok(mut out) = stream.try_clone() else { return Ok(()) };
    let writer = threads::spawn(move || {
        for line in waiting {
            if out.write_all(line.as_bytes()).and_then(|()| out.write_all(b"\n")).is_err() {
                break;
            }
        }
        // A program that is given up is told so.
        _ = out.shutdown(std::net::Shutdown::Both);
    })?;
    if !tell(Heard::Came(lines)) {
        bail!("the control is dropped");
    }
    let mut reader = BufReader::new(stream);
    loop {
        let mut line = Vec::new();
        let read = reader.by_ref().take(LINE).read_until(b'\n', &mut line);
        if !matches!(read, Ok(1..)) || line.pop() != Some(b'\n') {
            break;
        }
        if !tell(Heard::Said(String::from_utf8_lossy(&line).into_owned())) {
            bail!("the control is dropped");
        }
    }
    drop(writer);
    Ok(())
}
