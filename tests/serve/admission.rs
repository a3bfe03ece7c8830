//! Who may connect, and what may be opened.

use serde_json::json;

use crate::client::Client;
use crate::common::program::{fails, ok, path};
use crate::server::Server;

const UPGRADE: &str = "Connection: Upgrade\r\nUpgrade: websocket\r\nSec-WebSocket-Version: 13\r\n\
                       Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n";

#[test]
fn sites_of_others_are_refused() {
    let server = Server::start(&["cactus:200"]);
    let own = format!("Host: localhost:{}\r\n", server.port);
    for file in ["/", "/page.js", "/page.css"] {
        let (status, text) = server.request(file, &own);
        assert_eq!(status, 200, "{file}");
        for header in ["content-security-policy: default-src 'none'", "nosniff", "no-store"] {
            assert!(text.to_lowercase().contains(header), "{file} {header}");
        }
    }
    assert_eq!(server.request("/../Cargo.toml", &own).0, 404);
    assert_eq!(server.request("/socket", &format!("{own}{UPGRADE}")).0, 101);
    for headers in [
        "Host: evil.example\r\n".to_owned(),
        format!("{own}Origin: http://evil.example\r\n"),
        format!("{own}Origin: null\r\n"),
    ] {
        for file in ["/", "/socket"] {
            assert_eq!(server.request(file, &format!("{headers}{UPGRADE}")).0, 403, "{file} {headers}");
        }
    }
}

#[test]
fn a_token_is_asked_for_where_others_can_connect() {
    for options in [&["cactus:200", "--host", "0.0.0.0"][..], &["cactus:200", "--token"]] {
        let server = Server::start(options);
        let token = server.token.clone().expect("a token");
        for wrong in [json!(null), json!(""), json!(&token[1..])] {
            let mut socket = crate::client::socket(&server);
            let hello = json!({ "do": "hello", "token": wrong, "size": [64, 64], "view": null });
            socket.send(tungstenite::Message::Text(hello.to_string().into())).unwrap();
            let answer = socket.read().unwrap();
            assert!(matches!(&answer, tungstenite::Message::Close(Some(frame)) if frame.reason.contains("token")));
        }
        Client::connect(&server).exact();
    }
    assert!(Server::start(&["cactus:200"]).token.is_none());
}

#[test]
fn files_are_opened_in_the_folder_alone() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::create_dir_all(folder.path().join("scenes/more")).unwrap();
    for name in ["secret.ply", "scenes/a.ply", "scenes/more/b.ply"] {
        ok(&["convert", "cactus:300", &path(&folder, name)]);
    }
    std::fs::write(folder.path().join("scenes/notes.txt"), "").unwrap();
    std::fs::write(folder.path().join("scenes/a.project.json"), "{}").unwrap();
    std::os::unix::fs::symlink("../secret.ply", folder.path().join("scenes/link.ply")).unwrap();
    let server = Server::start(&["cactus:200", "--folder", &path(&folder, "scenes")]);
    let mut client = Client::connect(&server);
    assert_eq!(client.welcome["has_folder"], true);
    client.say(json!({ "do": "files", "folder": "" }));
    let listed = client.told("files");
    assert_eq!(listed["folders"], json!(["more"]));
    assert_eq!(listed["files"], json!(["a.ply", "link.ply"]));
    for outside in ["../secret.ply", "link.ply", "/etc/passwd", "a.project.json", "notes.txt", "", "missing.ply"] {
        client.say(json!({ "do": "open", "file": outside }));
        let why = client.told("refused")["why"].as_str().unwrap().to_owned();
        assert!(!why.is_empty() && !why.contains("panicked"), "{outside}: {why}");
    }
    client.say(json!({ "do": "open", "file": "more/b.ply" }));
    let state = client.until(|state| state["scenes"].as_array().is_some_and(|scenes| scenes.len() == 2));
    assert_eq!(state["scenes"][1]["name"], "b.ply");
    // The others go on with their scenes.
    let mut other = Client::connect(&server);
    assert_eq!(other.until(|state| !state["rest"].is_null())["scenes"].as_array().unwrap().len(), 1);
    let server = Server::start(&["cactus:200"]);
    let mut without = Client::connect(&server);
    without.say(json!({ "do": "files", "folder": "" }));
    assert!(without.told("refused")["why"].as_str().unwrap().contains("--folder"));
}

#[test]
fn wrong_starts_are_one_sentence() {
    let folder = tempfile::tempdir().unwrap();
    let missing = path(&folder, "missing.ply");
    assert!(fails(4, &["serve", &missing, "--port", "0"]).contains("missing.ply"));
    assert!(fails(2, &["serve"]).contains("SCENES"));
    assert!(fails(2, &["serve", "cactus:200", "--folder", &missing]).contains("no such folder"));
    assert!(fails(2, &["serve", "cactus:nonsense"]).contains("cactus"));
    assert!(fails(2, &["serve", "cactus:200", "--proxy", "hub.example"]).contains("https://"));
    let server = Server::start(&["cactus:200"]);
    let taken = fails(1, &["serve", "cactus:200", "--port", &server.port.to_string()]);
    assert!(taken.contains("cannot listen on 127.0.0.1"), "{taken}");
}
