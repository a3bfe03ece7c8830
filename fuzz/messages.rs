//! The fuzz target of messages: what a program says to a viewer (docs/control.md). It needs a Vulkan device, and
//! lavapipe is enough.

#![no_main]

use std::cell::RefCell;
use std::io::{Read, Write};
use std::os::unix::net::UnixStream;
use std::sync::Arc;
use std::time::Duration;

use libfuzzer_sys::fuzz_target;
use smalto::gpu::{Device, DeviceChoice, Validation};
use smalto::viewer::{Control, Offscreen, Setup};
use tempfile::TempDir;

/// Frames after which a viewer has done what was asked for.
const FRAMES: usize = 2000;

/// A viewer, and the connection of a program to it.
struct Subject {
    viewer: Offscreen,
    control: Control,
    folder: TempDir,
    program: UnixStream,
    /// What the viewer has said, back to some time ago.
    heard: Vec<u8>,
    pings: u32,
}

impl Subject {
    fn new() -> Self {
        let device = Device::open(&DeviceChoice::default(), Validation::Off).expect("there is a device");
        let setup = Setup { scenes: vec!["cactus:200".into()], ..Setup::default() };
        let mut viewer = Offscreen::bare(setup, &device, [48, 32], Arc::new(|| {})).expect("a viewer can be made");
        viewer.settle().expect("the scene is shown");
        let folder = tempfile::tempdir().expect("there is a folder for temporary files");
        let control = Control::listen(&folder.path().join("socket"), Arc::new(|| {})).expect("a socket can be made");
        let program = connect(&folder);
        Self { viewer, control, folder, program, heard: Vec::new(), pings: 0 }
    }

    /// Says lines, and draws frames until they are handled.
    fn say(&mut self, lines: &[u8]) {
        self.pings += 1;
        let ping = format!("\n{{\"do\":\"ping\",\"time\":{}}}\n", self.pings);
        let is_said = self.program.write_all(lines).and_then(|()| self.program.write_all(ping.as_bytes())).is_ok();
        let answer = format!("\"say\":\"pong\",\"time\":{}.0", self.pings);
        for _ in 0..FRAMES {
            let events = self.control.hear(&mut self.viewer.session);
            let is_handled = self.viewer.frame(events).expect("a frame is drawn").platform.is_some();
            self.viewer.session.retire_frames(true).expect("a frame is drawn");
            self.control.tell_news(&mut self.viewer.session, is_handled);
            if self.has_heard(answer.as_bytes()) {
                return;
            }
            std::thread::sleep(Duration::from_millis(1));
            if !is_said {
                break;
            }
        }
        // A line that does not end is the end of the connection.
        assert!(!is_said || lines.len() > 1 << 19, "messages are not handled");
        self.program = connect(&self.folder);
    }

    fn has_heard(&mut self, answer: &[u8]) -> bool {
        let mut part = [0; 1 << 16];
        while let Ok(bytes @ 1..) = self.program.read(&mut part) {
            self.heard.extend(&part[..bytes]);
        }
        let has_heard = self.heard.windows(answer.len()).any(|window| window == answer);
        let kept = if has_heard { 0 } else { answer.len().min(self.heard.len()) };
        self.heard.drain(..self.heard.len() - kept);
        has_heard
    }
}

fn connect(folder: &TempDir) -> UnixStream {
    let stream = UnixStream::connect(folder.path().join("socket")).expect("the viewer listens");
    stream.set_nonblocking(true).expect("a socket need not block");
    stream
}

thread_local! {
    static SUBJECT: RefCell<Subject> = RefCell::new(Subject::new());
}

fuzz_target!(|bytes: &[u8]| {
    // Messages that name files would write and read those of this machine.
    let names_a_file =
        |line: &&[u8]| [&b"picture"[..], b"open"].iter().any(|name| line.windows(name.len()).any(|w| w == *name));
    let lines: Vec<&[u8]> = bytes.split(|byte| *byte == b'\n').filter(|line| !names_a_file(line)).collect();
    SUBJECT.with_borrow_mut(|subject| subject.say(&lines.join(&b'\n')));
});
