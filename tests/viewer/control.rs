//! A program that controls a viewer over a local socket.

use std::io::{BufRead, BufReader, Write};
use std::os::unix::fs::PermissionsExt;
use std::os::unix::net::UnixStream;
use std::path::Path;
use std::sync::Arc;
use std::thread;
use std::time::Duration;

use serde_json::{Value, json};
use smalto::viewer::{Control, Setup};

use super::frames::{SIZE, open, setup};
use crate::common::Gpu;

/// A program that is connected to a socket.
struct Program {
    stream: UnixStream,
    lines: BufReader<UnixStream>,
    rests: u32,
}

impl Program {
    fn connect(path: &Path) -> Self {
        let stream = UnixStream::connect(path).unwrap();
        stream.set_read_timeout(Some(Duration::from_secs(120))).unwrap();
        let lines = BufReader::new(stream.try_clone().unwrap());
        Self { stream, lines, rests: 0 }
    }

    fn say(&mut self, message: &Value) {
        self.stream.write_all(format!("{message}\n").as_bytes()).unwrap();
    }

    /// The next message of a kind; null when the connection has ended.
    fn told(&mut self, kinds: &[&str]) -> Value {
        loop {
            let mut line = String::new();
            if self.lines.read_line(&mut line).unwrap_or(0) == 0 {
                return Value::Null;
            }
            let told: Value = serde_json::from_str(&line).unwrap();
            if kinds.iter().any(|kind| told["say"] == *kind) {
                return told;
            }
        }
    }

    /// Says something, and returns the state once it is done and shown, or the reason why it is refused.
    fn ask(&mut self, message: &Value) -> Result<Value, String> {
        self.say(message);
        self.rests += 1;
        self.say(&json!({ "do": "rest", "number": self.rests }));
        let mut refused = None;
        loop {
            let told = self.told(&["rests", "refused"]);
            match told["say"].as_str().expect("the connection lasts") {
                "refused" => refused = Some(told["why"].as_str().unwrap().to_owned()),
                _ if told["number"] == self.rests => return refused.map_or(Ok(told["state"].clone()), Err),
                _ => {}
            }
        }
    }
}

/// Draws frames of a viewer with a control while `work` runs as a program.
fn controlled<T: Send>(setup: Setup, path: &Path, work: impl FnOnce() -> T + Send) -> T {
    let gpu = Gpu::new();
    let mut viewer = open(&gpu, setup);
    let mut control = Control::listen(path, Arc::new(|| {})).unwrap();
    thread::scope(|scope| {
        let work = scope.spawn(work);
        while !work.is_finished() {
            let events = control.hear(&mut viewer.session);
            let is_handled = viewer.frame(events).unwrap().platform.is_some();
            viewer.session.retire_frames(true).unwrap();
            control.tell_news(&mut viewer.session, is_handled);
            thread::sleep(Duration::from_millis(2));
        }
        work.join().unwrap()
    })
}

