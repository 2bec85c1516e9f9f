//! The page of a training as it runs: who is answered, what is shown, and that training does not notice.

mod browser;
mod command;
mod server;
mod shown;

use std::io::{Read, Write};
use std::net::TcpStream;
use std::time::Duration;

use gspotential::live::Live;

/// What a server answers.
#[derive(Debug)]
struct Answer {
    status: u16,
    head: String,
    body: Vec<u8>,
}

impl Answer {
    #[track_caller]
    fn json(&self) -> serde_json::Value {
        assert_eq!(self.status, 200, "{}", self.head);
        serde_json::from_slice(&self.body).expect("JSON")
    }
}

/// Host with port, and path, of an address.
fn parts(address: &str) -> (&str, &str) {
    let rest = address.strip_prefix("http://").expect("an address");
    let slash = rest.find('/').expect("a path");
    rest.split_at(slash)
}

/// Sends `request` as it is and reads to the end; `None` if the connection is not answered in full,
/// as when the program ends meanwhile.
fn send(host: &str, request: &str) -> Option<Answer> {
    let mut stream = TcpStream::connect(host).ok()?;
    stream
        .set_read_timeout(Some(Duration::from_secs(60)))
        .ok()?;
    stream.write_all(request.as_bytes()).ok()?;
    let mut bytes = Vec::new();
    stream.read_to_end(&mut bytes).ok()?;
    let end = bytes.windows(4).position(|w| w == b"\r\n\r\n")?;
    let head = String::from_utf8(bytes[..end].to_vec()).ok()?;
    let body = bytes[end + 4..].to_vec();
    let length = head
        .lines()
        .find_map(|line| line.strip_prefix("Content-Length: "))?;
    (length.parse() == Ok(body.len())).then_some(())?;
    Some(Answer {
        status: head.split(' ').nth(1)?.parse().ok()?,
        head,
        body,
    })
}

/// Asks for a name of the page at `address`.
fn ask(address: &str, name: &str) -> Option<Answer> {
    let (host, path) = parts(address);
    send(
        host,
        &format!("GET {path}{name} HTTP/1.1\r\nHost: {host}\r\n\r\n"),
    )
}

/// Asks for a name of a page, which must answer.
#[track_caller]
fn get(live: &Live, name: &str) -> Answer {
    ask(live.address(), name).expect("an answer")
}
