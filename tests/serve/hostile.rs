//! Hostile and slow clients: they cost a bounded amount, and the others lose nothing.

use std::io::Write;
use std::net::TcpStream;

use serde_json::json;
use tungstenite::Message;

use crate::client::{Client, SIZE, socket};
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
