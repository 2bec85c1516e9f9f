//! Who is answered, and that nobody can hang the server.

use std::io::Write;
use std::net::TcpStream;
use std::time::{Duration, Instant};

use gspotential::live::Live;

use super::{Answer, get, parts, send};

fn live() -> Live {
    Live::serve(0).expect("serves")
}

#[track_caller]
fn asked(live: &Live, path: &str, host: &str) -> Answer {
    let (own, _) = parts(live.address());
    send(own, &format!("GET {path} HTTP/1.1\r\nHost: {host}\r\n\r\n")).expect("an answer")
}

#[test]
fn only_the_secret_address_is_answered() {
    let live = live();
    let (host, path) = parts(live.address());
    assert!(host.starts_with("127.0.0.1:"), "{host}");
    assert_eq!(path.len(), 34, "{path}");
    assert_eq!(asked(&live, path, host).status, 200);
    let other = live_secret_of_another();
    for wrong in [
        "/",
        "/favicon.ico",
        "/state",
        path.trim_end_matches('/'),
        &other,
    ] {
        assert_eq!(asked(&live, wrong, host).status, 404, "{wrong}");
    }
    for name in [
        "unheard-of",
        "../",
        "photograph-0",
        "photograph-x",
        "gaussians",
        "state?x",
    ] {
        assert_eq!(get(&live, name).status, 404, "{name}");
    }
    for name in ["style.css", "live.js", "viewer.js", "state", "curves"] {
        assert_eq!(get(&live, name).status, 200, "{name}");
    }
}

fn live_secret_of_another() -> String {
    parts(live().address()).1.to_owned()
}

#[test]
fn names_of_other_machines_are_not_answered() {
    let live = live();
    let (host, path) = parts(live.address());
    // As a forwarded port has it, too.
    for own in [host, "127.0.0.1", "localhost:8080", "LOCALHOST"] {
        assert_eq!(asked(&live, path, own).status, 200, "{own}");
    }
    for foreign in [
        "evil.example",
        "evil.example:80",
        "127.0.0.1.evil.example",
        "localhost.:80",
        "",
    ] {
        assert_eq!(asked(&live, path, foreign).status, 421, "{foreign}");
    }
    let without = send(host, &format!("GET {path} HTTP/1.1\r\n\r\n")).expect("an answer");
    assert_eq!(without.status, 421);
    let twice = format!("GET {path} HTTP/1.1\r\nHost: {host}\r\nHost: evil.example\r\n\r\n");
    assert_eq!(send(host, &twice).expect("an answer").status, 421);
}

#[test]
fn an_answer_says_that_nothing_else_may_be_loaded_or_kept() {
    let live = live();
    let answer = get(&live, "");
    for line in [
        "Content-Security-Policy: default-src 'none'; script-src 'self'",
        "frame-ancestors 'none'",
        "Cache-Control: no-store",
        "Referrer-Policy: no-referrer",
        "X-Content-Type-Options: nosniff",
    ] {
        assert!(answer.head.contains(line), "{line}: {}", answer.head);
    }
    let page = String::from_utf8(answer.body).expect("text");
    for outside in ["://", "<style", "javascript:", "onload"] {
        assert!(!page.contains(outside), "{outside}: {page}");
    }
}

#[test]
fn requests_that_are_none_are_refused() {
    let live = live();
    let (host, path) = parts(live.address());
    let status = |request: &str| send(host, request).map(|answer| answer.status);
    assert_eq!(
        status(&format!("POST {path} HTTP/1.1\r\nHost: {host}\r\n\r\n")),
        Some(405)
    );
    assert_eq!(status("nothing of the kind\r\n\r\n"), Some(400));
    let long = format!("GET {path} HTTP/1.1\r\nX: ");
    let long = format!("{long}{}", "x".repeat(8192 - long.len()));
    assert_eq!(status(&long), Some(431));
    let many = "X: x\r\n".repeat(100);
    assert_eq!(
        status(&format!("GET {path} HTTP/1.1\r\n{many}\r\n")),
        Some(431)
    );
}

#[test]
fn clients_that_hang_hold_up_nobody_for_long() {
    let live = live();
    let (host, _) = parts(live.address());
    let hanging = |n: usize| -> Vec<TcpStream> {
        let connect = |_| {
            let mut stream = TcpStream::connect(host).expect("connects");
            stream.write_all(b"GET /").expect("is taken");
            stream
        };
        (0..n).map(connect).collect()
    };
    let start = Instant::now();
    let first = hanging(10);
    assert_eq!(get(&live, "state").status, 200);
    // More than are talked to at one time.
    let more = hanging(20);
    let state = || super::ask(live.address(), "state").map(|answer| answer.status);
    assert_ne!(state(), Some(200));
    assert!(
        start.elapsed() < Duration::from_secs(4),
        "{:?}",
        start.elapsed()
    );
    while state() != Some(200) {
        assert!(start.elapsed() < Duration::from_secs(30), "waited in vain");
        std::thread::sleep(Duration::from_millis(50));
    }
    drop((first, more));
}

#[test]
fn a_port_in_use_is_refused() {
    let live = live();
    let (host, _) = parts(live.address());
    let port: u16 = host
        .rsplit_once(':')
        .expect("a port")
        .1
        .parse()
        .expect("a number");
    let error = Live::serve(port).expect_err("it is in use");
    let text = error.to_string();
    assert!(
        text.contains(&format!("port {port} of 127.0.0.1")),
        "{text}"
    );
    assert!(text.contains("or 0 for any that is free"), "{text}");
    assert_eq!(error.exit_code(), 1);
}
