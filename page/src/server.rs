//! HTTP server in a thread of its own: few clients, bounded in all that they may cost.
//!
//! It speaks HTTP/1.1 by hyper, without a router: the page is a few files, and all else goes to a [`Source`]. State is polled, so that a slow page holds nothing
//! but its own answer, and a page that comes back after a break simply asks again.

use crate::gate::{Gate, Refusal, Token};
use crate::request::{Answer, Request, Source};
use http_body_util::{BodyExt as _, Full, Limited};
use hyper::body::{Bytes, Incoming};
use hyper::header::{CACHE_CONTROL, CONTENT_TYPE, HeaderName, HeaderValue};
use hyper::service::service_fn;
use hyper::{Method, Response, StatusCode};
use hyper_util::rt::{TokioIo, TokioTimer};
use std::collections::HashMap;
use std::net::{IpAddr, SocketAddr, TcpListener};
use std::pin::Pin;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::task::{Context, Poll};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};
use tokio::io::{AsyncRead, AsyncWrite, ReadBuf};
use tokio::net::TcpStream;
use tokio::sync::{Semaphore, oneshot};
use tokio::time::Sleep;

/// Connections at most. One more takes the place of the one that has been silent for longest, first of those that never asked with the token.
/// More than wait at the port (129), so that a browser that was served just now is not shown out by clients that came before it.
const SEATS: usize = 192;
/// Requests of one connection in a second at most.
const REQUESTS: u32 = 100;
/// Longest body of a request that asks for a change, which has the token, bytes: a recipe with 100,000 refused frames.
const BODY: usize = 2 << 20;
/// Longest body of any other request, bytes.
const LITTLE: usize = 4 << 10;
/// Longest head of a request, bytes.
const HEAD: usize = 16 << 10;
/// Time for a request to come, and for an answer to go on.
const PATIENCE: Duration = Duration::from_secs(10);
/// Answers that are made at the same time.
const WORKERS: usize = 4;
/// Answers to commands that are made beside them: Stop waits for no frame that is measured, and for no reduction.
const COMMANDS: usize = 4;
/// Ports that are tried where none is asked for.
const PORTS: std::ops::Range<u16> = 8650..8670;

const CSP: &str = "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self'; connect-src 'self'; base-uri 'none'; form-action 'none'; \
                   frame-ancestors 'none'; require-trusted-types-for 'script'";

const FILES: [(&str, &str, &str); 7] = [
    ("/", "text/html; charset=utf-8", include_str!("../web/index.html")),
    ("/page.css", "text/css; charset=utf-8", include_str!("../web/page.css")),
    ("/page.js", "text/javascript; charset=utf-8", include_str!("../web/page.js")),
    ("/theme.js", "text/javascript; charset=utf-8", include_str!("../web/theme.js")),
    ("/plan.js", "text/javascript; charset=utf-8", include_str!("../web/plan.js")),
    ("/lab.js", "text/javascript; charset=utf-8", include_str!("../web/lab.js")),
    ("/icon.svg", "image/svg+xml", include_str!("../web/icon.svg")),
];

/// Why a page cannot be served.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ServerError {
    /// The address is taken, or not this computer's.
    #[error(
        "cannot listen at {address}: {source}; give another address with `--page ADDRESS:PORT` or `--address`"
    )]
    Listen {
        /// The address.
        address: SocketAddr,
        /// Why.
        source: std::io::Error,
    },
    /// The system starts no thread, or has no random numbers.
    #[error("cannot start the page's server: {0}")]
    Start(#[from] std::io::Error),
}

/// A running server; it ends when this is dropped.
#[derive(Debug)]
pub struct Server {
    address: SocketAddr,
    token: Token,
    stop: Option<oneshot::Sender<()>>,
    thread: Option<JoinHandle<()>>,
}

impl Server {
    /// Starts a server. `address` `None` is the first free port from 8650 on, for this computer alone.
    ///
    /// # Errors
    /// [`ServerError`].
    pub fn start(
        address: Option<SocketAddr>,
        source: Arc<dyn Source>,
    ) -> Result<Self, ServerError> {
        let listener = listen(address)?;
        listener.set_nonblocking(true)?;
        let address = listener.local_addr()?;
        let token = Token::new()?;
        let served = Arc::new(Served {
            gate: Gate::new(address, token.clone()),
            source,
            workers: Arc::new(Semaphore::new(WORKERS)),
            commands: Arc::new(Semaphore::new(COMMANDS)),
        });
        let (stop, stopped) = oneshot::channel();
        let runtime = tokio::runtime::Builder::new_current_thread()
            .enable_io()
            .enable_time()
            .max_blocking_threads(WORKERS + COMMANDS)
            .thread_name("page-answer")
            .build()?;
        let thread = std::thread::Builder::new().name("page".into()).spawn(move || {
            runtime.block_on(async {
                let accepting = tokio::spawn(accept(listener, served));
                let _ = stopped.await;
                accepting.abort();
            });
            // An answer that is being made is not waited for.
            runtime.shutdown_background();
        })?;
        Ok(Self { address, token, stop: Some(stop), thread: Some(thread) })
    }

