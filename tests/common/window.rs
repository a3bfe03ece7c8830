//! The viewer in a window of a test's desktop: its events, its CPU time, its memory.

use std::collections::HashMap;
use std::fs;
use std::io::{BufRead, BufReader, Read};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::sync::mpsc::{Receiver, TryRecvError, channel};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use serde_json::Value;

use super::desktop::{CONTROL, Desktop, PATIENCE, Shot};

/// A window with the focus answers a key within this time.
const ANSWER: Duration = Duration::from_secs(8);

/// The program, and its window.
pub struct Viewer<'a> {
    pub desktop: &'a Desktop,
    pub window: u32,
    child: Child,
    events: Receiver<Value>,
    seen: Vec<Value>,
    /// For every kind of event, how many entries of `seen` are searched already.
    read: HashMap<String, usize>,
    errors: Option<JoinHandle<String>>,
    /// An empty folder for the user's settings.
    _settings: tempfile::TempDir,
}

/// `smalto view`, on the software device unless another is chosen, with every check.
pub fn view(arguments: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_smalto"));
    command.arg("view").args(arguments).env("SMALTO_VALIDATION", "1").env_remove("WAYLAND_DISPLAY");
    command.env("XDG_CACHE_HOME", env!("CARGO_TARGET_TMPDIR"));
    if std::env::var_os("SMALTO_DEVICE").is_none() {
        command.env("SMALTO_DEVICE", "llvmpipe");
    }
    command
}

/// The numbers of an array.
pub fn numbers(value: &Value) -> Vec<f64> {
    let flat = |value: &Value| match value {
        Value::Array(inner) => inner.iter().map(|v| v.as_f64().unwrap()).collect(),
        one => vec![one.as_f64().unwrap()],
    };
    value.as_array().expect("an array of numbers").iter().flat_map(flat).collect()
}

/// The largest difference between numbers.
pub fn apart(a: &Value, b: &Value) -> f64 {
    numbers(a).iter().zip(numbers(b)).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
}

impl<'a> Viewer<'a> {
    pub fn open(desktop: &'a Desktop, arguments: &[&str], prepare: impl FnOnce(&mut Command)) -> Self {
        let settings = tempfile::tempdir().unwrap();
        let mut command = view(arguments);
        command.arg("--events").env("DISPLAY", &desktop.name).env("XDG_CONFIG_HOME", settings.path());
        command.env("XDG_STATE_HOME", settings.path());
        prepare(&mut command);
        let mut child = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().expect("the program starts");
        let (sender, events) = channel();
        let lines = BufReader::new(child.stdout.take().unwrap()).lines();
        std::thread::spawn(move || {
            for line in lines.map_while(Result::ok) {
                let event = serde_json::from_str(&line).unwrap_or_else(|e| panic!("{line:?} is no event: {e}"));
                let _ = sender.send(event);
            }
        });
        let mut stderr = child.stderr.take().unwrap();
        let errors = std::thread::spawn(move || {
            let mut text = Vec::new();
            let _ = stderr.read_to_end(&mut text);
            String::from_utf8_lossy(&text).into_owned()
        });
        let (seen, read, errors) = (Vec::new(), HashMap::new(), Some(errors));
        let mut viewer = Self { desktop, window: 0, child, events, seen, read, errors, _settings: settings };
        viewer.next("open");
        viewer.window = desktop.window_of(viewer.child.id());
        viewer
    }

    /// Waits for the next event of a kind.
    pub fn next(&mut self, kind: &str) -> Value {
        let begun = Instant::now();
        loop {
            let mut newest = self.events.try_recv();
            while let Ok(event) = newest {
                self.seen.push(event);
                newest = self.events.try_recv();
            }
            let first = self.read.get(kind).copied().unwrap_or(0);
            let place = self.seen[first..].iter().position(|event| event["event"] == kind);
            if let Some(place) = place {
                self.read.insert(kind.to_owned(), first + place + 1);
                return self.seen[first + place].clone();
            }
            assert!(newest != Err(TryRecvError::Disconnected), "it ended before it told {kind}");
            assert!(begun.elapsed() < PATIENCE, "it never told {kind}");
            std::thread::sleep(Duration::from_millis(5));
        }
    }

    /// Waits for a message that says this.
    pub fn message(&mut self, part: &str) -> Value {
        loop {
            let message = self.next("message");
            if message["text"].as_str().unwrap().contains(part) {
                return message;
            }
        }
    }

    /// Waits for a window of this size.
    pub fn resized(&mut self, size: [u32; 2]) {
        while self.next("resized")["size"] != serde_json::json!(size) {}
    }

    /// Events of a kind, so far.
    pub fn count(&mut self, kind: &str) -> usize {
        self.seen.extend(self.events.try_iter());
        self.seen.iter().filter(|event| event["event"] == kind).count()
    }

