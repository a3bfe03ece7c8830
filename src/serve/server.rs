//! HTTP and WebSocket. What comes in is checked here, and costs a bounded amount.

use std::net::TcpListener;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering};
use std::time::{Duration, Instant};

use anyhow::{Context, Result, ensure};
use axum::body::Body;
use axum::extract::ws::{CloseFrame, Message, WebSocket, WebSocketUpgrade};
use axum::extract::{Path as UrlPath, Request, State};
use axum::http::{HeaderMap, HeaderValue, StatusCode, header};
use axum::middleware::{Next, from_fn_with_state};
use axum::response::{IntoResponse, Response};
use axum::routing::get;
use axum::{Extension, Router};
use crossbeam_channel::{Sender, unbounded};
use futures_util::stream::{SplitSink, SplitStream};
use futures_util::{SinkExt, StreamExt};
use hyper_util::rt::{TokioIo, TokioTimer};
use hyper_util::service::TowerToHyperService;
use tokio::sync::{OwnedSemaphorePermit, Semaphore};
use tokio::time::timeout;
use tower::ServiceExt;
use tower_http::services::ServeFile;

use super::admission::Admission;
use super::films::Films;
use super::outbox::{Outbox, Outgoing};
use super::session_event::{Said, SessionEvent};
use super::sessions::{Reopening, Sessions};
use crate::gpu::Device;
use crate::threads;
use crate::viewer::Setup;
use crate::viewer::remote::{ClientMessage, ServerMessage};

/// The files of the web page: path, type, text.
const PAGE: [(&str, &str, &str); 3] = [
    ("/", "text/html; charset=utf-8", include_str!("page/index.html")),
    ("/page.css", "text/css; charset=utf-8", include_str!("page/page.css")),
    ("/page.js", "text/javascript; charset=utf-8", include_str!("page/page.js")),
];

/// The web page loads nothing from elsewhere, and no other site may show it.
const POLICY: &str = "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob: data:; \
                      media-src 'self'; connect-src 'self'; base-uri 'none'; form-action 'none'; \
                      frame-ancestors 'self'";

/// Sites of the same machine, which may show the web page of a local server: notebooks. Behind a proxy, they would be
/// those of the machine of the browser.
const LOCAL_SITES: &str = " http://localhost:* http://127.0.0.1:*";

/// Most bytes of a message of a client.
const MESSAGE_BYTES: usize = 64 << 10;

/// Messages that a client may send a second, and at once after a pause. A long message counts as several.
const RATE: f64 = 300.0;
const BURST: f64 = 900.0;
const BYTES_OF_ONE: usize = 4 << 10;

/// Messages that are no messages, after which a connection ends.
const MAX_NONSENSE: u32 = 20;

/// TCP connections at the same time.
const MAX_SOCKETS: usize = 512;

const HEADER_TIME: Duration = Duration::from_secs(5);
const HELLO_TIME: Duration = Duration::from_secs(5);
/// Time in which a client takes a message, or else is gone.
const SEND_TIME: Duration = Duration::from_secs(20);
/// Time in which a client takes the reason why it is refused.
const END_TIME: Duration = Duration::from_secs(2);
const PING_TIME: Duration = Duration::from_secs(20);
/// Time without any message, also answers to pings, after which a client is gone.
const SILENCE: Duration = Duration::from_secs(60);

/// Films that are fetched at the same time, and the time in which a request is answered.
const MAX_DOWNLOADS: usize = 16;
const HTTP_TIME: Duration = Duration::from_secs(600);

/// Files of a folder that are listed.
const MAX_FILES: usize = 2000;

/// What a server allows.
#[derive(Clone, Copy, Debug)]
pub struct Limits {
    /// Clients at the same time.
    pub clients: usize,
}

/// What all connections share.
struct Shared {
    admission: Admission,
    limits: Limits,
    films: Films,
    downloads: Arc<Semaphore>,
    events: Sender<SessionEvent>,
    clients: AtomicUsize,
    last_id: AtomicU64,
}

