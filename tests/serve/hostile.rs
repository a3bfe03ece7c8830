//! Hostile and slow clients: they cost a bounded amount, and the others lose nothing.

use std::io::Write;
use std::net::TcpStream;

use serde_json::{Value, json};
use tungstenite::Message;

use crate::client::{Client, SIZE, socket};
use crate::common::random::Random;
use crate::server::Server;

/// Messages that are wrong in many ways.
fn nonsense(i: usize) -> Message {
    let text = match i % 8 {
        0 => "[".repeat(50_000),
        1 => "{\"do\":".to_owned(),
        2 => json!({ "do": "input", "events": [{ "kind": "move", "x": 1e38, "y": 0 }] }).to_string(),
        3 => json!({ "do": "resize", "size": [u32::MAX, u32::MAX] }).to_string(),
        4 => json!({ "do": "view", "view": { "position": [1e308, 0, 0] } }).to_string(),
        5 => json!({ "do": "shown", "picture": u32::MAX }).to_string(),
        6 => "\u{0}\u{202e}".repeat(1000),
        _ => return Message::Binary(vec![0xff; 1000].into()),
    };
    Message::Text(text.into())
}

#[test]
fn hostile_clients_hurt_nobody_else() {
    let mut server = Server::start(&["cactus:2000"]);
    let mut honest = Client::connect(&server);
    let before = honest.exact();
    // Slow clients: a part of a request, a socket without a first message.
    let mut slow: Vec<_> = (0..20).map(|_| TcpStream::connect(("127.0.0.1", server.port)).unwrap()).collect();
    slow.iter_mut().for_each(|stream| stream.write_all(b"GET / HTTP/1.1\r\nHost: local").unwrap());
    let silent: Vec<_> = (0..5).map(|_| socket(&server)).collect();
    let mut ended = 0;
    for round in 0..12 {
        let mut hostile = socket(&server);
        let hello = json!({ "do": "hello", "token": null, "size": SIZE, "view": null });
        hostile.send(Message::Text(hello.to_string().into())).unwrap();
        let sent = (0..1000).take_while(|i| hostile.send(nonsense(round + i * (1 + round % 3))).is_ok()).count();
        ended += usize::from(sent < 1000 || (0..100_000).any(|_| hostile.read().is_err()));
        honest.say(json!({ "do": "ping", "time": round }));
        assert_eq!(honest.told("pong")["time"], json!(f64::from(round as u32)));
    }
    assert_eq!(ended, 12, "hostile clients are ended");
    honest.say(json!({ "do": "resize", "size": [100, 60] }));
    assert_eq!(honest.exact().size, [100, 60]);
    honest.say(json!({ "do": "resize", "size": SIZE }));
    assert!(honest.exact().png == before.png);
    drop((slow, silent));
    assert!(server.is_running());
}

