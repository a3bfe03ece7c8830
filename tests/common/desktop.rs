//! A virtual X server for one test: key presses, a mouse, dropped files, and screenshots.

use std::collections::HashMap;
use std::io::{BufRead, BufReader, IoSlice};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use x11rb::connection::{Connection, RequestConnection};
use x11rb::protocol::Event;
use x11rb::protocol::xproto::{
    self, AtomEnum, ClientMessageEvent, ConfigureWindowAux, ConnectionExt as _, CreateWindowAux, EventMask,
    ImageFormat, InputFocus, PropMode, SelectionNotifyEvent, WindowClass,
};
use x11rb::rust_connection::RustConnection;
use x11rb::wrapper::ConnectionExt as _;

/// How long anything may take on a slow device.
pub const PATIENCE: Duration = Duration::from_secs(90);

/// The size of the server's screen.
pub const SCREEN: [u32; 2] = [800, 600];

/// How long a key is held until it repeats itself.
pub const REPEAT_DELAY: Duration = Duration::from_millis(100);

/// Key symbols that are not letters.
pub const CONTROL: u32 = 0xffe3;
pub const SHIFT: u32 = 0xffe1;
pub const ESCAPE: u32 = 0xff1b;

/// Event codes of the core protocol.
const KEY_PRESS: u8 = 2;
const KEY_RELEASE: u8 = 3;
const BUTTON_PRESS: u8 = 4;
const BUTTON_RELEASE: u8 = 5;
const MOTION: u8 = 6;

/// A server, and a window manager if the test asks for one.
pub struct Desktop {
    pub name: String,
    server: Child,
    manager: Option<Child>,
    connection: RustConnection,
    root: u32,
    keys: HashMap<u32, u8>,
    /// The major opcode of XTEST requests.
    input: u8,
}

/// The pixels of a window, row by row.
#[derive(Clone, PartialEq)]
pub struct Shot {
    pub size: [u32; 2],
    pub rgb: Vec<[u8; 3]>,
}

impl Shot {
    pub fn at(&self, [x, y]: [u32; 2]) -> [u8; 3] {
        self.rgb[(y * self.size[0] + x) as usize]
    }

    /// The number of pixels that differ.
    pub fn different(&self, other: &Self) -> usize {
        assert_eq!(self.size, other.size);
        self.rgb.iter().zip(&other.rgb).filter(|(a, b)| a != b).count()
    }

    /// The number of pixels that are not black.
    pub fn lit(&self) -> usize {
        self.rgb.iter().filter(|pixel| **pixel != [0; 3]).count()
    }
}

fn start(program: &str, command: &mut Command) -> Child {
    command.spawn().unwrap_or_else(|e| panic!("{program} does not start: {e}. Run ./setup.sh, which installs it"))
}

impl Desktop {
    pub fn open(has_manager: bool) -> Self {
        let [width, height] = SCREEN;
        let screen = format!("{width}x{height}x24");
        let mut server = Command::new("Xvfb");
        server.args(["-displayfd", "1", "-screen", "0", &screen, "-nolisten", "tcp", "-noreset"]);
        server.args(["-ardelay", &REPEAT_DELAY.as_millis().to_string(), "-arinterval", "20"]);
        let mut server = start("Xvfb", server.stdout(Stdio::piped()).stderr(Stdio::null()));
        let mut number = String::new();
        BufReader::new(server.stdout.take().unwrap()).read_line(&mut number).expect("Xvfb says its display");
        let name = format!(":{}", number.trim());
        let (connection, screen) = x11rb::connect(Some(&name)).expect("Xvfb can be reached");
        let root = connection.setup().roots[screen].root;
        let (first, last) = (connection.setup().min_keycode, connection.setup().max_keycode);
        let mapping = connection.get_keyboard_mapping(first, last - first + 1).unwrap().reply().unwrap();
        let per_key = usize::from(mapping.keysyms_per_keycode);
        let codes = (first..=last).zip(mapping.keysyms.chunks(per_key));
        let mut keys = HashMap::new();
        for (code, symbols) in codes {
            keys.entry(symbols[0]).or_insert(code);
        }
        let input = connection.query_extension(b"XTEST").unwrap().reply().unwrap();
        assert!(input.present, "Xvfb has no XTEST");
        let manager = has_manager.then(|| {
            let mut manager = Command::new("openbox");
            manager.env("DISPLAY", &name).env("XDG_CONFIG_HOME", "/nowhere");
            start("openbox", manager.stdout(Stdio::null()).stderr(Stdio::null()))
        });
        let desktop = Self { name, server, manager, connection, root, keys, input: input.major_opcode };
        if has_manager {
            desktop.wait_for_manager();
        }
        desktop
    }