/// Serves the scenes of a setup on a listener, until the device is lost and cannot be opened again, or the scenes turn
/// out to be unreadable.
///
/// # Errors
/// These two; or the system gives no thread.
pub fn serve(
    listener: TcpListener,
    device: (Device, Reopening),
    setup: Setup,
    (admission, limits): (Admission, Limits),
) -> Result<()> {
    let (sender, events) = unbounded();
    let films = Films::default();
    let mut sessions = Sessions::new(device, setup, admission.clone(), (sender.clone(), films.clone()))?;
    listener.set_nonblocking(true).context("cannot listen")?;
    let shared = Shared {
        admission,
        limits,
        films,
        downloads: Arc::new(Semaphore::new(MAX_DOWNLOADS)),
        events: sender,
        clients: AtomicUsize::new(0),
        last_id: AtomicU64::new(0),
    };
    let runtime = tokio::runtime::Builder::new_multi_thread().worker_threads(2).enable_io().enable_time().build();
    let runtime = runtime.context("cannot start the server")?;
    let network = threads::spawn(move || runtime.block_on(accept(listener, Arc::new(shared))))?;
    let outcome = sessions.run(&events);
    // The connections end with the process.
    drop(network);
    outcome
}

/// Accepts connections, for one request each.
async fn accept(listener: TcpListener, shared: Arc<Shared>) -> Result<()> {
    let listener = tokio::net::TcpListener::from_std(listener)?;
    let mut router = Router::new().route("/socket", get(upgrade)).route("/film/{key}", get(film));
    for (path, kind, text) in PAGE {
        router = router.route(path, get(move || async move { ([(header::CONTENT_TYPE, kind)], text) }));
    }
    let router = router.layer(from_fn_with_state(shared.clone(), check)).with_state(shared);
    let sockets = Arc::new(Semaphore::new(MAX_SOCKETS));
    loop {
        let Ok(permit) = sockets.clone().acquire_owned().await else { return Ok(()) };
        // A connection that was reset while it waited is no reason to end.
        let Ok((stream, _)) = listener.accept().await else {
            tokio::time::sleep(Duration::from_millis(10)).await;
            continue;
        };
        _ = stream.set_nodelay(true);
        // A socket keeps the permit that its request had.
        let permit = Arc::new(permit);
        let service = TowerToHyperService::new(router.clone().layer(Extension(permit.clone())));
        tokio::spawn(async move {
            let mut http = hyper::server::conn::http1::Builder::new();
            http.timer(TokioTimer::new()).header_read_timeout(HEADER_TIME).max_buf_size(16 << 10);
            // A socket goes on after its upgrade.
            _ = timeout(HTTP_TIME, http.serve_connection(TokioIo::new(stream), service).with_upgrades()).await;
            drop(permit);
        });
    }
}

/// Refuses requests of others, and adds headers.
async fn check(State(shared): State<Arc<Shared>>, request: Request<Body>, next: Next) -> Response {
    let text = |headers: &HeaderMap, name| headers.get(name).map(|value| value.to_str().unwrap_or("?").to_owned());
    let host = text(request.headers(), header::HOST);
    let origin = text(request.headers(), header::ORIGIN);
    let mut response = match shared.admission.refuses(host.as_deref(), origin.as_deref()) {
        Some(why) => (StatusCode::FORBIDDEN, why).into_response(),
        None => next.run(request).await,
    };
    let is_upgraded = response.status() == StatusCode::SWITCHING_PROTOCOLS;
    let headers = response.headers_mut();
    if !is_upgraded {
        headers.insert(header::CONNECTION, HeaderValue::from_static("close"));
    }
    let has_local_sites = shared.admission.is_local && shared.admission.proxy.is_none();
    let policy = if has_local_sites { format!("{POLICY}{LOCAL_SITES}") } else { POLICY.to_owned() };
    headers.insert(header::CONTENT_SECURITY_POLICY, HeaderValue::try_from(policy).expect("a policy is plain text"));
    for (name, value) in [
        (header::CACHE_CONTROL, "no-store"),
        (header::X_CONTENT_TYPE_OPTIONS, "nosniff"),
        (header::REFERRER_POLICY, "no-referrer"),
    ] {
        headers.insert(name, HeaderValue::from_static(value));
    }
    response
}

/// The file of a film, or a part of it.
async fn film(State(shared): State<Arc<Shared>>, UrlPath(key): UrlPath<String>, request: Request<Body>) -> Response {
    let Some(file) = shared.films.file(&key) else {
        return (StatusCode::NOT_FOUND, "there is no such film any more").into_response();
    };
    let Ok(place) = shared.downloads.clone().try_acquire_owned() else {
        return (StatusCode::SERVICE_UNAVAILABLE, "too many films are fetched at once").into_response();
    };
    let (head, body) = ServeFile::new(file).oneshot(request).await.into_response().into_parts();
    // The place is free again when the film was sent.
    let parts = body.into_data_stream().inspect(move |_| _ = &place);
    Response::from_parts(head, Body::from_stream(parts))
}

