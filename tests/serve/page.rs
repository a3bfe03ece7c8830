//! The web page in a browser, driven by its own protocol.

use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use base64::Engine;
use serde_json::{Value, json};
use tungstenite::{Message, WebSocket};

use crate::server::Server;

/// Time within which a page of a busy machine does something.
const PATIENCE: Duration = Duration::from_secs(120);

/// A browser with one page.
pub struct Browser {
    child: Child,
    socket: WebSocket<TcpStream>,
    last: u64,
    _profile: tempfile::TempDir,
}

impl Browser {
    /// Opens a page in Chromium.
    pub fn open(url: &str, size: [u32; 2]) -> Self {
        let profile = tempfile::tempdir().unwrap();
        let mut command = Command::new("chromium");
        command.args(["--headless", "--no-sandbox", "--disable-gpu", "--hide-scrollbars", "--remote-debugging-port=0"]);
        command.arg(format!("--user-data-dir={}", profile.path().display())).arg(url);
        let child = command.stdout(Stdio::null()).stderr(Stdio::null()).spawn();
        let child = child.unwrap_or_else(|e| panic!("chromium does not start: {e}. Run ./setup.sh"));
        let started = Instant::now();
        let address = loop {
            assert!(started.elapsed() < PATIENCE, "the browser does not start");
            let file = std::fs::read_to_string(profile.path().join("DevToolsActivePort")).unwrap_or_default();
            match file.lines().next().filter(|port| !port.is_empty()) {
                Some(port) => break format!("localhost:{port}"),
                None => std::thread::sleep(Duration::from_millis(20)),
            }
        };
        let address = address.as_str();
        // The browser lists its pages; the newest may not be there yet.
        let socket = loop {
            let list = get(address, "/json");
            let pages: Value = serde_json::from_str(&list).unwrap();
            let page = pages.as_array().unwrap().iter().find(|page| page["type"] == "page").cloned();
            if let Some(page) = page {
                let stream = TcpStream::connect(address).unwrap();
                stream.set_read_timeout(Some(PATIENCE)).unwrap();
                break tungstenite::client(page["webSocketDebuggerUrl"].as_str().unwrap(), stream).unwrap().0;
            }
        };
        let mut browser = Self { child, socket, last: 0, _profile: profile };
        browser.resize(size);
        browser
    }

    fn call(&mut self, method: &str, params: Value) -> Value {
        self.answer(method, params).unwrap_or_else(|problem| panic!("{method}: {problem}"))
    }

    /// The result of a command of the protocol, or its error.
    fn answer(&mut self, method: &str, params: Value) -> Result<Value, Value> {
        self.last += 1;
        let text = json!({ "id": self.last, "method": method, "params": params }).to_string();
        self.socket.send(Message::Text(text.into())).unwrap();
        loop {
            let Message::Text(text) = self.socket.read().unwrap() else { continue };
            let answer: Value = serde_json::from_str(&text).unwrap();
            if answer["id"] == self.last {
                return if answer["error"].is_null() { Ok(answer["result"].clone()) } else { Err(answer) };
            }
        }
    }

    /// The value of an expression of the page.
    pub fn value(&mut self, expression: &str) -> Value {
        let params = json!({ "expression": expression, "awaitPromise": true, "returnByValue": true });
        let result = self.call("Runtime.evaluate", params);
        assert!(result["exceptionDetails"].is_null(), "{expression}: {result}");
        result["result"]["value"].clone()
    }

    /// Waits until an expression is true, also while the page is loaded again.
    pub fn until(&mut self, expression: &str) {
        let started = Instant::now();
        let asked = format!("(() => {{ try {{ return !!({expression}); }} catch (_) {{ return false; }} }})()");
        loop {
            let params = json!({ "expression": asked, "returnByValue": true });
            match self.answer("Runtime.evaluate", params) {
                Ok(result) if result["result"]["value"] == true => return,
                _ => std::thread::sleep(Duration::from_millis(20)),
            }
            assert!(started.elapsed() < PATIENCE, "{expression}");
        }
    }

    /// Gives the page another size.
    fn resize(&mut self, [width, height]: [u32; 2]) {
        let params = json!({ "width": width, "height": height, "deviceScaleFactor": 1, "mobile": false });
        self.call("Emulation.setDeviceMetricsOverride", params);
    }

    fn mouse(&mut self, kind: &str, [x, y]: [f64; 2], button: &str) {
        let pressed = i32::from(button == "left" && kind != "mouseReleased");
        let params = json!({ "type": kind, "x": x, "y": y, "button": button, "buttons": pressed, "clickCount": 1 });
        self.call("Input.dispatchMouseEvent", params);
    }

