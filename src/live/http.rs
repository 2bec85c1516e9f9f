//! This module answers HTTP requests for one page, of browsers on this machine alone.
//!
//! It listens on the loopback address. A request is answered if its path begins with a secret and its
//! `Host` is this machine: a foreign site that has its own name point here ("DNS rebinding") is told
//! nothing, and neither is another user who guesses ports. Only GET is known, a request has a bounded
//! head and a bounded time, as has its answer, and only so many are answered at one time, so a client that hangs
//! holds up nobody.

use std::io::{self, ErrorKind, Read, Write};
use std::net::{Ipv4Addr, TcpListener, TcpStream};
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::thread;
use std::time::{Duration, Instant};

use httparse::{EMPTY_HEADER, Request, Status};

/// Most bytes of a request's head.
const MAX_HEAD: usize = 8192;

/// Most lines of a request's head.
const MAX_HEADERS: usize = 64;

/// Most connections that are answered at one time; a browser opens six.
const MAX_CONNECTIONS: usize = 16;

/// Time that a request may take to arrive.
const READ_TIME: Duration = Duration::from_secs(5);

/// Time that an answer may take to be read.
const WRITE_TIME: Duration = Duration::from_secs(30);

/// Pause after a connection that could not be taken, as where the process has no file left for it.
const PAUSE: Duration = Duration::from_millis(100);

/// Names under which a browser finds this machine. Ports are not compared: `ssh -L` changes them.
const OWN_NAMES: [&str; 2] = ["127.0.0.1", "localhost"];

/// Whatever the page shows comes from here, and no other page may frame it.
const POLICY: &str = "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self'; \
                      connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'";

/// An answer with status 200, or none if the page has nothing of that name.
pub(super) type Answer = Option<Found>;

/// Something that the page is made of.
pub(super) struct Found {
    /// Media type.
    pub kind: &'static str,
    pub body: Vec<u8>,
}

/// Listens on a port of the loopback address; 0 is any that is free.
pub(super) fn listen(port: u16) -> io::Result<TcpListener> {
    TcpListener::bind((Ipv4Addr::LOCALHOST, port))
}

/// Answers requests for names below `/secret/` until the process ends.
pub(super) fn serve(
    listener: &TcpListener,
    secret: &str,
    answer: impl Fn(&str) -> Answer + Send + Sync + 'static,
) {
    let answer = Arc::new(answer);
    let secret: Arc<str> = Arc::from(secret);
    let open = Arc::new(AtomicUsize::new(0));
    for stream in listener.incoming() {
        let Ok(mut stream) = stream else {
            thread::sleep(PAUSE);
            continue;
        };
        let Some(slot) = Slot::take(&open) else {
            // The few bytes fit the socket's buffer, so this does not wait.
            let _ = stream.write_all(&head(503, "text/plain", 0));
            continue;
        };
        let (answer, secret) = (Arc::clone(&answer), Arc::clone(&secret));
        let talk = move || {
            let _slot = slot;
            // A client that has gone needs no answer.
            let _ = converse(&mut stream, &secret, &*answer);
        };
        // Without a thread the connection is closed; the browser asks again.
        let _ = thread::Builder::new().name("page".into()).spawn(talk);
    }
}

/// One of the connections that may be open at one time.
struct Slot(Arc<AtomicUsize>);

impl Slot {
    fn take(open: &Arc<AtomicUsize>) -> Option<Slot> {
        let slot = Slot(Arc::clone(open));
        (open.fetch_add(1, Ordering::SeqCst) < MAX_CONNECTIONS).then_some(slot)
    }
}

impl Drop for Slot {
    fn drop(&mut self) {
        self.0.fetch_sub(1, Ordering::SeqCst);
    }
}

fn converse(
    stream: &mut TcpStream,
    secret: &str,
    answer: &impl Fn(&str) -> Answer,
) -> io::Result<()> {
    let (status, found) = match read_name(stream, secret)? {
        Ok(name) => match answer(&name) {
            Some(found) => (200, found),
            None => (404, Found::nothing()),
        },
        Err(status) => (status, Found::nothing()),
    };
    let until = Instant::now() + WRITE_TIME;
    write(stream, &head(status, found.kind, found.body.len()), until)?;
    write(stream, &found.body, until)
}

impl Found {
    fn nothing() -> Found {
        Found {
            kind: "text/plain",
            body: Vec::new(),
        }
    }
}