    /// Where it listens.
    pub fn address(&self) -> SocketAddr {
        self.address
    }

    /// The secret that lets a page steer.
    pub fn token(&self) -> &Token {
        &self.token
    }

    /// Address of the page for a browser, without the token.
    pub fn url(&self) -> String {
        format!("http://{}/", self.address)
    }

    /// The same with the token. It stands behind a `#`, which browsers keep to themselves: it goes to no log and to no other site.
    pub fn url_with_token(&self) -> String {
        format!("http://{}/#token={}", self.address, self.token.text())
    }

    /// Whether other computers can reach it.
    pub fn is_open(&self) -> bool {
        !self.address.ip().is_loopback()
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        if let Some(stop) = self.stop.take() {
            let _ = stop.send(());
        }
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

fn listen(address: Option<SocketAddr>) -> Result<TcpListener, ServerError> {
    if let Some(address) = address {
        return TcpListener::bind(address)
            .map_err(|source| ServerError::Listen { address, source });
    }
    for port in PORTS {
        if let Ok(listener) = TcpListener::bind(("127.0.0.1", port)) {
            return Ok(listener);
        }
    }
    Ok(TcpListener::bind(("127.0.0.1", 0))?)
}

/// Everything that connections share.
struct Served {
    gate: Gate,
    source: Arc<dyn Source>,
    workers: Arc<Semaphore>,
    commands: Arc<Semaphore>,
}

/// A connection.
#[derive(Debug)]
struct Seat {
    since: Instant,
    /// Whether it has asked with the token. Whoever asks without it may be one of a flood, which would shut the browser out that has yet to ask.
    known: bool,
    busy: bool,
    task: Option<tokio::task::AbortHandle>,
}

#[derive(Debug, Default)]
struct Seats {
    next: u64,
    open: HashMap<u64, Seat>,
}

type Shared = Arc<Mutex<Seats>>;

fn lock(seats: &Shared) -> MutexGuard<'_, Seats> {
    seats.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Gives a seat; where all are taken, the one that is missed least is freed.
fn take_seat(seats: &Shared) -> u64 {
    let mut seats = lock(seats);
    if seats.open.len() >= SEATS {
        let least = seats.open.iter().min_by_key(|(_, seat)| (seat.busy, seat.known, seat.since));
        if let Some(least) = least.map(|(number, _)| *number)
            && let Some(task) = seats.open.remove(&least).and_then(|seat| seat.task)
        {
            task.abort();
        }
    }
    seats.next += 1;
    let number = seats.next;
    let seat = Seat { since: Instant::now(), known: false, busy: false, task: None };
    seats.open.insert(number, seat);
    number
}

async fn accept(listener: TcpListener, served: Arc<Served>) {
    let Ok(listener) = tokio::net::TcpListener::from_std(listener) else { return };
    let seats = Shared::default();
    loop {
        let Ok((stream, client)) = listener.accept().await else {
            // Out of file handles: a moment later some are free.
            tokio::time::sleep(Duration::from_millis(50)).await;
            continue;
        };
        let _ = stream.set_nodelay(true);
        let number = take_seat(&seats);
        let serving = serve(stream, client.ip(), number, seats.clone(), served.clone());
        let task = tokio::spawn(serving).abort_handle();
        if let Some(seat) = lock(&seats).open.get_mut(&number) {
            seat.task = Some(task);
        }
    }
}

async fn serve(stream: TcpStream, client: IpAddr, number: u64, seats: Shared, served: Arc<Served>) {
    let asked = Arc::new(Mutex::new((Instant::now(), 0_u32)));
    let own = seats.clone();
    let service = service_fn(move |request: hyper::Request<Incoming>| {
        let (served, seats, asked) = (served.clone(), own.clone(), asked.clone());
        async move {
            // A wrong token is refused.
            let has_token = request.headers().contains_key(hyper::header::AUTHORIZATION);
            mark(&seats, number, true, false);
            let answer = match over_rate(&asked) {
                true => Answer::error(429, "too many requests of one connection in a second"),
                false => answer(request, client, &served).await,
            };
            mark(&seats, number, false, has_token && answer.status < 400);
            Ok::<_, std::convert::Infallible>(response(answer))
        }
    });
    // A connection that breaks is the client's affair.
    let _ = hyper::server::conn::http1::Builder::new()
        .timer(TokioTimer::new())
        .header_read_timeout(PATIENCE)
        .max_buf_size(HEAD)
        .serve_connection(TokioIo::new(Patient::new(stream)), service)
        .await;
    lock(&seats).open.remove(&number);
}

fn mark(seats: &Shared, number: u64, busy: bool, known: bool) {
    if let Some(seat) = lock(seats).open.get_mut(&number) {
        (seat.since, seat.known, seat.busy) = (Instant::now(), seat.known || known, busy);
    }
}

fn over_rate(asked: &Mutex<(Instant, u32)>) -> bool {
    let mut asked = asked.lock().unwrap_or_else(PoisonError::into_inner);
    if asked.0.elapsed() >= Duration::from_secs(1) {
        *asked = (Instant::now(), 0);
    }
    asked.1 += 1;
    asked.1 > REQUESTS
}

async fn answer(request: hyper::Request<Incoming>, client: IpAddr, served: &Served) -> Answer {
    let (head, body) = request.into_parts();
    let admitted = served.gate.admit(client, &head.method, &head.uri, &head.headers);
    if let Err(Refusal { status, text }) = admitted {
        return Answer::error(status.as_u16(), text);
    }
    let path = head.uri.path();
    if head.method == Method::GET
        && let Some((_, kind, text)) = FILES.iter().find(|(name, ..)| *name == path)
    {
        return Answer { status: 200, kind, body: text.as_bytes().to_vec() };
    }
    let Some(path) = path.strip_prefix("/api/") else {
        return Answer::error(404, "there is no such page");
    };
    let path = path.to_owned();
    let post = head.method == Method::POST;
    let most = if post { BODY } else { LITTLE };
    let body = match tokio::time::timeout(PATIENCE, Limited::new(body, most).collect()).await {
        Ok(Ok(body)) => body.to_bytes().to_vec(),
        Ok(Err(_)) => {
            return Answer::error(413, "a request has at most 2 MiB: refuse fewer frames by hand");
        }
        Err(_) => return Answer::error(408, "the request did not come to its end"),
    };
    let Some(request) = Request::new(post, &path, head.uri.query().unwrap_or(""), body) else {
        return Answer::error(400, "the address is not readable");
    };
    let of = if request.is_command() { &served.commands } else { &served.workers };
    let Ok(Ok(turn)) = tokio::time::timeout(PATIENCE, of.clone().acquire_owned()).await else {
        return Answer::error(503, "the program makes other answers: ask again");
    };
    let source = served.source.clone();
    let made = tokio::task::spawn_blocking(move || {
        // It goes on where the client is gone meanwhile, and keeps its turn as long.
        let _turn = turn;
        source.answer(&request)
    });
    let made = made.await;
    made.unwrap_or_else(|_| Answer::error(500, "the answer could not be made"))
}

fn response(answer: Answer) -> Response<Full<Bytes>> {
    let mut response = Response::new(Full::new(Bytes::from(answer.body)));
    *response.status_mut() =
        StatusCode::from_u16(answer.status).unwrap_or(StatusCode::INTERNAL_SERVER_ERROR);
    let headers = response.headers_mut();
    headers.insert(CONTENT_TYPE, HeaderValue::from_static(answer.kind));
    headers.insert(CACHE_CONTROL, HeaderValue::from_static("no-store"));
    for (name, value) in [
        ("content-security-policy", CSP),
        ("x-content-type-options", "nosniff"),
        ("referrer-policy", "no-referrer"),
        ("cross-origin-opener-policy", "same-origin"),
        ("cross-origin-resource-policy", "same-origin"),
        ("x-frame-options", "DENY"),
    ] {
        headers.insert(HeaderName::from_static(name), HeaderValue::from_static(value));
    }
    response
}

/// A connection that ends where the client takes nothing for [`PATIENCE`].
struct Patient {
    stream: TcpStream,
    until: Option<Pin<Box<Sleep>>>,
}

impl Patient {
    fn new(stream: TcpStream) -> Self {
        Self { stream, until: None }
    }

    fn wait<T>(
        &mut self,
        polled: Poll<std::io::Result<T>>,
        context: &mut Context<'_>,
    ) -> Poll<std::io::Result<T>> {
        if polled.is_ready() {
            self.until = None;
            return polled;
        }
        let until = self.until.get_or_insert_with(|| Box::pin(tokio::time::sleep(PATIENCE)));
        match std::future::Future::poll(until.as_mut(), context) {
            Poll::Ready(()) => Poll::Ready(Err(std::io::ErrorKind::TimedOut.into())),
            Poll::Pending => Poll::Pending,
        }
    }
}

impl AsyncRead for Patient {
    fn poll_read(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        buffer: &mut ReadBuf<'_>,
    ) -> Poll<std::io::Result<()>> {
        Pin::new(&mut self.stream).poll_read(context, buffer)
    }
}

impl AsyncWrite for Patient {
    fn poll_write(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        bytes: &[u8],
    ) -> Poll<std::io::Result<usize>> {
        let polled = Pin::new(&mut self.stream).poll_write(context, bytes);
        self.wait(polled, context)
    }

    fn poll_flush(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
    ) -> Poll<std::io::Result<()>> {
        Pin::new(&mut self.stream).poll_flush(context)
    }

    fn poll_shutdown(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
    ) -> Poll<std::io::Result<()>> {
        Pin::new(&mut self.stream).poll_shutdown(context)
    }
}