    /// Nanoseconds that its threads have run, and true if one of them is running or ready.
    fn effort(&self) -> (u64, bool) {
        let (mut ran, mut is_busy) = (0, false);
        let tasks = fs::read_dir(format!("/proc/{}/task", self.child.id()));
        for task in tasks.into_iter().flatten().flatten() {
            let read = |name: &str| fs::read_to_string(task.path().join(name)).unwrap_or_default();
            ran += read("schedstat").split(' ').next().and_then(|text| text.parse::<u64>().ok()).unwrap_or(0);
            // The state follows the name in brackets.
            is_busy |= read("stat").rsplit(')').next().is_some_and(|rest| rest.trim_start().starts_with(['R', 'D']));
        }
        (ran, is_busy)
    }

    /// Seconds of CPU time so far.
    pub fn cpu_seconds(&self) -> f64 {
        self.effort().0 as f64 * 1e-9
    }

    /// Bytes of main memory that it has now.
    pub fn resident_bytes(&self) -> u64 {
        let status = fs::read_to_string(format!("/proc/{}/status", self.child.id())).unwrap();
        let line = status.lines().find_map(|line| line.strip_prefix("VmRSS:")).expect("it runs");
        line.trim().trim_end_matches(" kB").parse::<u64>().unwrap() * 1024
    }

    /// Waits until it has nothing more to do.
    pub fn settle(&self) {
        const QUIET: usize = 6;
        let (mut quiet, mut before) = (0, 0);
        self.desktop.until("it has nothing more to do", || {
            let (ran, is_busy) = self.effort();
            // Whatever wakes it without being a frame is less than half a millisecond.
            quiet = if is_busy || ran > before + 500_000 { 0 } else { quiet + 1 };
            before = ran;
            quiet == QUIET
        });
    }

    pub fn shot(&self) -> Shot {
        self.desktop.shot(self.window)
    }

    /// Presses a key and lets it go.
    pub fn press(&self, symbol: u32) {
        self.desktop.key(symbol, true);
        self.desktop.key(symbol, false);
        self.settle();
    }

    pub fn letter(&self, letter: char) {
        self.press(u32::from(letter));
    }

    pub fn with_control(&self, letter: char) {
        self.desktop.key(CONTROL, true);
        self.desktop.key(u32::from(letter), true);
        self.desktop.key(u32::from(letter), false);
        self.desktop.key(CONTROL, false);
    }

    pub fn point(&self, at: [i16; 2]) {
        self.desktop.point(self.window, at);
        self.settle();
    }

    /// Drags with a button, a frame or more at every step.
    pub fn drag(&self, button: u8, from: [i16; 2], to: [i16; 2]) {
        self.point(from);
        self.desktop.button(button, true);
        self.settle();
        for step in 1..=3 {
            self.point([0, 1].map(|i| from[i] + (to[i] - from[i]) * step / 3));
        }
        self.desktop.button(button, false);
        self.settle();
    }

    pub fn click(&self, button: u8) {
        self.desktop.button(button, true);
        self.desktop.button(button, false);
        self.settle();
    }

    /// The view, as Ctrl and C copy it. A window manager may not yet have given the keys to a window that it has just
    /// brought back: then it is asked again.
    pub fn view(&mut self) -> Value {
        self.with_control('c');
        for _ in 0..3 {
            let begun = Instant::now();
            while begun.elapsed() < ANSWER && !self.has_next("copied") {
                std::thread::sleep(Duration::from_millis(5));
            }
            if self.has_next("copied") {
                break;
            }
            self.with_control('c');
        }
        let mut view = self.next("copied")["view"].clone();
        self.settle();
        while self.has_next("copied") {
            view = self.next("copied")["view"].clone();
        }
        view
    }

    /// True if an event of a kind has come that `next` did not return yet.
    fn has_next(&mut self, kind: &str) -> bool {
        self.seen.extend(self.events.try_iter());
        let first = self.read.get(kind).copied().unwrap_or(0);
        self.seen[first..].iter().any(|event| event["event"] == kind)
    }

    /// Leaves by Ctrl and Q, and returns the event `closed`. Validation messages and panics fail the test.
    pub fn quit(mut self) -> Value {
        self.with_control('q');
        let closed = self.next("closed");
        let status = self.ended();
        let errors = self.errors.take().unwrap().join().unwrap();
        assert!(status.success() && !errors.contains("validation") && !errors.contains("panicked"), "{errors}");
        closed
    }

    fn ended(&mut self) -> ExitStatus {
        let mut status = None;
        self.desktop.until("it has ended", || {
            status = self.child.try_wait().unwrap();
            status.is_some()
        });
        status.unwrap()
    }
}

impl Drop for Viewer<'_> {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
        if std::thread::panicking() {
            self.seen.extend(self.events.try_iter());
            self.seen.iter().for_each(|event| eprintln!("{event}"));
            eprintln!("{}", self.errors.take().map_or_else(String::new, |errors| errors.join().unwrap_or_default()));
        }
    }
}