    /// Waits until the manager shows a window: it overlooks windows that open while it starts.
    fn wait_for_manager(&self) {
        self.until("openbox has begun", || !self.property(self.root, "_NET_SUPPORTING_WM_CHECK").is_empty());
        let (window, values) = (self.connection.generate_id().unwrap(), CreateWindowAux::new());
        let (class, visual) = (WindowClass::INPUT_OUTPUT, x11rb::COPY_FROM_PARENT);
        self.connection.create_window(0, window, self.root, 0, 0, 9, 9, 0, class, visual, &values).unwrap();
        self.until("openbox shows a window", || {
            self.connection.map_window(window).unwrap().check().unwrap();
            std::thread::sleep(Duration::from_millis(50));
            self.property(self.root, "_NET_ACTIVE_WINDOW") == [window]
        });
        self.connection.destroy_window(window).unwrap().check().unwrap();
    }

    /// Waits until the condition holds, at most [`PATIENCE`].
    pub fn until(&self, what: &str, mut is_so: impl FnMut() -> bool) {
        let begun = Instant::now();
        while !is_so() {
            assert!(begun.elapsed() < PATIENCE, "waited in vain until {what}");
            std::thread::sleep(Duration::from_millis(10));
        }
    }

    fn atom(&self, name: &str) -> u32 {
        self.connection.intern_atom(false, name.as_bytes()).unwrap().reply().unwrap().atom
    }

    /// 32-bit values of a property; none where there is no such property.
    fn property(&self, window: u32, name: &str) -> Vec<u32> {
        let reply = self.connection.get_property(false, window, self.atom(name), AtomEnum::ANY, 0, 1024);
        let reply = reply.unwrap().reply();
        reply.ok().and_then(|reply| Some(reply.value32()?.collect())).unwrap_or_default()
    }

    /// The window of a process, once it is on the screen.
    pub fn window_of(&self, process: u32) -> u32 {
        let mut found = None;
        self.until("there is a window", || {
            found = self.search(self.root, process);
            found.is_some_and(|window| {
                let attributes = self.connection.get_window_attributes(window).unwrap().reply();
                attributes.is_ok_and(|attributes| attributes.map_state == xproto::MapState::VIEWABLE)
            })
        });
        let window = found.unwrap();
        if self.manager.is_some() {
            self.until("the window is active", || self.property(self.root, "_NET_ACTIVE_WINDOW") == [window]);
        } else {
            self.connection.set_input_focus(InputFocus::PARENT, window, x11rb::CURRENT_TIME).unwrap();
            self.connection.sync().unwrap();
        }
        window
    }

    fn search(&self, window: u32, process: u32) -> Option<u32> {
        if self.property(window, "_NET_WM_PID") == [process] && !self.property(window, "XdndAware").is_empty() {
            return Some(window);
        }
        let below = self.connection.query_tree(window).unwrap().reply().ok()?.children;
        below.into_iter().find_map(|child| self.search(child, process))
    }

    /// A FakeInput request of XTEST.
    fn fake(&self, kind: u8, detail: u8, [x, y]: [i16; 2]) {
        let mut request = [0; 36];
        request[..6].copy_from_slice(&[self.input, 2, 9, 0, kind, detail]);
        request[12..16].copy_from_slice(&self.root.to_ne_bytes());
        request[24..26].copy_from_slice(&x.to_ne_bytes());
        request[26..28].copy_from_slice(&y.to_ne_bytes());
        self.connection.send_request_without_reply(&[IoSlice::new(&request)], Vec::new()).unwrap().check().unwrap();
    }

    pub fn key(&self, symbol: u32, is_down: bool) {
        let code = *self.keys.get(&symbol).unwrap_or_else(|| panic!("the keyboard has no key {symbol:#x}"));
        self.fake(if is_down { KEY_PRESS } else { KEY_RELEASE }, code, [0, 0]);
    }

    pub fn button(&self, number: u8, is_down: bool) {
        self.fake(if is_down { BUTTON_PRESS } else { BUTTON_RELEASE }, number, [0, 0]);
    }

    /// Moves the pointer to a place in a window.
    pub fn point(&self, window: u32, [x, y]: [i16; 2]) {
        let at = self.connection.translate_coordinates(window, self.root, x, y).unwrap().reply().unwrap();
        self.fake(MOTION, 0, [at.dst_x, at.dst_y]);
    }

    pub fn size(&self, window: u32) -> [u32; 2] {
        let geometry = self.connection.get_geometry(window).unwrap().reply().unwrap();
        [geometry.width.into(), geometry.height.into()]
    }

    pub fn resize(&self, window: u32, [width, height]: [u32; 2]) {
        let change = ConfigureWindowAux::new().width(width).height(height);
        self.connection.configure_window(window, &change).unwrap().check().unwrap();
    }