    /// Presses or releases a key: `keyDown` or `keyUp`.
    fn key(&mut self, kind: &str, key: &str) {
        let text = if kind == "keyDown" && key.len() == 1 { key } else { "" };
        self.call("Input.dispatchKeyEvent", json!({ "type": kind, "key": key, "text": text }));
    }

    /// Loads the page again, and waits for the new one.
    fn reload(&mut self) {
        self.value("window.isOld = true");
        self.call("Page.reload", json!({}));
        self.until("!window.isOld && typeof canvas === 'object'");
    }

    /// The picture of the page as PNG; in the folder of `SMALTO_SCREENS`, if that is set.
    pub fn screenshot(&mut self, name: &str) -> Vec<u8> {
        let result = self.call("Page.captureScreenshot", json!({ "format": "png" }));
        let file = base64::engine::general_purpose::STANDARD.decode(result["data"].as_str().unwrap()).unwrap();
        if let Some(folder) = std::env::var_os("SMALTO_SCREENS") {
            std::fs::write(std::path::Path::new(&folder).join(name), &file).unwrap();
        }
        file
    }
}

impl Drop for Browser {
    fn drop(&mut self) {
        _ = self.child.kill();
        _ = self.child.wait();
    }
}

/// The text that an address answers with. The browser keeps the connection open.
fn get(address: &str, path: &str) -> String {
    let mut stream = TcpStream::connect(address).unwrap();
    write!(stream, "GET {path} HTTP/1.1\r\nHost: {address}\r\n\r\n").unwrap();
    let (mut reader, mut length) = (BufReader::new(stream), 0);
    loop {
        let mut line = String::new();
        reader.read_line(&mut line).unwrap();
        match line.trim().to_lowercase().split_once(':') {
            Some(("content-length", value)) => length = value.trim().parse().unwrap(),
            None if line.trim().is_empty() => break,
            _ => {}
        }
    }
    let mut text = vec![0; length];
    reader.read_exact(&mut text).unwrap();
    String::from_utf8(text).unwrap()
}

const EXACT: &str = "document.body.dataset.picture === 'exact'";
/// A number that every other picture changes.
const SUM: &str = "(() => { const p = context.getImageData(0, 0, canvas.width, canvas.height).data; \
                   let sum = 0; for (let i = 0; i < p.length; i++) sum = (sum * 31 + p[i]) % 1000003; return sum; })()";