async fn upgrade(
    State(shared): State<Arc<Shared>>,
    Extension(permit): Extension<Arc<OwnedSemaphorePermit>>,
    upgrade: WebSocketUpgrade,
) -> Response {
    let upgrade = upgrade.max_message_size(MESSAGE_BYTES).max_frame_size(MESSAGE_BYTES);
    upgrade.on_upgrade(move |socket| async move {
        connection(socket, shared).await;
        drop(permit);
    })
}

/// One client among those that are counted.
struct Place(Arc<Shared>);

impl Place {
    /// `None` if there are as many clients as allowed.
    fn taken(shared: &Arc<Shared>) -> Option<Self> {
        let most = shared.limits.clients;
        let add = |clients| (clients < most).then_some(clients + 1);
        shared.clients.fetch_update(Ordering::Relaxed, Ordering::Relaxed, add).ok().map(|_| Self(shared.clone()))
    }
}

impl Drop for Place {
    fn drop(&mut self) {
        self.0.clients.fetch_sub(1, Ordering::Relaxed);
    }
}

async fn connection(mut socket: WebSocket, shared: Arc<Shared>) {
    let (size, view) = match timeout(HELLO_TIME, hello(&mut socket, &shared.admission)).await {
        Ok(Ok(hello)) => hello,
        Ok(Err(why)) => return end(&mut socket, &why).await,
        Err(_) => return end(&mut socket, "the client said nothing").await,
    };
    let Some(_place) = Place::taken(&shared) else {
        let most = shared.limits.clients;
        return end(&mut socket, &format!("the server has {most} browsers already, and allows no more")).await;
    };
    let id = shared.last_id.fetch_add(1, Ordering::Relaxed) + 1;
    let outbox = Arc::new(Outbox::default());
    // The sessions end before the network.
    _ = shared.events.send(SessionEvent::Joined { id, outbox: outbox.clone(), size, view });
    let (sink, stream) = socket.split();
    tokio::select! {
        () = write(sink, &outbox) => {}
        () = read(stream, (id, &outbox), &shared) => {}
    }
    _ = shared.events.send(SessionEvent::Left { id });
}

/// The first message: the size of pictures, and the view to begin at.
async fn hello(socket: &mut WebSocket, admission: &Admission) -> Result<([u32; 2], Option<serde_json::Value>), String> {
    let Some(Ok(Message::Text(text))) = socket.recv().await else { return Err("the client said nothing".to_owned()) };
    match ClientMessage::parse(&text)? {
        ClientMessage::Hello { token, .. } if !admission.has_token(token.as_deref()) => {
            Err("this server needs its token: open the address that it printed".to_owned())
        }
        ClientMessage::Hello { size, view, .. } => Ok((size, view)),
        _ => Err("the first message has to be `hello`".to_owned()),
    }
}

/// A close frame has 123 bytes of reason at most.
fn closing(why: &str) -> Message {
    let end = (0..=why.len().min(120)).rev().find(|end| why.is_char_boundary(*end)).unwrap_or(0);
    Message::Close(Some(CloseFrame { code: axum::extract::ws::close_code::POLICY, reason: why[..end].into() }))
}

async fn end(socket: &mut WebSocket, why: &str) {
    _ = timeout(END_TIME, socket.send(closing(why))).await;
}

/// Sends what waits, until the client takes nothing any more.
async fn write(mut sink: SplitSink<WebSocket, Message>, outbox: &Outbox) {
    loop {
        let message = match timeout(PING_TIME, outbox.next()).await {
            Ok(Outgoing::Text(text)) => Message::Text(text.into()),
            Ok(Outgoing::Binary(bytes)) => Message::Binary(bytes.into()),
            Ok(Outgoing::End(why)) => {
                _ = timeout(SEND_TIME, sink.send(closing(&why))).await;
                return;
            }
            Err(_) => Message::Ping(Vec::new().into()),
        };
        if !matches!(timeout(SEND_TIME, sink.send(message)).await, Ok(Ok(()))) {
            return;
        }
    }
}

/// Messages that are left to a client: a bucket that fills with time.
struct Allowance {
    left: f64,
    at: Instant,
}

impl Allowance {
    /// Takes a message of this many bytes. False if the client sends too much.
    fn take(&mut self, bytes: usize, now: Instant) -> bool {
        let seconds = now.saturating_duration_since(self.at).as_secs_f64();
        self.left = (self.left + RATE * seconds).min(BURST) - 1.0 - (bytes / BYTES_OF_ONE) as f64;
        self.at = now;
        self.left >= 0.0
    }
}