    pub fn minimize(&self, window: u32) {
        const ICONIC: u32 = 3;
        let message = ClientMessageEvent::new(32, window, self.atom("WM_CHANGE_STATE"), [ICONIC, 0, 0, 0, 0]);
        let mask = EventMask::SUBSTRUCTURE_REDIRECT | EventMask::SUBSTRUCTURE_NOTIFY;
        self.connection.send_event(false, self.root, mask, message).unwrap().check().unwrap();
        self.until("the window is minimized", || !self.is_on_screen(window));
    }

    pub fn restore(&self, window: u32) {
        self.connection.map_window(window).unwrap().check().unwrap();
        self.until("the window is back", || self.is_on_screen(window));
    }

    fn is_on_screen(&self, window: u32) -> bool {
        let attributes = self.connection.get_window_attributes(window).unwrap().reply().unwrap();
        attributes.map_state == xproto::MapState::VIEWABLE
    }

    /// What a window shows now.
    pub fn shot(&self, window: u32) -> Shot {
        let size = self.size(window);
        let [width, height] = size.map(|side| side as u16);
        let image = self.connection.get_image(ImageFormat::Z_PIXMAP, window, 0, 0, width, height, u32::MAX);
        let image = image.unwrap().reply().expect("the window is on the screen");
        assert_eq!(image.data.len(), (size[0] * size[1] * 4) as usize, "4 bytes a pixel");
        Shot { size, rgb: image.data.chunks_exact(4).map(|p| [p[2], p[1], p[0]]).collect() }
    }

    /// Drops files on the middle of a window, by version 5 of XDND.
    pub fn drop_files(&self, window: u32, files: &[&str]) {
        let connection = &self.connection;
        let source = connection.generate_id().unwrap();
        let values = CreateWindowAux::new();
        let (class, visual) = (WindowClass::INPUT_ONLY, x11rb::COPY_FROM_PARENT);
        connection.create_window(0, source, self.root, 0, 0, 1, 1, 0, class, visual, &values).unwrap();
        let [aware, selection, list, copy] =
            ["XdndAware", "XdndSelection", "text/uri-list", "XdndActionCopy"].map(|name| self.atom(name));
        let [enter, position, status, drop_it, finished] =
            ["XdndEnter", "XdndPosition", "XdndStatus", "XdndDrop", "XdndFinished"].map(|name| self.atom(name));
        assert_eq!(self.property(window, "XdndAware").len(), 1, "the window takes drops");
        connection.change_property32(PropMode::REPLACE, source, aware, AtomEnum::ATOM, &[5]).unwrap();
        connection.set_selection_owner(source, selection, x11rb::CURRENT_TIME).unwrap();
        let tell = |kind: u32, data: [u32; 5]| {
            let message = ClientMessageEvent::new(32, window, kind, data);
            connection.send_event(false, window, EventMask::NO_EVENT, message).unwrap().check().unwrap();
        };
        let content: String = files.iter().map(|file| format!("file://{file}\r\n")).collect();
        let [width, height] = self.size(window).map(|side| side as i16);
        let at = connection.translate_coordinates(window, self.root, width / 2, height / 2).unwrap().reply().unwrap();
        let place = (at.dst_x as u32) << 16 | at.dst_y as u32;
        tell(enter, [source, 5 << 24, list, 0, 0]);
        tell(position, [source, 0, place, x11rb::CURRENT_TIME, copy]);
        // The window asks for the list and takes the drop, in either order; then it has finished.
        let (mut is_served, mut is_taken, mut is_dropped, mut is_finished) = (false, false, false, false);
        self.until("the drop is finished", || {
            while let Some(event) = connection.poll_for_event().unwrap() {
                match event {
                    Event::SelectionRequest(request) => {
                        let to = (request.requestor, request.property);
                        connection.change_property8(PropMode::REPLACE, to.0, to.1, list, content.as_bytes()).unwrap();
                        let notice = SelectionNotifyEvent {
                            response_type: xproto::SELECTION_NOTIFY_EVENT,
                            sequence: 0,
                            time: request.time,
                            requestor: request.requestor,
                            selection: request.selection,
                            target: request.target,
                            property: request.property,
                        };
                        connection.send_event(false, request.requestor, EventMask::NO_EVENT, notice).unwrap();
                        connection.sync().unwrap();
                        is_served = true;
                    }
                    Event::ClientMessage(message) if message.type_ == status => {
                        is_taken = message.data.as_data32()[1] & 1 == 1;
                        assert!(is_taken, "the window refuses the drop");
                    }
                    Event::ClientMessage(message) if message.type_ == finished => is_finished = true,
                    _ => {}
                }
            }
            if is_served && is_taken && !is_dropped {
                is_dropped = true;
                tell(drop_it, [source, 0, x11rb::CURRENT_TIME, 0, 0]);
            }
            is_finished
        });
        connection.destroy_window(source).unwrap().check().unwrap();
    }
}

impl Drop for Desktop {
    fn drop(&mut self) {
        for child in self.manager.iter_mut().chain([&mut self.server]) {
            let _ = child.kill();
            let _ = child.wait();
        }
    }
}
