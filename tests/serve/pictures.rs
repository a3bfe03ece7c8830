//! The pictures of a client: compressed ones while the view moves, and the file of `smalto render` at rest.

use serde_json::{Value, json};

use crate::client::{Client, Heard, SIZE};
use crate::common::program::{ok, path};
use crate::server::Server;

/// The file that the command line of the client writes.
fn rendered(command: &str) -> Vec<u8> {
    let folder = tempfile::tempdir().unwrap();
    let file = path(&folder, "view.png");
    let words: Vec<_> = command.split(' ').skip(1).map(|word| word.trim_matches('\'').to_owned()).collect();
    let words: Vec<_> = words.iter().map(|word| if word == "view.png" { file.as_str() } else { word }).collect();
    ok(&words);
    std::fs::read(&file).unwrap()
}

/// A drag by some pixels with the left button.
fn drag(client: &mut Client, by: [f32; 2]) {
    let [x, y] = [80.0, 48.0];
    client.input(json!([
        { "kind": "move", "x": x, "y": y },
        { "kind": "button", "x": x, "y": y, "button": "left", "is_pressed": true },
        { "kind": "move", "x": x + by[0], "y": y + by[1] },
        { "kind": "button", "x": x + by[0], "y": y + by[1], "button": "left", "is_pressed": false },
    ]));
}

#[test]
fn a_picture_at_rest_is_the_file_of_render() {
    let folder = tempfile::tempdir().unwrap();
    let codings = path(&folder, "codings.smalto");
    ok(&["lod", "cactus:20000", "-o", &codings]);
    for scene in [&["cactus:2000"][..], &["cactus:2000", "--preset", "fast", "--background", "0.2,0.5,1"], &[&codings]]
    {
        let server = Server::start(scene);
        let mut client = Client::connect(&server);
        let first = client.exact();
        let state = client.until(|state| !state["rest"].is_null());
        let command = state["rest"]["command"].as_str().unwrap().to_owned();
        assert!(first.is_of_render && rendered(&command) == first.png.unwrap(), "{command}");
        drag(&mut client, [30.0, 11.0]);
        let moved = client.exact();
        let state = client.until(|state| !state["rest"].is_null() && state["rest"]["command"] != *command);
        let command = state["rest"]["command"].as_str().unwrap();
        assert!(moved.is_of_render && rendered(command) == moved.png.unwrap(), "{command}");
        assert!(moved.number > first.number && moved.pixels != first.pixels);
    }
}

#[test]
fn what_render_does_not_draw_is_not_called_its_file() {
    let server = Server::start(&["cactus:2000", "cactus:300"]);
    let mut client = Client::connect(&server);
    let both = client.exact();
    assert!(!both.is_of_render, "render draws one scene");
    client.say(json!({ "do": "close", "scene": 1 }));
    let one = client.exact();
    assert!(one.is_of_render && one.pixels != both.pixels);
    client.say(json!({ "do": "close", "scene": 0 }));
    assert!(client.told("refused")["why"].as_str().unwrap().contains("last scene"));
    for message in
        [json!({ "do": "look", "name": "depth", "range": null }), json!({ "do": "compare", "with": "preview" })]
    {
        client.say(message);
        assert!(!client.exact().is_of_render);
    }
}

#[test]
fn compressed_pictures_have_the_loss_that_is_said() {
    let server = Server::start(&["cactus:2000"]);
    let mut client = Client::connect(&server);
    let compressed = client.compressed();
    let exact = client.exact();
    assert_eq!([compressed.size, exact.size], [SIZE; 2]);
    let squares = |a: &u8, b: &u8| f64::from(a.abs_diff(*b)).powi(2);
    let sum: f64 = compressed.pixels.iter().zip(exact.pixels.iter()).map(|(a, b)| squares(a, b)).sum();
    let psnr = 10.0 * (255.0 * 255.0 * compressed.pixels.len() as f64 / sum).log10();
    let loss = client.said.get("loss").cloned().unwrap_or_else(|| client.told("loss"));
    if loss["picture"] == compressed.number {
        let said = loss["psnr"].as_f64().unwrap();
        assert!((said - psnr).abs() < 1e-6, "{said} {psnr}");
    }
    assert!(psnr > 25.0, "{psnr}");
}

