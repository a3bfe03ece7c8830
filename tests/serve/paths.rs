//! Camera paths, films, measures and photographs.

use std::time::Duration;

use serde_json::{Value, json};

use crate::client::{Client, SIZE};
use crate::server::Server;

/// Waits until all that was asked for is done and shown.
fn rest(client: &mut Client, number: u32) -> Value {
    client.say(json!({ "do": "rest", "number": number }));
    loop {
        let rests = client.told("rests");
        if rests["number"] == number {
            return rests["state"].clone();
        }
    }
}

fn refused(client: &mut Client, message: Value) -> String {
    client.say(message);
    client.told("refused")["why"].as_str().unwrap().to_owned()
}

#[test]
fn a_path_is_changed_played_and_written_as_a_film() {
    let folder = tempfile::tempdir().unwrap();
    let server = Server::with_ffmpeg(&["cactus:2000"], folder.path());
    let mut client = Client::connect(&server);
    assert_eq!(client.welcome["has_films"], true);
    client.exact();
    assert!(refused(&mut client, json!({ "do": "film", "fps": 30 })).contains("0 frames"));
    client.say(json!({ "do": "turn" }));
    let turn = client.told("path")["keys"].clone();
    assert_eq!(turn.as_array().unwrap().len(), 17);
    client.say(json!({ "do": "time", "seconds": 4 }));
    let state = rest(&mut client, 1);
    assert_eq!((state["time"].as_f64(), state["is_playing"].as_bool()), (Some(4.0), Some(false)));
    // What the server gives can be given back, also without some keys.
    client.say(json!({ "do": "path", "keys": [turn[0], turn[2]] }));
    let path = client.told("path")["keys"].clone();
    assert_eq!(path[1]["position"], turn[2]["position"]);
    for (action, keys) in [("undo", 17), ("redo", 2)] {
        rest(&mut client, keys as u32);
        client.say(json!({ "do": "act", "action": action }));
        assert_eq!(client.told("path")["keys"].as_array().unwrap().len(), keys);
    }
    client.say(json!({ "do": "close-path" }));
    let closed = client.told("path")["keys"].clone();
    assert_eq!((closed.as_array().unwrap().len(), &closed[2]["position"]), (3, &turn[0]["position"]));
    assert!(refused(&mut client, json!({ "do": "close-path" })).contains("several views"));
    client.say(json!({ "do": "act", "action": "undo" }));
    assert_eq!(client.told("path")["keys"].as_array().unwrap().len(), 2);
    assert!(refused(&mut client, json!({ "do": "path", "keys": [turn[0], turn[0]] })).contains("no camera path"));
    let many: Vec<Value> = (0..101)
        .map(|i| {
            json!({ "position": [i, 0, 0], "rotation": turn[0]["rotation"],
        "width": 8, "height": 8, "fx": 8, "fy": 8 })
        })
        .collect();
    assert!(refused(&mut client, json!({ "do": "path", "keys": many })).contains("100 keys"));
    // The path is played to its end.
    client.say(json!({ "do": "time", "seconds": 3.9 }));
    client.say(json!({ "do": "act", "action": "play" }));
    client.until(|state| state["time"] == 4.0 && state["is_playing"] == false);
    // The film has its frames, in the size of pictures.
    for (fps, why) in [(0, "1 to 240"), (239, ""), (1_000_000, "1 to 240")] {
        if !why.is_empty() {
            assert!(refused(&mut client, json!({ "do": "film", "fps": fps })).contains(why));
        }
    }
    assert!(refused(&mut client, json!({ "do": "film", "fps": 2, "file": "a.mp4" })).contains("no file name"));
    client.say(json!({ "do": "film", "fps": 2 }));
    let film = format!("/{}", client.told("film")["file"].as_str().unwrap());
    let (status, text) = server.request(&film, "Host: localhost\r\n");
    assert_eq!((status, text.contains("video/mp4")), (200, true), "{text}");
    let bytes = 9 * 3 * SIZE[0] * SIZE[1];
    assert!(text.trim().ends_with(&bytes.to_string()), "9 frames have {bytes} bytes: {text}");
    assert_eq!(server.request("/film/0123", "Host: localhost\r\n").0, 404);
    assert_eq!(server.request(&film, "Host: localhost\r\nOrigin: http://evil\r\n").0, 403);
    client.say(json!({ "do": "path", "keys": [] }));
    assert_eq!(client.told("path")["keys"], json!([]));
    // The film goes with its client.
    drop(client);
    while server.request(&film, "Host: localhost\r\n").0 != 404 {
        std::thread::sleep(Duration::from_millis(20));
    }
}