/// Reads a request and returns the name that it asks for, or the status that refuses it.
fn read_name(stream: &mut TcpStream, secret: &str) -> io::Result<Result<String, u16>> {
    let until = Instant::now() + READ_TIME;
    let mut bytes = Vec::new();
    let mut part = [0; 1024];
    loop {
        let Some(left) = time_until(until) else {
            return Ok(Err(408));
        };
        stream.set_read_timeout(Some(left))?;
        match stream.read(&mut part) {
            Ok(0) => return Err(ErrorKind::UnexpectedEof.into()),
            Ok(n) => bytes.extend(&part[..n]),
            Err(e) if is_pause(&e) => continue,
            Err(e) => return Err(e),
        }
        let mut headers = [EMPTY_HEADER; MAX_HEADERS];
        let mut request = Request::new(&mut headers);
        match request.parse(&bytes) {
            Ok(Status::Complete(_)) => return Ok(name_of(&request, secret)),
            Ok(Status::Partial) if bytes.len() < MAX_HEAD => {}
            Ok(Status::Partial) | Err(httparse::Error::TooManyHeaders) => return Ok(Err(431)),
            Err(_) => return Ok(Err(400)),
        }
    }
}

/// Returns the name that a request asks for, or the status that refuses it.
fn name_of(request: &Request<'_, '_>, secret: &str) -> Result<String, u16> {
    let is_host = |h: &&httparse::Header<'_>| h.name.eq_ignore_ascii_case("host");
    let mut hosts = request.headers.iter().filter(is_host);
    match (hosts.next(), hosts.next()) {
        (Some(host), None) if is_own(host.value) => {}
        _ => return Err(421),
    }
    let path = request.path.unwrap_or_default();
    let name = path
        .strip_prefix('/')
        .and_then(|path| path.strip_prefix(secret));
    let name = name
        .and_then(|rest| rest.strip_prefix('/'))
        .ok_or(404_u16)?;
    match request.method {
        Some("GET") => Ok(name.to_owned()),
        _ => Err(405),
    }
}

/// Says whether a `Host` is a name of this machine, on whatever port.
fn is_own(host: &[u8]) -> bool {
    let Ok(host) = std::str::from_utf8(host) else {
        return false;
    };
    let name = match host.rsplit_once(':') {
        Some((name, port)) if port.bytes().all(|b| b.is_ascii_digit()) => name,
        _ => host,
    };
    OWN_NAMES.iter().any(|own| name.eq_ignore_ascii_case(own))
}

fn head(status: u16, kind: &str, len: usize) -> Vec<u8> {
    let reason = match status {
        200 => "OK",
        400 => "Bad Request",
        404 => "Not Found",
        405 => "Method Not Allowed",
        408 => "Request Timeout",
        421 => "Misdirected Request",
        431 => "Request Header Fields Too Large",
        _ => "Service Unavailable",
    };
    let allow = if status == 405 { "Allow: GET\r\n" } else { "" };
    format!(
        "HTTP/1.1 {status} {reason}\r\n\
         Content-Type: {kind}; charset=utf-8\r\n\
         Content-Length: {len}\r\n\
         Content-Security-Policy: {POLICY}\r\n\
         Cross-Origin-Resource-Policy: same-origin\r\n\
         Cross-Origin-Opener-Policy: same-origin\r\n\
         X-Content-Type-Options: nosniff\r\n\
         Referrer-Policy: no-referrer\r\n\
         Cache-Control: no-store\r\n\
         {allow}Connection: close\r\n\r\n"
    )
    .into_bytes()
}

fn write(stream: &mut TcpStream, mut bytes: &[u8], until: Instant) -> io::Result<()> {
    while !bytes.is_empty() {
        let left = time_until(until).ok_or(ErrorKind::TimedOut)?;
        stream.set_write_timeout(Some(left))?;
        match stream.write(bytes) {
            Ok(n) => bytes = &bytes[n..],
            Err(e) if is_pause(&e) => {}
            Err(e) => return Err(e),
        }
    }
    Ok(())
}

/// Returns the time until then, `None` once it has come.
fn time_until(until: Instant) -> Option<Duration> {
    let left = until.saturating_duration_since(Instant::now());
    (!left.is_zero()).then_some(left)
}

/// Says whether only time has run out, or a signal came between.
fn is_pause(e: &io::Error) -> bool {
    let kinds = [
        ErrorKind::WouldBlock,
        ErrorKind::TimedOut,
        ErrorKind::Interrupted,
    ];
    kinds.contains(&e.kind())
}
