//! The thread with the device: all viewers, drawn in turn.

use std::sync::Arc;
use std::thread;
use std::time::{Duration, Instant};

use anyhow::{Error, Result};
use crossbeam_channel::{Receiver, RecvTimeoutError, Sender};
use rayon::ThreadPool;

use super::admission::Admission;
use super::client::Client;
use super::films::Films;
use super::session_event::SessionEvent;
use crate::gpu::{Device, DeviceLost, Unavailable};
use crate::threads;
use crate::viewer::remote::{ClientMessage, state};
use crate::viewer::{Fault, Offscreen, Setup};

/// The number of the first viewer; those of clients begin at 1.
const FIRST: u64 = 0;

/// The size of the first viewer, which reads the scenes for all and is seen by none.
const FIRST_SIZE: [u32; 2] = [64, 64];

/// Interval of frames of the first viewer while it reads scenes.
const READING: Duration = Duration::from_millis(20);

/// Interval at which the jobs of clients that have left are looked at.
const LEAVING: Duration = Duration::from_millis(200);

/// Losses of the device within this time after which the next one ends the server, and the pause before the device is
/// opened another time.
const MAX_LOSSES: usize = 3;
const LOSS_TIME: Duration = Duration::from_secs(600);
const LOSS_PAUSE: Duration = Duration::from_secs(1);

/// All viewers of a server.
pub struct Sessions<'r> {
    device: Device,
    setup: Setup,
    admission: Admission,
    sender: Sender<SessionEvent>,
    films: Films,
    /// Compresses pictures. A float64 reference, which takes all threads of the shared pool, does not hold them up.
    pool: Arc<ThreadPool>,
    first: Offscreen,
    /// The first viewer has read the scenes at least once.
    is_read: bool,
    /// When the first viewer draws its next frame; `None` if it waits for something to happen.
    reads_at: Option<Instant>,
    /// When clients last showed what the first viewer had read.
    followed: Instant,
    clients: Vec<Client>,
    /// Clients that have left, and whose jobs still run.
    leaving: Vec<Client>,
    reopening: Reopening<'r>,
    /// When the device was lost lately.
    losses: Vec<Instant>,
    /// What clients are told of the last loss. They wait until the first viewer has its scenes on the device again.
    loss: Option<String>,
    /// Frames of clients.
    frames: u64,
}

/// What a server does without its device.
pub struct Reopening<'r> {
    /// Opens the device again; it is given the lost one.
    pub open: &'r dyn Fn(&Device) -> Result<Device>,
    /// A loss to simulate, for tests.
    pub fault: Option<Fault>,
}

