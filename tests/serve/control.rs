//! What a client can do with the viewer.

use image::RgbImage;
use serde_json::{Value, json};
use smalto::formats::{SceneFile, write_file};
use smalto::procedural::cactus;

use crate::client::{Client, Heard};
use crate::server::Server;

fn knob(client: &Client, name: &str) -> String {
    let knobs = client.welcome["knobs"].as_array().unwrap();
    let place = knobs.iter().position(|knob| knob["name"] == name).unwrap();
    client.state["knobs"][place].as_str().unwrap().to_owned()
}

#[test]
fn options_can_be_set_and_undone() {
    let server = Server::start(&["cactus:2000"]);
    let mut client = Client::connect(&server);
    let before = client.exact();
    client.until(|state| state["preset"] == "balanced");
    client.say(json!({ "do": "preset", "name": "preview" }));
    client.until(|state| state["preset"] == "preview");
    client.exact();
    client.say(json!({ "do": "set", "knob": "sh-degree", "value": "0" }));
    client.until(|state| state["preset"].is_null());
    assert_eq!(knob(&client, "sh-degree"), "0");
    client.exact();
    for _ in 0..2 {
        client.say(json!({ "do": "act", "action": "undo" }));
        client.exact();
    }
    client.until(|state| state["preset"] == "balanced");
    client.say(json!({ "do": "view", "view": client.state["rest"]["view"] }));
    client.say(json!({ "do": "resize", "size": [64, 64] }));
    client.exact();
    client.say(json!({ "do": "resize", "size": crate::client::SIZE }));
    assert!(client.exact().png == before.png, "what was undone leaves nothing");
    for (message, why) in [
        (json!({ "do": "set", "knob": "sh-degree", "value": "9" }), "0 to 4"),
        (json!({ "do": "set", "knob": "nonsense", "value": "9" }), "no knob"),
        (json!({ "do": "set", "knob": "order", "value": "per-pixel" }), "order"),
        (json!({ "do": "preset", "name": "best" }), "no preset"),
        (json!({ "do": "look", "name": "nonsense", "range": null }), "no view mode"),
        (json!({ "do": "look", "name": "depth", "range": [1, 0] }), "below"),
        (json!({ "do": "camera", "index": 5 }), "no camera 5"),
        (json!({ "do": "view", "view": { "position": "nowhere" } }), "no view"),
        (json!({ "do": "act", "action": "quit" }), "no action"),
        (json!({ "do": "act", "action": "screenshot" }), "no action"),
        (json!({ "do": "explain", "pixel": [1_000_000, 0] }), "no pixel"),
        (json!({ "do": "show", "scene": 7, "is_shown": true }), "no scene"),
        (json!({ "do": "place", "scene": 1, "placement": placed(0.0, 1.0) }), "no scene 1"),
        (json!({ "do": "place", "scene": 0, "placement": placed(0.0, 0.0) }), "the scale 0.0"),
        (json!({ "do": "place", "scene": 0, "placement": placed(1e300, 1.0) }), "the position"),
        (json!({ "do": "hello", "size": [1, 1] }), "not for the viewer"),
    ] {
        client.say(message.clone());
        let told = client.told("refused");
        assert!(told["why"].as_str().unwrap().contains(why), "{message}: {told}");
    }
}

fn placed(x: f64, scale: f64) -> Value {
    json!({ "position": [x, 0.0, 0.0], "rotation": [0.0, 0.0, 0.0], "scale": scale })
}

/// A scene that moves to the right is seen as by a camera that moves to the left.
#[test]
fn a_scene_can_be_placed() {
    let server = Server::start(&["cactus:2000"]);
    let mut client = Client::connect(&server);
    let first = client.exact();
    let view = client.until(|state| !state["rest"].is_null())["rest"]["view"].clone();
    client.say(json!({ "do": "place", "scene": 0, "placement": placed(0.5, 1.0) }));
    let moved = client.exact();
    assert!(!moved.is_of_render);
    let state = client.until(|state| state["scenes"][0]["placement"] == placed(0.5, 1.0) && !state["rest"].is_null());
    assert!(state["rest"]["left_out"].to_string().contains("placement"));
    client.say(json!({ "do": "act", "action": "undo" }));
    assert!(client.exact().png == first.png);
    let mut beside = view;
    beside["position"][0] = json!(beside["position"][0].as_f64().unwrap() - 0.5);
    client.say(json!({ "do": "view", "view": beside }));
    let seen = client.exact();
    let differing = |other: &RgbImage| {
        let pairs = moved.pixels.iter().zip(other.iter());
        pairs.filter(|(a, b)| a.abs_diff(**b) > 1).count()
    };
    assert_eq!(differing(&seen.pixels), 0);
    assert!(differing(&first.pixels) > 1000);
}

#[test]
fn keys_fly_while_they_are_held() {
    let server = Server::start(&["cactus:2000"]);
    let mut client = Client::connect(&server);
    let first = client.exact();
    let forward = |is_pressed: bool| json!([{ "kind": "key", "action": "forward", "is_pressed": is_pressed }]);
    assert_eq!(first.answered, 0);
    client.input(forward(true));
    let moving: Vec<_> = (0..4).map(|_| client.compressed()).collect();
    assert!(moving.windows(2).all(|two| two[0].number < two[1].number && two[0].pixels != two[1].pixels));
    client.input(forward(false));
    let rest = client.exact();
    assert_eq!(rest.answered, 2);
    assert!(rest.pixels != first.pixels);
    // A client that loses the keyboard releases all keys.
    client.input(forward(true));
    client.compressed();
    client.input(json!([{ "kind": "blur" }]));
    client.exact();
}