#[test]
fn a_program_sets_views_and_options_and_gets_pictures() {
    let folder = tempfile::tempdir().unwrap();
    let (socket, file) = (folder.path().join("socket"), folder.path().join("view.png"));
    controlled(setup(&["cactus:500"]), &socket, || {
        assert_eq!(std::fs::metadata(&socket).unwrap().permissions().mode() & 0o777, 0o600);
        let mut program = Program::connect(&socket);
        assert!(program.told(&["welcome"])["presets"].to_string().contains("preview"));
        let picture = json!({ "do": "picture", "file": file });
        let draw = |program: &mut Program| {
            let state = program.ask(&picture).unwrap();
            let picture = image::open(&file).unwrap().into_rgb8();
            std::fs::remove_file(&file).unwrap();
            assert_eq!([picture.width(), picture.height()], SIZE);
            (picture, state)
        };
        let (first, state) = draw(&mut program);
        assert_eq!((&state["preset"], &state["look"]), (&json!("balanced"), &json!("colour")));
        // Each picture is that of all messages before it.
        program.say(&json!({ "do": "preset", "name": "preview" }));
        program.say(&json!({ "do": "set", "knob": "sh-degree", "value": "0" }));
        let (coarse, state) = draw(&mut program);
        assert!(coarse != first && state["preset"].is_null(), "{state}");
        program.say(&json!({ "do": "look", "name": "depth", "range": null }));
        let (depths, state) = draw(&mut program);
        assert!(depths != coarse && state["look"] == "depth", "{state}");
        program.say(&json!({ "do": "look", "name": "colour", "range": null }));
        program.say(&json!({ "do": "preset", "name": "balanced" }));
        assert!(draw(&mut program).0 == first);
        // A drag turns the view, and a view that was told is found again.
        let [x, y] = SIZE.map(|side| side / 2);
        let press = json!({ "kind": "button", "x": x, "y": y, "button": "left", "is_pressed": true });
        let release = json!({ "kind": "button", "x": x + 30, "y": y, "button": "left", "is_pressed": false });
        let to = |x: u32| json!({ "kind": "move", "x": x, "y": y });
        let drag = json!([to(x), press, to(x + 30), release]);
        let turned = program.ask(&json!({ "do": "input", "events": drag })).unwrap();
        assert_ne!(turned["rest"]["view"], state["rest"]["view"]);
        assert!(draw(&mut program).0 != first);
        program.say(&json!({ "do": "view", "view": state["rest"]["view"] }));
        assert!(draw(&mut program).0 == first);
        program.say(&json!({ "do": "explain", "pixel": [x, y] }));
        assert!(program.ask(&json!({ "do": "ping", "time": 1 })).unwrap()["explanation"]["splats"].as_u64() > Some(0));
        // What cannot be done is said in a sentence.
        for (message, why) in [
            (json!({ "do": "preset", "name": "best" }), "no preset best"),
            (json!({ "do": "resize", "size": [8, 8] }), "not for the viewer"),
            (json!({ "do": "film", "fps": 30 }), "needs a file name"),
            (json!({ "do": "close-path" }), "several views"),
            (json!({ "do": "film", "fps": 0, "file": folder.path().join("film") }), "1 to 240"),
            (json!({ "do": "film", "fps": 30, "file": folder.path().join("film") }), "no path to write"),
            (json!({ "do": "stop-film" }), "no film of this program"),
            (json!({ "do": "nonsense" }), "no message"),
        ] {
            assert!(program.ask(&message).unwrap_err().contains(why), "{message}");
        }
        let nowhere = folder.path().join("no/such/folder.png");
        let why = program.ask(&json!({ "do": "picture", "file": nowhere })).unwrap_err();
        assert!(why.contains("no/such"), "{why}");
        assert!(program.ask(&json!({ "do": "open", "file": nowhere })).unwrap_err().contains("there is no "));
        // A film as a folder of pictures, all written before the answer.
        program.say(&json!({ "do": "turn" }));
        program.ask(&json!({ "do": "film", "fps": 1, "file": folder.path().join("film") })).unwrap();
        let again = json!({ "do": "film", "fps": 1, "file": folder.path().join("film") });
        assert!(program.ask(&again).unwrap_err().contains("not empty"));
        let frame = |i: usize| folder.path().join(format!("film/{i:05}.png"));
        let frames = (0..).map(frame).take_while(|file| file.exists());
        let frames: Vec<_> = frames.map(|file| image::open(file).unwrap()).collect();
        assert!(frames.len() > 2 && frames[0] != frames[1], "{} frames", frames.len());
        // Pictures of a program that waits for none of them, and that closes its side at the end.
        let files = ["first.png", "coarse.png", "again.png"].map(|name| folder.path().join(name));
        for (preset, file) in ["balanced", "preview", "balanced"].iter().zip(&files) {
            program.say(&json!({ "do": "preset", "name": preset }));
            program.say(&json!({ "do": "picture", "file": file }));
        }
        program.say(&json!({ "do": "rest", "number": 1000 }));
        program.stream.shutdown(std::net::Shutdown::Write).unwrap();
        while program.told(&["rests"])["number"] != 1000 {}
        let [one, two, three] = files.map(|file| image::open(file).unwrap().into_rgb8());
        assert!(one == first && two != first && three == first);
        assert!(program.told(&["none"]).is_null(), "the connection ends");
    });
    assert!(!socket.exists(), "the socket goes with the viewer");
}

#[test]
fn programs_come_and_go() {
    let folder = tempfile::tempdir().unwrap();
    let socket = folder.path().join("socket");
    std::fs::write(&socket, "a file").unwrap();
    let wake = || Arc::new(|| {});
    let taken = Control::listen(&socket, wake()).err().unwrap();
    assert!(format!("{taken:#}").contains("there is such a file already"), "{taken:#}");
    assert_eq!(std::fs::read_to_string(&socket).unwrap(), "a file");
    std::fs::remove_file(&socket).unwrap();
    // A process that was killed leaves its socket.
    drop(std::os::unix::net::UnixListener::bind(&socket).unwrap());
    assert!(socket.exists());
    controlled(setup(&["cactus:500"]), &socket, || {
        assert!(Control::listen(&socket, wake()).is_err(), "another viewer listens there");
        for _ in 0..3 {
            let mut program = Program::connect(&socket);
            program.ask(&json!({ "do": "look", "name": "depth", "range": null })).unwrap();
        }
        // A line that does not end, and a program that reads nothing.
        let mut endless = Program::connect(&socket);
        _ = endless.stream.write_all(&vec![b'['; 2 << 20]);
        while !endless.told(&["none"]).is_null() {}
        let mut deaf = Program::connect(&socket);
        while deaf.stream.write_all(b"{\"do\":\"ping\",\"time\":1}\n").is_ok() {}
        let state = Program::connect(&socket).ask(&json!({ "do": "look", "name": "colour", "range": null }));
        assert_eq!(state.unwrap()["look"], "colour");
    });
}