/// A message that can be read, with strange values.
fn strange(random: &mut Random) -> Value {
    let mut pick = |all: &[Value]| all[random.below(all.len() as u32) as usize].clone();
    let number = [0.0, -1.0, 0.5, 159.0, 1e-30, 1e6, -1e9, 1e38].map(|value| json!(value));
    let whole = [0, 1, 95, 159, 160, 65_535, u32::MAX].map(|value| json!(value));
    let name = ["", "depth", "preview", "scale", "splats", "undo", "next-look", "freeze-culling", "é\u{0}", "../x"];
    let name = name.map(|value| json!(value));
    let value = ["0", "1e-9", "3", "nan", "inf", "-1"].map(|value| json!(value));
    let (x, y, flag) = (pick(&number), pick(&number), pick(&[json!(true), json!(false)]));
    let held = json!({ "shift": flag, "ctrl": pick(&[json!(true), json!(false)]), "alt": false });
    let button = pick(&["left", "middle", "right"].map(|button| json!(button)));
    let mode = pick(&["split", "flicker", "difference"].map(|mode| json!(mode)));
    let messages = [
        json!({ "do": "input", "events": [{ "kind": "move", "x": x, "y": y }] }),
        json!({ "do": "input", "events": [
            { "kind": "button", "x": x, "y": y, "button": button, "is_pressed": flag, "held": held },
            { "kind": "wheel", "points": y }, { "kind": "zoom", "factor": x }] }),
        json!({ "do": "input", "number": pick(&whole), "events": [
            { "kind": "key", "action": "forward", "is_pressed": flag, "held": held }, { "kind": "blur" }] }),
        json!({ "do": "resize", "size": [pick(&whole[..5]), pick(&whole[..5])] }),
        json!({ "do": "set", "knob": pick(&name), "value": pick(&value) }),
        json!({ "do": "preset", "name": pick(&name) }),
        json!({ "do": "act", "action": pick(&name) }),
        json!({ "do": "look", "name": pick(&name), "range": [x, y] }),
        json!({ "do": "camera", "index": pick(&whole) }),
        json!({ "do": "view", "view": { "position": [x, y, 0], "rotation": [[1, 0, 0], [0, 1, 0], [0, 0, 1]],
            "width": pick(&whole), "height": 96, "fx": y, "fy": x, "id": 0, "img_name": "" } }),
        json!({ "do": "compare", "with": pick(&name) }),
        json!({ "do": "compare-by", "mode": mode, "split": x, "gain": y }),
        json!({ "do": "explain", "pixel": [pick(&whole), pick(&whole)] }),
        json!({ "do": "focus", "pixel": [pick(&whole), pick(&whole)] }),
        json!({ "do": "show", "scene": pick(&whole[..2]), "is_shown": flag }),
        json!({ "do": "place", "scene": pick(&whole[..2]),
            "placement": { "position": [x, y, 0], "rotation": [y, x, 0], "scale": x } }),
        json!({ "do": "close", "scene": pick(&whole) }),
        json!({ "do": "files", "folder": pick(&name) }),
        json!({ "do": "open", "file": pick(&name) }),
        json!({ "do": "shown", "picture": pick(&whole) }),
        json!({ "do": "mark", "pixel": [pick(&whole), pick(&whole)] }),
        json!({ "do": "measure", "kind": pick(&["distance", "angle", "area", "pairs"].map(|kind| json!(kind))) }),
        json!({ "do": "measures", "measures": {
            "all": [{ "kind": "area", "points": [[x, y, 0], [y, y, x], [0, x, y]] }],
            "unit": { "name": pick(&name), "per_world": y } } }),
        json!({ "do": "unit", "name": pick(&name), "length": y }),
        json!({ "do": "close-path" }),
        json!({ "do": "path", "keys": [
            { "position": [x, y, 0], "rotation": [[1, 0, 0], [0, 1, 0], [0, 0, 1]], "width": 64, "height": pick(&whole),
              "fx": 50, "fy": 50, "seconds": x },
            { "position": [y, y, 0], "rotation": [[1, 0, 0], [0, 1, 0], [0, 0, 1]], "width": 64, "height": 64,
              "fx": 50, "fy": 50, "seconds": y, "rests": flag }] }),
        json!({ "do": "turn" }),
        json!({ "do": "time", "seconds": x }),
        json!({ "do": "film", "fps": y }),
        json!({ "do": "film", "fps": 30, "file": pick(&name) }),
        json!({ "do": "stop-film" }),
        json!({ "do": "rest", "number": pick(&whole) }),
        json!({ "do": "picture", "file": pick(&name) }),
    ];
    pick(&messages)
}

#[test]
fn strange_values_do_no_harm() {
    let mut server = Server::start(&["cactus:500"]);
    let mut honest = Client::connect(&server);
    let before = honest.exact();
    let mut random = Random(7);
    for round in 0..4 {
        let mut client = Client::connect(&server);
        for i in 0..60 {
            client.say(strange(&mut random));
            client.say(json!({ "do": "ping", "time": i }));
            while client.told("pong")["time"] != json!(f64::from(i)) {}
        }
        // The viewer is still one that can be used, once no button is held.
        let release = |button| json!({ "kind": "button", "x": 0, "y": 0, "button": button, "is_pressed": false });
        client.input(json!([release("left"), release("middle"), release("right")]));
        client.say(json!({ "do": "resize", "size": [64 + round, 64] }));
        client.until(|state| state["rest"]["view"]["width"] == json!(64 + round));
    }
    honest.say(json!({ "do": "resize", "size": [100, 60] }));
    assert_eq!(honest.exact().size, [100, 60]);
    honest.say(json!({ "do": "resize", "size": SIZE }));
    assert!(honest.exact().png == before.png);
    assert!(server.is_running());
}

#[test]
fn clients_that_come_and_go_leave_nothing() {
    let server = Server::start(&["cactus:2000"]);
    let visit = || {
        let mut client = Client::connect(&server);
        client.exact();
    };
    (0..6).for_each(|_| visit());
    let before = server.resident();
    (0..24).for_each(|_| visit());
    let after = server.resident();
    assert!(after < before + before / 4, "{before} kB before, {after} kB after 24 clients");
}

#[test]
fn a_still_client_costs_no_time() {
    let server = Server::start(&["cactus:2000"]);
    let mut client = Client::connect(&server);
    client.exact();
    client.until(|state| !state["rest"].is_null());
    // Notes disappear after some seconds, and jobs end.
    std::thread::sleep(std::time::Duration::from_secs(8));
    let before = server.ticks();
    std::thread::sleep(std::time::Duration::from_secs(5));
    let ticks = server.ticks() - before;
    // Of 500; processor time does not depend on what else runs.
    assert!(ticks <= 5, "{ticks} ticks of processor time in 5 s");
}