#[test]
fn a_client_that_shows_nothing_gets_few_pictures() {
    let server = Server::start(&["cactus:2000"]);
    let mut client = Client::connect(&server);
    client.exact();
    client.confirms = false;
    let mut pictures = 0;
    for i in 0..40 {
        drag(&mut client, [i as f32, 0.0]);
        client.say(json!({ "do": "ping", "time": i }));
        while !matches!(client.hear(), Heard::Text(text) if text["say"] == "pong") {}
    }
    client.socket.get_ref().set_read_timeout(Some(std::time::Duration::from_secs(2))).unwrap();
    let newest = loop {
        match client.hear() {
            Heard::Picture(picture) => {
                pictures += 1;
                client.confirms = pictures > 30;
                if pictures > 30 {
                    break picture.number;
                }
            }
            Heard::End(_) => break 0,
            _ => {}
        }
    };
    assert!(pictures <= 14 && newest == 0, "{pictures} pictures without an answer");
    let events = vec![json!({ "kind": "gone" }); 256];
    (0..20).for_each(|_| client.input(json!(events)));
    let why = loop {
        if let Heard::End(why) = client.hear() {
            break why;
        }
    };
    assert!(why.contains("shows no pictures"), "{why}");
}

#[test]
fn each_client_has_a_view_of_its_own() {
    let server = Server::start(&["cactus:2000", "--clients", "2"]);
    let mut first = Client::connect(&server);
    let before = first.exact();
    let mut second = Client::connect_with(&server, json!({ "size": [96, 64] }));
    assert_eq!(second.exact().size, [96, 64]);
    drag(&mut second, [25.0, 0.0]);
    second.exact();
    first.say(json!({ "do": "resize", "size": [100, 100] }));
    assert_eq!(first.exact().size, [100, 100]);
    first.say(json!({ "do": "resize", "size": SIZE }));
    assert!(first.exact().png == before.png, "the view of the first client has not moved");
    // A third client is one too many, until one leaves.
    let mut third = crate::client::socket(&server);
    third
        .send(tungstenite::Message::Text(
            json!({ "do": "hello", "token": null, "size": SIZE, "view": null }).to_string().into(),
        ))
        .unwrap();
    let refused = third.read().unwrap();
    assert!(
        matches!(&refused, tungstenite::Message::Close(Some(frame)) if frame.reason.contains("2 browsers")),
        "{refused:?}"
    );
    drop(second);
    let view = first.until(|state| !state["rest"].is_null())["rest"]["view"].clone();
    let again = loop {
        let mut socket = crate::client::socket(&server);
        let hello = json!({ "do": "hello", "token": null, "size": SIZE, "view": view });
        socket.send(tungstenite::Message::Text(hello.to_string().into())).unwrap();
        // The server notices soon that the second client has left.
        if matches!(socket.read().unwrap(), tungstenite::Message::Text(_)) {
            break socket;
        }
    };
    drop(again);
}

/// The views of clients outlive the device, and pictures are those of before.
#[test]
fn a_lost_device_is_opened_again() {
    let server = Server::losing_its_device_in(200, &["cactus:2000"]);
    let mut clients = [Client::connect(&server), Client::connect(&server)];
    let view = |client: &mut Client| client.until(|state| !state["rest"].is_null())["rest"]["view"].clone();
    let before = clients.each_mut().map(|client| (client.exact(), view(client)));
    let turned = |points: u32| json!([{ "kind": "move", "x": 80, "y": 48 }, { "kind": "wheel", "points": points }]);
    clients[0].input(turned(200));
    clients[0].exact();
    let moved = view(&mut clients[0]);
    let is_told = |state: &Value| state["messages"].to_string().contains("the device is opened again");
    while !is_told(&clients[1].state) {
        clients[1].input(turned(20));
        clients[1].compressed();
    }
    // What is left of the wheel's motion would follow the view that is set below.
    clients[1].exact();
    clients[0].until(is_told);
    assert!(moved != before[0].1 && view(&mut clients[0]) == moved);
    for (client, (picture, view)) in clients.iter_mut().zip(&before) {
        client.say(json!({ "do": "view", "view": view }));
        while client.exact().png != picture.png {}
    }
    assert!(Client::connect(&server).exact().png == before[1].0.png, "a new client sees the first view");
}