#[test]
fn one_film_is_written_at_a_time_and_can_be_stopped() {
    let folder = tempfile::tempdir().unwrap();
    let server = Server::with_ffmpeg(&["cactus:2000"], folder.path());
    let [mut client, mut other] = [Client::connect(&server), Client::connect(&server)];
    for client in [&mut client, &mut other] {
        client.exact();
        client.say(json!({ "do": "turn" }));
        client.told("path");
    }
    // Thousands of frames are not written before the others are asked.
    client.say(json!({ "do": "film", "fps": 200 }));
    client.until(|state| !state["writing"].is_null());
    assert!(refused(&mut other, json!({ "do": "film", "fps": 30 })).contains("is being written"));
    assert!(refused(&mut client, json!({ "do": "film", "fps": 30 })).contains("is being written"));
    // The picture at rest does not wait for the film.
    client.say(json!({ "do": "resize", "size": [64, 64] }));
    assert_eq!(client.exact().size, [64, 64]);
    client.say(json!({ "do": "stop-film" }));
    let state = rest(&mut client, 7);
    assert!(state["messages"].to_string().contains("pictures"), "{}", state["messages"]);
    assert!(!client.said.contains_key("film"));
    other.say(json!({ "do": "film", "fps": 1 }));
    other.told("film");
}

#[test]
fn points_are_measured() {
    let server = Server::start(&["cactus:20000"]);
    let mut client = Client::connect(&server);
    client.exact();
    let (x, y) = (SIZE[0] / 2, SIZE[1] / 2);
    client.say(json!({ "do": "mark", "pixel": [x, y] }));
    client.say(json!({ "do": "mark", "pixel": [x, y + 12] }));
    let state = rest(&mut client, 1);
    let measure = &state["measures"][0];
    assert_eq!((measure["points"].as_array().unwrap().len(), measure["is_open"].as_bool()), (2, Some(true)));
    let points: Vec<Vec<f64>> = serde_json::from_value(measure["points"].clone()).unwrap();
    let length = points[0].iter().zip(&points[1]).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt();
    let reading: f64 = measure["reading"].as_str().unwrap().parse().unwrap();
    assert!((reading - length).abs() < 1e-3 * length, "{reading} {length}");
    let pixel = &measure["pixels"][1];
    assert!((pixel[0].as_f64().unwrap() - f64::from(x) - 0.5).abs() < 0.01, "{pixel}");
    assert!((pixel[1].as_f64().unwrap() - f64::from(y + 12) - 0.5).abs() < 0.01, "{pixel}");
    // The line lies between its points, and its length is written in the middle.
    let [line] = &serde_json::from_value::<Vec<[[f64; 2]; 2]>>(measure["lines"].clone()).unwrap()[..] else {
        panic!("{measure}")
    };
    let label = &measure["labels"][0];
    assert_eq!((json!(line[0]), json!(line[1])), (measure["pixels"][0].clone(), pixel.clone()));
    assert_eq!(label["text"], measure["reading"]);
    assert!((label["pixel"][1].as_f64().unwrap() - (line[0][1] + line[1][1]) / 2.0).abs() < 1.0, "{label}");
    let said = state["messages"].to_string();
    assert!(said.contains("marked: ") && !said.contains("copied"), "{said}");
    // A unit, another kind, and nothing again.
    client.say(json!({ "do": "unit", "name": " m", "length": 2 }));
    client.say(json!({ "do": "measure", "kind": "area" }));
    let state = rest(&mut client, 2);
    assert_eq!((&state["measures"][0]["reading"], &state["measures_next"]), (&json!("2.0000 m"), &json!("area")));
    client.say(json!({ "do": "act", "action": "escape" }));
    assert!(refused(&mut client, json!({ "do": "unit", "name": "m", "length": 2 })).contains("two points"));
    let wrong = json!({ "do": "measures", "measures": { "unit": { "name": "m", "per_world": 0 } } });
    assert!(refused(&mut client, wrong).contains("unit of length"));
    assert!(refused(&mut client, json!({ "do": "unit", "name": "m", "length": 0 })).contains("length of a line"));
    client.say(json!({ "do": "act", "action": "undo" }));
    assert_eq!(rest(&mut client, 3)["measures"].as_array().unwrap().len(), 1);
    client.say(json!({ "do": "measures", "measures": {} }));
    assert_eq!(rest(&mut client, 4)["measures"], json!([]));
    assert!(refused(&mut client, json!({ "do": "picture", "file": "a.png" })).contains("not for the viewer"));
}