#[test]
fn a_page_shows_and_moves_a_scene() {
    let programs = tempfile::tempdir().unwrap();
    let mut server = Server::with_ffmpeg(&["cactus:2000", "--token"], programs.path());
    let mut page = Browser::open(&server.url(), [900, 560]);
    page.until(&format!("{EXACT} && canvas.height === 560"));
    assert_eq!(page.value("kept.get('token')"), json!(server.token));
    let size = page.value("[canvas.width, canvas.height]");
    assert_eq!(size, json!([560, 560]));
    let first = page.value(SUM);
    // The picture is the file of `smalto render`.
    let file = page.value(
        "exact.file.arrayBuffer().then((bytes) => \
         btoa(Array.from(new Uint8Array(bytes), (byte) => String.fromCharCode(byte)).join('')))",
    );
    let file = base64::engine::general_purpose::STANDARD.decode(file.as_str().unwrap()).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let out = crate::common::program::path(&folder, "view.png");
    let command = page.value("state.rest.command").as_str().unwrap().replace('\'', "");
    let words: Vec<_> = command.split(' ').skip(1).map(|word| if word == "view.png" { &out } else { word }).collect();
    crate::common::program::ok(&words);
    assert!(std::fs::read(&out).unwrap() == file, "{command}");
    page.screenshot("serve.png");
    // A drag turns the view, undo turns it back, and a wheel comes nearer.
    page.mouse("mousePressed", [200.0, 200.0], "left");
    page.mouse("mouseMoved", [260.0, 230.0], "left");
    page.mouse("mouseReleased", [260.0, 230.0], "left");
    page.until(&format!("{EXACT} && {SUM} !== {first}"));
    let turned = page.value(SUM);
    page.value("document.querySelector('[data-act=undo]').click()");
    page.until(&format!("{EXACT} && {SUM} === {first}"));
    page.call(
        "Input.dispatchMouseEvent",
        json!({ "type": "mouseWheel", "x": 200, "y": 200, "deltaX": 0, "deltaY": -200 }),
    );
    page.until(&format!("{EXACT} && {SUM} !== {first} && {SUM} !== {turned}"));
    // Keys fly, and explain a pixel.
    page.value("canvas.focus()");
    let before = page.value("drawn");
    page.key("keyDown", "w");
    page.until(&format!("drawn > {before} + 3"));
    page.key("keyUp", "w");
    page.until(EXACT);
    page.mouse("mouseMoved", [280.0, 280.0], "none");
    page.key("keyDown", "x");
    page.key("keyUp", "x");
    page.until("state.explanation && document.querySelectorAll('#explained tbody tr').length > 0");
    page.screenshot("serve-pixel.png");
    // A comparison, and a view mode.
    page.value("at('with').value = 'preview'; at('with').dispatchEvent(new Event('change'))");
    page.until("at('compared').textContent.includes('dB')");
    page.screenshot("serve-compare.png");
    page.value("at('with').value = 'nothing'; at('with').dispatchEvent(new Event('change'))");
    page.value("at('look').value = 'depth'; at('look').dispatchEvent(new Event('change'))");
    page.until(&format!("state.look === 'depth' && {EXACT}"));
    page.screenshot("serve-depth.png");
    page.value("at('look').value = 'colour'; at('look').dispatchEvent(new Event('change'))");
    page.value("canvas.focus()");
    page.key("keyDown", "Escape");
    // Points are measured, and a path is made, changed, and written as a film.
    page.key("keyDown", "m");
    page.until("state.measures.length === 1");
    page.mouse("mouseMoved", [280.0, 240.0], "none");
    page.key("keyDown", "m");
    page.until(
        "document.querySelectorAll('#lines circle').length === 2 && at('measures').textContent.includes('distance')",
    );
    page.value("at('length').value = '2'; at('unit-name').value = 'cm'; at('set-unit').click()");
    page.until("at('lines').querySelector('text')?.textContent === '2.0000 cm'");
    page.value("at('turn').click()");
    page.until("at('path-keys').rows.length === 17");
    page.value("at('path-keys').rows[1].querySelector('[aria-label^=remove]').click()");
    page.until("at('path-keys').rows.length === 16 && path[1].seconds === 4");
    let seconds = "at('path-keys').rows[1].querySelector('[type=number]')";
    page.value(&format!("{seconds}.value = '6'; {seconds}.dispatchEvent(new Event('change'))"));
    page.until(&format!("at('notice').textContent.includes('no camera path') && {seconds}.value === '4'"));
    page.value("at('fps').value = '1'; at('film').click()");
    page.until("!at('film-ready').hidden && at('film-file').href.includes('/film/')");
    page.value("at('film-ready').scrollIntoView()");
    page.screenshot("serve-path.png");
    page.value("at('path-keys').rows[0].querySelector('[aria-label^=show]').click()");
    // The view is in the address, so that it outlives the page and the server.
    page.until(&format!("{EXACT} && state.look === 'colour' && state.comparison === null && !state.explanation"));
    let (view, sum) = (page.value("location.hash"), page.value(SUM));
    assert!(view.as_str().unwrap().contains("view=") && !view.as_str().unwrap().contains("token"));
    page.reload();
    page.until(&format!("{EXACT} && {SUM} === {sum}"));
    page.until("path.length === 16 && state.measures.length === 1");
    let port = server.port;
    drop(server);
    page.until("at('what').textContent === 'not connected'");
    page.screenshot("serve-lost.png");
    server = Server::start_at(port, &["cactus:2000"]);
    page.until(&format!("at('what').textContent !== 'not connected' && {EXACT} && {SUM} === {sum}"));
    // A narrow page has its panel below.
    page.resize([320, 640]);
    page.until(&format!("canvas.width === 320 && {EXACT}"));
    page.screenshot("serve-narrow.png");
    assert_eq!(page.value("document.documentElement.scrollWidth <= 320"), true);
    // A scene is placed, also after a reload.
    page.resize([900, 560]);
    let turn = "document.querySelector('[aria-label^=\"Rotation y\"]')";
    let scale = "document.querySelector('[aria-label^=\"Scale\"]')";
    page.value(&format!("{turn}.value = '30'; {turn}.dispatchEvent(new Event('change'))"));
    let is_placed = format!("state.scenes[0].placement.rotation[1] === 30 && canvas.width === 560 && {EXACT}");
    page.until(&is_placed);
    assert_eq!(page.value("exact.isOfRender"), false);
    let sum = page.value(SUM);
    page.value(&format!("{turn}.closest('details').open = true"));
    page.screenshot("serve-placed.png");
    page.reload();
    page.until(&format!("state && {is_placed} && {SUM} === {sum} && {turn}.value === '30'"));
    // An emptied field and a refused one get their values back.
    for wrong in ["''", "'-1'"] {
        page.value(&format!("{scale}.focus(); {scale}.value = {wrong}; {scale}.dispatchEvent(new Event('change'))"));
        page.until(&format!("{scale}.value === '1'"));
    }
    assert_eq!(page.value(&format!("{turn}.value")), json!("30"));
    assert!(server.is_running());
}
