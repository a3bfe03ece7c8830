//! A client, as a program.

use std::net::TcpStream;
use std::time::Duration;

use image::RgbImage;
use serde_json::{Value, json};
use tungstenite::{Message, WebSocket};

use crate::server::Server;

pub const SIZE: [u32; 2] = [160, 96];

/// Time within which a busy machine answers, and the pings of such a time.
const PATIENCE: Duration = Duration::from_secs(120);
const MAX_PINGS: usize = 6;

pub struct Client {
    pub socket: WebSocket<TcpStream>,
    pub welcome: Value,
    /// The last state.
    pub state: Value,
    /// The last of the other messages, by their kind.
    pub said: serde_json::Map<String, Value>,
    /// The parts of a PNG.
    parts: Vec<u8>,
    /// True to say that pictures are shown.
    pub confirms: bool,
    inputs: u32,
}

/// A picture that a client gets.
pub struct Picture {
    pub number: u32,
    /// The last input that it answers.
    pub answered: u32,
    pub size: [u32; 2],
    /// The server says that `smalto render` writes this file.
    pub is_of_render: bool,
    /// The file of a picture without loss.
    pub png: Option<Vec<u8>>,
    pub pixels: RgbImage,
}

/// What the server sends.
pub enum Heard {
    Text(Value),
    Picture(Picture),
    /// A part of a PNG.
    Part,
    /// The reason why the connection ended.
    End(String),
}

/// Opens a socket with these headers, without a first message.
pub fn socket(server: &Server) -> WebSocket<TcpStream> {
    let stream = TcpStream::connect(("127.0.0.1", server.port)).unwrap();
    stream.set_read_timeout(Some(PATIENCE)).unwrap();
    tungstenite::client(format!("ws://localhost:{}/socket", server.port), stream).unwrap().0
}

impl Client {
    pub fn connect(server: &Server) -> Self {
        Self::connect_with(server, json!({ "size": SIZE }))
    }

    /// Connects with these fields in the first message.
    pub fn connect_with(server: &Server, fields: Value) -> Self {
        let mut hello = json!({ "do": "hello", "token": server.token, "view": null });
        hello.as_object_mut().unwrap().extend(fields.as_object().unwrap().clone());
        let mut client = Self {
            socket: socket(server),
            welcome: Value::Null,
            state: Value::Null,
            said: serde_json::Map::new(),
            parts: Vec::new(),
            confirms: true,
            inputs: 0,
        };
        client.say(hello);
        while client.welcome.is_null() {
            match client.hear() {
                Heard::Text(text) if text["say"] == "welcome" => client.welcome = text,
                Heard::End(why) => panic!("{why}"),
                _ => {}
            }
        }
        client
    }

    pub fn say(&mut self, message: Value) {
        // The server may have ended the connection.
        _ = self.socket.send(Message::Text(message.to_string().into()));
    }

    pub fn input(&mut self, events: Value) {
        self.inputs += 1;
        self.say(json!({ "do": "input", "number": self.inputs, "events": events }));
    }

    /// The next message.
    pub fn hear(&mut self) -> Heard {
        // A server that has nothing to say sends pings.
        for _ in 0..MAX_PINGS {
            return match self.socket.read() {
                Ok(Message::Text(text)) => {
                    let value: Value = serde_json::from_str(&text).unwrap();
                    let kind = value["say"].as_str().unwrap().to_owned();
                    if kind == "state" {
                        self.state = value.clone();
                    }
                    self.said.insert(kind, value.clone());
                    Heard::Text(value)
                }
                Ok(Message::Binary(bytes)) => self.picture(&bytes).map_or(Heard::Part, Heard::Picture),
                Ok(Message::Close(frame)) => Heard::End(frame.map_or_else(String::new, |f| f.reason.to_string())),
                Ok(_) => continue,
                Err(problem) => Heard::End(problem.to_string()),
            };
        }
        Heard::End("the server only sends pings".to_owned())
    }

    fn picture(&mut self, bytes: &[u8]) -> Option<Picture> {
        let word = |i: usize| u32::from_le_bytes(bytes[4 * i..4 * i + 4].try_into().unwrap());
        let (number, answered, size) = (word(1), word(2), [word(3), word(4)]);
        let (png, pixels) = if word(0) == 1 {
            let mut pixels = RgbImage::new(size[0], size[1]);
            let (reduction, count) = (word(5), word(6) as usize);
            let mut place = 28 + 12 * count;
            for strip in 0..count {
                let [top, rows, length] = [0, 1, 2].map(|i| word(7 + 3 * strip + i));
                let file = &bytes[place..place + length as usize];
                place += length as usize;
                let read = image::load_from_memory_with_format(file, image::ImageFormat::Jpeg).unwrap().into_rgb8();
                for y in 0..rows {
                    (0..size[0]).for_each(|x| {
                        pixels.put_pixel(x, top + y, *read.get_pixel(x / reduction, y / reduction));
                    });
                }
            }
            assert_eq!(place, bytes.len());
            (None, pixels)
        } else {
            if word(5) == 0 {
                self.parts.clear();
            }
            assert_eq!(self.parts.len(), word(5) as usize);
            self.parts.extend(&bytes[28..]);
            if self.parts.len() < word(6) as usize {
                return None;
            }
            let file = std::mem::take(&mut self.parts);
            let pixels = image::load_from_memory(&file).unwrap().into_rgb8();
            (Some(file), pixels)
        };
        if self.confirms {
            self.say(json!({ "do": "shown", "picture": number }));
        }
        Some(Picture { number, answered, size, is_of_render: word(0) == 3, png, pixels })
    }

    /// The next picture without loss.
    pub fn exact(&mut self) -> Picture {
        loop {
            match self.hear() {
                Heard::Picture(picture) if picture.png.is_some() => return picture,
                Heard::End(why) => panic!("{why}"),
                _ => {}
            }
        }
    }

    /// The next compressed picture.
    pub fn compressed(&mut self) -> Picture {
        loop {
            match self.hear() {
                Heard::Picture(picture) if picture.png.is_none() => return picture,
                Heard::End(why) => panic!("{why}"),
                _ => {}
            }
        }
    }

    /// Waits for a state of this kind.
    pub fn until(&mut self, is_reached: impl Fn(&Value) -> bool) -> Value {
        while !is_reached(&self.state) {
            if let Heard::End(why) = self.hear() {
                panic!("{why}: {} {:?}", self.state, self.said.get("refused"));
            }
        }
        self.state.clone()
    }

    /// Waits for a message of this kind.
    pub fn told(&mut self, kind: &str) -> Value {
        loop {
            match self.hear() {
                Heard::Text(text) if text["say"] == kind => return text,
                Heard::End(why) => panic!("{why}"),
                _ => {}
            }
        }
    }
}