/// Passes messages on, until the connection ends or the client sends too much.
async fn read(mut stream: SplitStream<WebSocket>, (id, outbox): (u64, &Outbox), shared: &Shared) {
    let mut allowance = Allowance { left: BURST, at: Instant::now() };
    let mut nonsense = 0;
    loop {
        let message = match timeout(SILENCE, stream.next()).await {
            Ok(Some(Ok(message))) => message,
            _ => return,
        };
        let at = Instant::now();
        let bytes = match &message {
            Message::Text(text) => text.len(),
            Message::Binary(bytes) | Message::Ping(bytes) | Message::Pong(bytes) => bytes.len(),
            Message::Close(_) => return,
        };
        if !allowance.take(bytes, at) {
            outbox.end("the client sends too many messages".to_owned());
            continue;
        }
        let parsed = match message {
            Message::Text(text) => ClientMessage::parse(&text),
            Message::Binary(_) => Err("binary messages are not read".to_owned()),
            _ => continue,
        };
        let answer = match parsed {
            Ok(ClientMessage::Ping { time }) => Some(ServerMessage::Pong { time }),
            Ok(ClientMessage::Files { folder }) => {
                let admission = shared.admission.clone();
                // The threads of the network do not wait for a disk.
                tokio::task::spawn_blocking(move || listed(&admission, folder)).await.ok()
            }
            Ok(message) => match opened(&shared.admission, &message) {
                Ok(file) => {
                    _ = shared.events.send(SessionEvent::Said { id, said: Said { at, message, file } });
                    None
                }
                Err(why) => Some(ServerMessage::refused(format!("{why:#}"))),
            },
            Err(why) => {
                nonsense += 1;
                if nonsense > MAX_NONSENSE {
                    outbox.end("the client sends messages that are none".to_owned());
                }
                Some(ServerMessage::refused(why))
            }
        };
        if let Some(answer) = answer {
            outbox.text(answer.text());
        }
    }
}

/// The file that a message asks to open, inside the folder of the server. Projects and camera files of other programs
/// name files elsewhere, so that only scenes, pictures and cameras.json are opened.
fn opened(admission: &Admission, message: &ClientMessage) -> Result<Option<PathBuf>> {
    let ClientMessage::Open { file } = message else { return Ok(None) };
    let path = admission.inside(file)?;
    ensure!(path.is_file() && is_offered(&path), "{file} is no scene, picture or cameras.json");
    Ok(Some(path))
}

/// True for a file that clients may open.
fn is_offered(path: &Path) -> bool {
    let name = path.file_name().unwrap_or_default().to_string_lossy().to_lowercase();
    let endings = [".ply", ".spz", ".splat", ".ksplat", ".rad", ".sog", ".smalto", ".glb", ".png", ".jpg", ".jpeg"];
    endings.iter().any(|ending| name.ends_with(ending)) || name == "cameras.json" || name.ends_with(".cameras.json")
}

/// The folders and files of a folder that clients may open, in order.
fn listed(admission: &Admission, folder: String) -> ServerMessage {
    let list = || {
        let path = admission.inside(&folder)?;
        let entries = std::fs::read_dir(&path).with_context(|| format!("cannot read {folder}"))?;
        let (mut folders, mut files) = (Vec::new(), Vec::new());
        for entry in entries.flatten().take(MAX_FILES) {
            let (path, name) = (entry.path(), entry.file_name().to_string_lossy().into_owned());
            match () {
                () if name.starts_with('.') => {}
                () if path.is_dir() => folders.push(name),
                () if is_offered(&path) => files.push(name),
                () => {}
            }
        }
        folders.sort_unstable();
        files.sort_unstable();
        anyhow::Ok((folders, files))
    };
    match list() {
        Ok((folders, files)) => ServerMessage::Files { folder, folders, files },
        Err(problem) => ServerMessage::refused(format!("{problem:#}")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_client_may_send_only_so_much() {
        let begin = Instant::now();
        let mut allowance = Allowance { left: BURST, at: begin };
        let taken = (0..10_000).filter(|_| allowance.take(10, begin)).count();
        assert_eq!(taken, BURST as usize);
        let mut allowance = Allowance { left: BURST, at: begin };
        assert!((0..10_000).all(|i| allowance.take(10, begin + Duration::from_millis(4 * i))));
        let mut allowance = Allowance { left: BURST, at: begin };
        assert!((0..1000).filter(|_| allowance.take(MESSAGE_BYTES, begin)).count() < 100);
    }

    #[test]
    fn a_reason_fits_a_close_frame() {
        for why in ["", "short", &"é".repeat(200)] {
            let Message::Close(Some(frame)) = closing(why) else { panic!("a close frame") };
            assert!(frame.reason.len() <= 120);
        }
    }
}