impl<'r> Sessions<'r> {
    /// The viewers of a server. The first one begins to read the scenes of the setup.
    ///
    /// # Errors
    /// If device memory runs out.
    pub fn new(
        (device, reopening): (Device, Reopening<'r>),
        setup: Setup,
        admission: Admission,
        (sender, films): (Sender<SessionEvent>, Films),
    ) -> Result<Self> {
        let wake = sender.clone();
        let wake = Arc::new(move || drop(wake.send(SessionEvent::Wake(FIRST))));
        let first = Offscreen::bare(setup.clone(), &device, FIRST_SIZE, wake)?;
        let pool = Arc::new(threads::pool(rayon::current_num_threads())?);
        Ok(Self {
            device,
            setup,
            admission,
            sender,
            films,
            pool,
            first,
            is_read: false,
            reads_at: Some(Instant::now()),
            followed: Instant::now(),
            clients: Vec::new(),
            leaving: Vec::new(),
            reopening,
            losses: Vec::new(),
            loss: None,
            frames: 0,
        })
    }

    /// Draws until the device is lost too often, or the scenes turn out to be unreadable.
    ///
    /// # Errors
    /// These two; or a lost device cannot be opened again.
    pub fn run(&mut self, events: &Receiver<SessionEvent>) -> Result<()> {
        loop {
            match self.turn(events) {
                Ok(true) => {}
                Ok(false) => return Ok(()),
                Err(failure) => self.survive(failure)?,
            }
        }
    }

    /// Goes on after a loss of the device, and returns other failures.
    fn survive(&mut self, mut failure: Error) -> Result<()> {
        let mut is_opening = false;
        // A driver may refuse a device for a moment after a loss.
        while failure.is::<DeviceLost>() || is_opening && failure.is::<Unavailable>() {
            let now = Instant::now();
            self.losses.retain(|loss| now - *loss < LOSS_TIME);
            if self.losses.len() >= MAX_LOSSES {
                break;
            }
            self.losses.push(now);
            match self.recover(&failure) {
                Ok(()) => return Ok(()),
                Err(next) => failure = next,
            }
            is_opening = true;
            thread::sleep(LOSS_PAUSE);
        }
        Err(failure)
    }

    /// Waits until something is due, and does that. False once nothing can happen any more.
    fn turn(&mut self, events: &Receiver<SessionEvent>) -> Result<bool> {
        self.leaving.retain(Client::has_jobs);
        let leaves = (!self.leaving.is_empty()).then(|| Instant::now() + LEAVING);
        let clients = self.clients.iter().filter(|_| self.loss.is_none()).filter_map(Client::due);
        let event = match clients.chain(self.reads_at).chain(leaves).min() {
            None => events.recv().map_err(|_| RecvTimeoutError::Disconnected),
            Some(due) => events.recv_deadline(due),
        };
        match event {
            Ok(event) => {
                self.handle(event)?;
                events.try_iter().try_for_each(|event| self.handle(event))?;
            }
            Err(RecvTimeoutError::Timeout) => {}
            Err(RecvTimeoutError::Disconnected) => return Ok(false),
        }
        let now = Instant::now();
        if self.reads_at.is_some_and(|due| due <= now) {
            self.read()?;
        }
        if self.loss.is_some() {
            return Ok(true);
        }
        for client in &mut self.clients {
            if client.due().is_some_and(|due| due <= now) {
                self.frames += 1;
                if self.reopening.fault.is_some_and(|fault| fault.is_loss_in(self.frames)) {
                    return Err(DeviceLost("the GPU was lost (injected by SMALTO_FAULT)".to_owned()).into());
                }
                client.step()?;
            }
        }
        // Each round begins with another one, so that none waits for the others again and again.
        if !self.clients.is_empty() {
            self.clients.rotate_left(1);
        }
        Ok(true)
    }

    /// Opens the lost device again. Clients go on once the first viewer has its scenes there.
    fn recover(&mut self, failure: &Error) -> Result<()> {
        if self.loss.is_none() {
            let told = format!("{failure:#}; the device is opened again");
            self.first.viewer().messages.error(told.clone());
            self.loss = Some(told);
        }
        // Their memory would count against the limit of the device that is opened.
        self.first.session.close();
        self.clients.iter_mut().chain(&mut self.leaving).for_each(Client::close);
        self.device = (self.reopening.open)(&self.device)?;
        self.first.reopen(&self.device)?;
        self.clients.iter_mut().try_for_each(|client| client.reopen(&self.device))?;
        self.reads_at = Some(Instant::now());
        Ok(())
    }

    /// A frame of the first viewer. Clients join once it has read the scenes, and follow it when it reads them again.
    fn read(&mut self) -> Result<()> {
        self.first.frame(Vec::new())?;
        self.first.session.retire_frames(true)?;
        let is_settled = self.first.session.is_settled();
        self.reads_at = (!is_settled).then(|| Instant::now() + READING);
        // Clients are told why a scene cannot be read or drawn again.
        if let Some(failure) = self.first.viewer().messages.failure.take().filter(|_| !self.is_read) {
            return Err(failure);
        }
        let told = self.loss.take_if(|_| self.first.session.is_built());
        for client in &mut self.clients {
            match (client.has_joined(), is_settled || told.is_some() && self.is_read) {
                (true, true) => client.follow(&self.first, self.followed),
                (true, false) => {}
                (false, true) => client.join(&self.first),
                (false, false) => client.send_state(state(&mut self.first.session)),
            }
        }
        if let Some(told) = told {
            // Who connects later does not hear of it.
            self.first.viewer().messages.retract(&told);
            self.followed = Instant::now();
        }
        if is_settled {
            (self.is_read, self.followed) = (true, Instant::now());
        }
        Ok(())
    }

    fn handle(&mut self, event: SessionEvent) -> Result<()> {
        match event {
            SessionEvent::Joined { id, outbox, size, view } => {
                let connection = (id, outbox.clone(), self.sender.clone());
                let server = (self.setup.clone(), &self.device, &self.admission);
                let shared = (self.pool.clone(), self.films.clone());
                match Client::new(connection, server, shared, (size, view.clone())) {
                    Ok(mut client) => {
                        if self.is_read && self.loss.is_none() {
                            client.join(&self.first);
                        }
                        self.clients.push(client);
                    }
                    // The client is made on the device that is opened again.
                    Err(problem) if problem.is::<DeviceLost>() => {
                        _ = self.sender.send(SessionEvent::Joined { id, outbox, size, view });
                        return Err(problem);
                    }
                    Err(problem) => outbox.end(format!("{problem:#}")),
                }
            }
            SessionEvent::Said { id, said } => {
                if let Some(why) = self.busy(&said.message) {
                    self.clients
                        .iter()
                        .filter(|client| client.id == id)
                        .for_each(|client| client.refuse(why.to_owned()));
                } else if let Some(client) = self.client(id) {
                    client.say(said);
                }
            }
            SessionEvent::Left { id } => {
                let left = self.clients.extract_if(.., |client| client.id == id);
                self.leaving.extend(left.map(|mut client| {
                    client.leave();
                    client
                }));
            }
            SessionEvent::Compressed { id, pixels, bytes } => {
                if let Some(client) = self.client(id) {
                    client.compressed(pixels, bytes);
                }
            }
            SessionEvent::Wake(FIRST) => self.reads_at = Some(Instant::now()),
            SessionEvent::Wake(id) => {
                if let Some(client) = self.client(id) {
                    client.wake();
                }
            }
        }
        Ok(())
    }

    /// The reason why a message has to wait: references, films and choices of several clients would take turns on
    /// the same threads, also those of clients that have left.
    fn busy(&self, message: &ClientMessage) -> Option<&'static str> {
        let (is_busy, why): (fn(&Client) -> bool, _) = match message {
            ClientMessage::Compare { with } if with == "reference" => {
                (Client::is_comparing, "a float64 reference is being drawn: ask again when it is done")
            }
            ClientMessage::Film { .. } => (Client::is_filming, "a film is being written: ask again when it is done"),
            ClientMessage::Budget { .. } => (Client::is_choosing, "options are being chosen: ask again when they are"),
            _ => return None,
        };
        if !self.is_read {
            return Some("the scenes are being read: ask again when they are shown");
        }
        (!self.leaving.is_empty() || self.clients.iter().any(is_busy)).then_some(why)
    }

    fn client(&mut self, id: u64) -> Option<&mut Client> {
        self.clients.iter_mut().find(|client| client.id == id)
    }
}