#[test]
fn a_view_is_compared_with_its_photograph() {
    let folder = tempfile::tempdir().unwrap();
    let images = folder.path().join("images");
    std::fs::create_dir(&images).unwrap();
    let cameras = folder.path().join("cameras.json");
    let camera = |i: i32, name: &str| {
        json!({ "id": i, "img_name": name, "width": 64, "height": 48,
        "position": [0.0, 0.0, f64::from(-6 - i)], "rotation": [[1, 0, 0], [0, 1, 0], [0, 0, 1]], "fx": 50, "fy": 50 })
    };
    std::fs::write(&cameras, json!([camera(0, "left"), camera(1, "right")]).to_string()).unwrap();
    image::RgbImage::from_pixel(64, 48, image::Rgb([200, 40, 20])).save(images.join("right.png")).unwrap();
    let server = Server::start(&["cactus:2000"]);
    let mut client = Client::connect(&server);
    client.exact();
    assert!(refused(&mut client, json!({ "do": "compare", "with": "photographs" })).contains("no camera has"));
    let server = Server::start(&["cactus:2000", "--cameras", cameras.to_str().unwrap()]);
    let mut client = Client::connect(&server);
    client.exact();
    client.until(|state| state["has_photographs"] == true);
    client.say(json!({ "do": "compare", "with": "photographs" }));
    client.until(|state| state["comparison"]["psnr"].is_f64());
    assert_eq!((&client.state["comparison"]["second"], &client.state["camera"]), (&json!("right.png"), &json!(1)));
    let picture = client.exact();
    assert_eq!(picture.pixels.get_pixel(SIZE[0] - 30, SIZE[1] / 2).0, [200, 40, 20], "the photograph is on the right");
}

/// Options are chosen within a budget as in the window, one choice at a time; what cannot be is refused. The choice
/// itself is tested in the window, since it takes long.
#[test]
fn options_are_chosen_by_a_budget() {
    let server = Server::start(&["cactus:300"]);
    let mut client = Client::connect(&server);
    client.exact();
    for (budget, why) in [
        (json!({ "max-error": 0 }), "from 0.00001 to 1"),
        (json!({ "min-psnr": 400 }), "from 20 to 120"),
        (json!({ "min-psnr": null }), "no message"),
        (json!({}), "no message"),
    ] {
        let said = refused(&mut client, json!({ "do": "budget", "budget": budget }));
        assert!(said.contains(why), "{budget}: {said}");
    }
    // One that is stopped changes nothing, and is not in the way of another.
    client.say(json!({ "do": "preset", "name": "exact" }));
    client.until(|state| state["preset"] == "exact");
    client.say(json!({ "do": "budget", "budget": { "max-error": 0.2 } }));
    client.until(|state| state["choosing"].is_number());
    assert!(refused(&mut client, json!({ "do": "budget", "budget": { "max-error": 0.1 } })).contains("chosen"));
    client.say(json!({ "do": "stop-budget" }));
    let state = client.until(|state| state["choosing"].is_null());
    // It may have been done before.
    assert!(state["preset"] == "exact" || state["chosen"].is_string(), "{state}");
    client.say(json!({ "do": "budget", "budget": { "max-error": 0.3 } }));
    client.until(|state| state["choosing"].is_number());
}
