//! The web page through a proxy that hands it over from a folder of its own, as jupyter-server-proxy does.

use std::io::{BufRead, BufReader, Read, Write};
use std::net::{Shutdown, TcpListener, TcpStream};

use crate::page::Browser;
use crate::server::Server;

const FOLDER: &str = "/user/ann/proxy/7007/";

/// Answers a request: those below the folder by the server, others by a page that shows `url` in a frame.
fn answer(mut browser: TcpStream, server: u16, url: &str) -> std::io::Result<()> {
    let mut reader = BufReader::new(browser.try_clone()?);
    let mut first = String::new();
    reader.read_line(&mut first)?;
    if !first.contains(FOLDER) {
        let page = format!("<iframe src='{url}' width=600 height=500></iframe>");
        let length = page.len();
        let head = format!("HTTP/1.1 200 OK\r\nContent-Type: text/html\r\nContent-Length: {length}\r\n");
        return write!(browser, "{head}Connection: close\r\n\r\n{page}");
    }
    let mut server = TcpStream::connect(("127.0.0.1", server))?;
    server.write_all(first.replace(FOLDER, "/").as_bytes())?;
    let (mut to_server, mut from_server) = (server.try_clone()?, server);
    std::thread::spawn(move || {
        _ = copy(&mut reader, &mut to_server);
        _ = to_server.shutdown(Shutdown::Write);
    });
    copy(&mut from_server, &mut browser)
}

/// Copies bytes at once when they come.
fn copy(from: &mut impl Read, to: &mut impl Write) -> std::io::Result<()> {
    let mut bytes = [0; 1 << 14];
    loop {
        match from.read(&mut bytes)? {
            0 => return Ok(()),
            n => to.write_all(&bytes[..n])?,
        }
    }
}

#[test]
fn a_notebook_shows_the_page_through_a_proxy() {
    let proxy = TcpListener::bind("127.0.0.1:0").unwrap();
    // Browsers take names below localhost for this machine; the server has no such name.
    let hub = format!("http://hub.localhost:{}", proxy.local_addr().unwrap().port());
    let server = Server::start(&["cactus:400", "--proxy", &format!("{hub}{FOLDER}")]);
    let port = server.port;
    let token = server.token.clone().expect("others may reach the proxy");
    let url = format!("{hub}{FOLDER}#token={token}");
    std::thread::spawn(move || {
        for browser in proxy.incoming().flatten() {
            let url = url.clone();
            std::thread::spawn(move || _ = answer(browser, port, &url));
        }
    });
    let mut page = Browser::open(&format!("{hub}/"), [640, 540]);
    page.until("frames[0].document.body.dataset.picture === 'exact'");
    assert!(page.screenshot("serve-proxy.png").len() > 5000);
    // The token of a reloaded page is that of its own address.
    let kept = page.value("Object.keys(frames[0].sessionStorage)");
    assert!(kept.as_array().unwrap().contains(&format!("{FOLDER} token").into()), "{kept}");
    assert!(kept.as_array().unwrap().iter().all(|name| name.as_str().unwrap().starts_with(FOLDER)), "{kept}");
    page.value("frames[0].isOld = true; frames[0].location.reload()");
    page.until("!frames[0].isOld && frames[0].document.body.dataset.picture === 'exact'");
    let own = server.request("/", "Host: hub.localhost\r\n").1.to_lowercase();
    assert!(own.contains("frame-ancestors 'self'\r\n"), "{own}");
}