#[test]
fn looks_comparisons_and_pixels_are_shown() {
    let server = Server::start(&["cactus:2000"]);
    let mut client = Client::connect(&server);
    let colours = client.exact();
    client.say(json!({ "do": "look", "name": "depth", "range": [0.5, 20.0] }));
    assert!(client.exact().pixels != colours.pixels);
    client.until(|state| state["look"] == "depth" && state["range"] == json!([0.5, 20.0]));
    client.say(json!({ "do": "look", "name": "colour", "range": null }));
    assert!(client.exact().pixels == colours.pixels);
    let centre = crate::client::SIZE.map(|side| side / 2);
    client.say(json!({ "do": "explain", "pixel": centre }));
    let explanation = client.until(|state| !state["explanation"].is_null())["explanation"].clone();
    assert_eq!(explanation["pixel"], json!(centre));
    let shares =
        |list: &Value| list.as_array().unwrap().iter().map(|splat| splat["share"].as_f64().unwrap()).sum::<f64>();
    let light = shares(&explanation["first"]) + explanation["transmittance"].as_f64().unwrap();
    let is_whole = explanation["splats"].as_u64().unwrap() <= 100;
    assert!(!is_whole || (light - 1.0).abs() < 0.01, "{explanation}");
    client.say(json!({ "do": "act", "action": "escape" }));
    client.until(|state| state["explanation"].is_null());
    client.say(json!({ "do": "compare", "with": "preview" }));
    let compared = client.until(|state| state["comparison"]["psnr"].is_f64())["comparison"].clone();
    assert_eq!(compared["second"], "preview");
    assert!((15.0..80.0).contains(&compared["psnr"].as_f64().unwrap()), "{compared}");
    client.say(json!({ "do": "compare-by", "mode": "difference", "split": null, "gain": 10 }));
    client.until(|state| state["comparison"]["mode"] == "difference");
    // The second is refused, unless the first reference is drawn before it comes.
    let refused = loop {
        (0..2).for_each(|_| client.say(json!({ "do": "compare", "with": "reference" })));
        client.say(json!({ "do": "rest", "number": 1 }));
        let answer = loop {
            match client.hear() {
                Heard::Text(text) if text["say"] == "refused" || text["say"] == "rests" => break text,
                Heard::End(why) => panic!("{why}"),
                _ => {}
            }
        };
        if answer["say"] == "refused" {
            break answer;
        }
    };
    assert!(refused["why"].as_str().unwrap().contains("drawn"));
    let compared = client
        .until(|state| state["comparison"]["second"] == "float64 reference" && state["comparison"]["psnr"].is_f64());
    assert!(compared["comparison"]["psnr"].as_f64().unwrap() > 45.0, "{compared}");
    // A reference that is withdrawn is dropped when it comes. Until then another one is refused.
    for number in 10.. {
        client.said.remove("refused");
        client.say(json!({ "do": "compare", "with": "reference" }));
        client.say(json!({ "do": "compare", "with": "preview" }));
        client.say(json!({ "do": "rest", "number": number }));
        let state = loop {
            let rests = client.told("rests");
            if rests["number"] == number {
                break rests["state"].clone();
            }
        };
        assert_eq!(state["comparison"]["second"], "preview");
        if number > 10 && !client.said.contains_key("refused") {
            break;
        }
    }
    client.say(json!({ "do": "compare", "with": "nothing" }));
    client.until(|state| state["comparison"].is_null());
}

#[test]
fn a_file_that_changes_is_read_once_for_all() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("training.ply");
    let write = |count: usize| {
        let gaussians = cactus(count).unwrap().gaussians;
        write_file(&file, SceneFile::of(&file).unwrap(), &gaussians, false, &|_| {}).unwrap();
    };
    write(500);
    let server = Server::start(&[file.to_str().unwrap(), "--follow"]);
    let mut clients = [Client::connect(&server), Client::connect(&server)];
    let has = |state: &Value, count: usize| {
        let summary = state["scenes"][0]["summary"].as_str().unwrap_or("");
        summary.contains(&format!("{count} Gaussians")) && !state["rest"].is_null()
    };
    let before = clients.each_mut().map(Client::exact);
    let turned = json!([{ "kind": "move", "x": 10, "y": 10 }, { "kind": "wheel", "points": 200 }]);
    clients[1].input(turned);
    clients[1].exact();
    let views = clients.each_mut().map(|client| client.until(|state| has(state, 500))["rest"]["view"].clone());
    write(900);
    for (client, view) in clients.iter_mut().zip(&views) {
        client.until(|state| has(state, 900));
        assert_eq!(client.state["rest"]["view"], *view, "the view stays");
    }
    let after = Client::connect(&server).exact();
    assert!(after.png != before[0].png, "a new client gets the new scene");
    assert_ne!(views[0], views[1]);
    std::fs::write(&file, "nothing").unwrap();
    for client in &mut clients {
        let said = |state: &Value| state["messages"].to_string().contains("the scene before it stays");
        client.until(said);
        assert!(has(&client.state, 900), "{}", client.state);
    }
    write(700);
    clients.iter_mut().for_each(|client| drop(client.until(|state| has(state, 700))));
}
