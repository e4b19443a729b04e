//! What somebody may try who can reach the server: by plain TCP, byte by byte.

#![allow(clippy::unwrap_used, reason = "in helpers too, a failure should stop the run")]

use std::io::{Read as _, Write as _};
use std::net::{SocketAddr, TcpStream};
use std::sync::Arc;
use std::time::{Duration, Instant};
use sunglint_formats::session::{
    ClockState, Device, DeviceKind, Disk, FORMAT, Manifest, SessionWriter, Target, TargetKind, What,
};
use sunglint_formats::time::parse_utc;
use sunglint_formats::{CountFlags, CountRecord};
use sunglint_page::{Answer, Recording, Request, Server, Source};

/// A session with a counter, and a file beside it that nobody may see.
fn session() -> (tempfile::TempDir, Server) {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("secret.txt"), "nobody may see this").unwrap();
    let start = parse_utc("2026-11-21T18:00:00Z").unwrap();
    let device = |name: &str, kind, channels: &[&str]| Device {
        name: name.into(),
        kind,
        address: "sim".into(),
        options: vec![],
        channels: channels.iter().map(|&channel| channel.to_owned()).collect(),
        inputs: vec![],
        raw_tags: false,
        exposure_s: 0.1,
        interval_s: None,
        filter: None,
    };
    let clock =
        ClockState { method: "none".into(), synchronised: None, offset_s: None, error_s: None };
    let manifest = Manifest {
        format: FORMAT.into(),
        program: "a test".into(),
        station: "ufo".into(),
        start_utc: start,
        clock,
        devices: vec![
            device("tagger", DeviceKind::Counter, &["g"]),
            device("cam", DeviceKind::Camera, &[]),
        ],
        files: vec![],
    };
    let root = folder.path().join("night");
    let mut writer = SessionWriter::create(Arc::new(Disk), &root, &manifest, &[]).unwrap();
    writer.event(start, What::Target(Target::off(TargetKind::Sky)));
    for i in 0..100_i64 {
        let bin = CountRecord {
            start: start + hifitime::Duration::from_seconds(0.1 * i as f64),
            start_ps: i * 100_000_000_000,
            length_ps: 100_000_000_000,
            counts: vec![i as u64],
            missed: vec![0],
            flags: CountFlags::empty(),
        };
        writer.count("tagger", &bin).unwrap();
    }
    writer.finish(start + hifitime::Duration::from_seconds(10.0), "done");
    let address = "127.0.0.1:0".parse().unwrap();
    let server = Server::start(Some(address), Arc::new(Recording::open(&root).unwrap())).unwrap();
    (folder, server)
}

/// What comes back to some bytes until the server closes, or for two seconds.
fn send(address: SocketAddr, bytes: &[u8]) -> String {
    let mut stream = TcpStream::connect(address).unwrap();
    stream.set_read_timeout(Some(Duration::from_secs(2))).unwrap();
    // A server that refuses may close before it has read all.
    let _ = stream.write_all(bytes);
    let (mut all, mut room) = (Vec::new(), [0; 4096]);
    while let Ok(n) = stream.read(&mut room) {
        if n == 0 {
            break;
        }
        all.extend(&room[..n]);
    }
    String::from_utf8_lossy(&all).into_owned()
}

fn status(answer: &str) -> &str {
    answer.get(9..12).unwrap_or("none")
}

fn ask(server: &Server, first: &str, more: &str) -> String {
    let host = server.address();
    let text = format!("{first} HTTP/1.1\r\nHost: {host}\r\nConnection: close\r\n{more}\r\n");
    send(host, text.as_bytes())
}

/// Truth: RFC 9110's codes, and that the file beside the session is never seen.
#[test]
fn attacks_are_refused() {
    let (_folder, server) = session();
    let at = server.address();
    let good = ask(&server, "GET /api/about", "");
    assert_eq!(status(&good), "200", "{good}");
    for header in [
        "content-security-policy: default-src 'none'; script-src 'self'",
        "x-content-type-options: nosniff",
        "referrer-policy: no-referrer",
        "cross-origin-opener-policy: same-origin",
        "cross-origin-resource-policy: same-origin",
        "cache-control: no-store",
    ] {
        assert!(good.contains(header), "{header}: {good}");
    }
    // Names: DNS rebinding, and requests without one.
    for host in ["evil.example", &format!("evil.example:{}", at.port()), "127.0.0.1", ""] {
        let text = format!("GET /api/about HTTP/1.1\r\nHost: {host}\r\nConnection: close\r\n\r\n");
        assert_eq!(status(&send(at, text.as_bytes())), "421", "{host}");
    }
    let none = send(at, b"GET /api/about HTTP/1.1\r\nConnection: close\r\n\r\n");
    assert!(["400", "421"].contains(&status(&none)), "{none}");
    // Other sites' pages, and WebSockets, which browsers let cross.
    for more in [
        "Origin: http://evil.example\r\n",
        "Origin: null\r\n",
        "Sec-Fetch-Site: cross-site\r\n",
        "Sec-Fetch-Site: same-site\r\n",
        "Origin: http://evil.example\r\nConnection: Upgrade\r\nUpgrade: websocket\r\nSec-WebSocket-Version: 13\r\nSec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\n",
    ] {
        assert_eq!(status(&ask(&server, "GET /api/about", more)), "403", "{more}");
    }
    // Paths that would lead out of the session, were there any that lead to the disk.
    for path in [
        "/../secret.txt",
        "/../../etc/passwd",
        "/%2e%2e/secret.txt",
        "/api/../secret.txt",
        "/api/frame/..%2f..%2fsecret.txt/0",
        "/api/frames/../../secret.txt",
        "/api/counts/..%2f..%2fsecret.txt",
        "/api/counts/tagger%00",
        "/api/frame/cam/..",
        "/api/frame/cam/18446744073709551616",
        "/api/frame/cam/-1",
        "/session.toml",
        "/api/session.toml",
        "/page.js/../../secret.txt",
        "/api/counts/%2e%2e",
    ] {
        let answer = ask(&server, &format!("GET {path}"), "");
        assert!(["400", "404"].contains(&status(&answer)), "{path}: {answer}");
        assert!(!answer.contains("nobody may see") && !answer.contains("root:"), "{path}");
    }
    for path in [
        "/api/counts/tagger?from_s=NaN&to_s=inf&points=99999999999999",
        "/api/counts/tagger?from_s=1e300&to_s=-1e300",
        "/api/counts/tagger?from_s=9&to_s=1",
        "/api/sky?at_s=1e300",
        "/api/about?a=%E2%82%AC",
    ] {
        let answer = ask(&server, &format!("GET {path}"), "");
        assert!(["200", "422"].contains(&status(&answer)), "{path}: {answer}");
    }
    assert_eq!(status(&ask(&server, "GET /api/about?a=%ff", "")), "400");
    // Changes without the token, with a wrong one, and what a form of another site can send.
    let post = |more: &str| {
        let more = format!("Content-Length: 17\r\n{more}\r\n{{\"action\":\"stop\"}}");
        let text =
            format!("POST /api/control HTTP/1.1\r\nHost: {at}\r\nConnection: close\r\n{more}");
        status(&send(at, text.as_bytes())).to_owned()
    };
    assert_eq!(post("Content-Type: application/json\r\n"), "401");
    assert_eq!(post("Content-Type: application/json\r\nAuthorization: Bearer 0000\r\n"), "401");
    let right = format!("Authorization: Bearer {}\r\n", server.token().text());
    assert_eq!(post(&format!("Content-Type: text/plain\r\n{right}")), "415");
    assert_eq!(post(&format!("Content-Type: application/json\r\n{right}")), "405");
    // Too much: a body, a head, a method.
    let length = format!("Content-Type: application/json\r\n{right}Content-Length: 3000000\r\n");
    let mut huge =
        format!("POST /api/control HTTP/1.1\r\nHost: {at}\r\nConnection: close\r\n{length}\r\n")
            .into_bytes();
    huge.resize(huge.len() + 3_000_000, b' ');
    let answer = send(at, &huge);
    assert!(["413", "none"].contains(&status(&answer)), "{answer}");
    // A long recipe is read: 1.5 MB.
    let length = length.replace("3000000", "1500000");
    let mut big =
        format!("POST /api/control HTTP/1.1\r\nHost: {at}\r\nConnection: close\r\n{length}\r\n")
            .into_bytes();
    big.resize(big.len() + 1_500_000, b' ');
    assert_eq!(status(&send(at, &big)), "405");
    let long = format!("GET /{} HTTP/1.1\r\nHost: {at}\r\n\r\n", "a".repeat(100_000));
    let answer = send(at, long.as_bytes());
    assert!(["414", "431", "none"].contains(&status(&answer)), "{answer}");
    assert_eq!(status(&ask(&server, "DELETE /api/about", "")), "405");
    assert!(!send(at, b"\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03").contains("200 OK"));
    // It is well.
    assert_eq!(status(&ask(&server, "GET /api/about", "")), "200");
}

/// 1,000 clients that connect and say nothing, half a head, or ask and never read: a page that asks as often as it does gets its answers, and the server holds no more than its seats.
#[test]
fn slow_and_many_clients_are_dropped() {
    /// Answers with 2 MB.
    struct Large;
    impl Source for Large {
        fn answer(&self, request: &Request) -> Answer {
            match request.parts().as_slice() {
                ["small"] => Answer::bytes(vec![1; 10]),
                _ => Answer::bytes(vec![0; 2_000_000]),
            }
        }
    }
    let server = Server::start(Some("127.0.0.1:0".parse().unwrap()), Arc::new(Large)).unwrap();
    let at = server.address();
    let mut page = TcpStream::connect(at).unwrap();
    page.set_nodelay(true).unwrap();
    page.set_read_timeout(Some(Duration::from_secs(20))).unwrap();
    let mut poll = || {
        let begun = Instant::now();
        page.write_all(format!("GET /api/small HTTP/1.1\r\nHost: {at}\r\n\r\n").as_bytes())
            .unwrap();
        let (mut all, mut room) = (Vec::new(), [0; 4096]);
        while !all.ends_with(&[1; 10]) {
            let n = page.read(&mut room).unwrap();
            assert!(n > 0, "the page was dropped: {}", String::from_utf8_lossy(&all));
            all.extend(&room[..n]);
        }
        assert_eq!(status(&String::from_utf8_lossy(&all)), "200");
        begun.elapsed()
    };
    poll();
    let mut others = Vec::new();
    let mut slowest = Duration::ZERO;
    for i in 0..1000 {
        let Ok(mut other) = TcpStream::connect(at) else { continue };
        let said = match i % 3 {
            0 => String::new(),
            1 => format!("GET /api/large HTTP/1.1\r\nHost: {at}\r\n"),
            _ => format!("GET /api/large HTTP/1.1\r\nHost: {at}\r\n\r\n"),
        };
        let _ = other.write_all(said.as_bytes());
        others.push(other);
        if i % 25 == 0 {
            slowest = slowest.max(poll());
        }
    }
    println!("{} clients; the page waited {slowest:?} at most", others.len());
    // A page that is shut out waits as long as the silent clients are kept.
    assert!(others.len() > 900 && slowest < Duration::from_secs(20), "{slowest:?}");
    // Most of them were shown out.
    let mut open = 0;
    let mut room = vec![0; 1 << 20];
    for other in &mut others {
        other.set_nonblocking(true).unwrap();
        loop {
            match other.read(&mut room) {
                Ok(0) => break,
                Ok(_) => {}
                Err(error) => {
                    open += u32::from(error.kind() == std::io::ErrorKind::WouldBlock);
                    break;
                }
            }
        }
    }
    assert!(open <= 192, "{open} are still there");
    assert!(poll() < Duration::from_secs(20));
    // A second connection in a hurry is told to wait.
    let burst = format!("GET /api/small HTTP/1.1\r\nHost: {at}\r\n\r\n").repeat(150);
    let answer = send(at, burst.as_bytes());
    assert!(answer.contains("429 Too Many Requests"), "no limit of requests");
}

/// More clients than there are seats ask once, without the token, and stay. Truth: a browser that opens its six connections before it asks has an answer on each.
#[test]
fn clients_that_asked_without_the_token_shut_no_browser_out() {
    let (_folder, server) = session();
    let at = server.address();
    let ask = |stream: &mut TcpStream| {
        let asked = format!("GET /page.css HTTP/1.1\r\nHost: {at}\r\n\r\n");
        stream.write_all(asked.as_bytes()).unwrap();
        let mut room = [0; 12];
        let read = stream.read_exact(&mut room);
        read.map(|()| String::from_utf8_lossy(&room).into_owned())
    };
    let open = || {
        let stream = TcpStream::connect(at).unwrap();
        stream.set_read_timeout(Some(Duration::from_secs(20))).unwrap();
        stream
    };
    let mut others = Vec::new();
    for _ in 0..300 {
        let mut other = open();
        assert_eq!(ask(&mut other).unwrap(), "HTTP/1.1 200");
        others.push(other);
    }
    let mut browser: Vec<TcpStream> = (0..6).map(|_| open()).collect();
    for stream in &mut browser {
        assert_eq!(ask(stream).unwrap(), "HTTP/1.1 200");
    }
}

/// A stranger, or a telephone with the token of yesterday, asks with a wrong token again and again: from the same address as the right page, too. Truth: the right token passes in any case.
#[test]
fn wrong_tokens_do_not_lock_out_the_right_one() {
    let (_folder, server) = session();
    let at = server.address();
    let post = |token: &str| {
        let text = format!(
            "POST /api/control HTTP/1.1\r\nHost: {at}\r\nConnection: close\r\nContent-Type: application/json\r\nAuthorization: Bearer {token}\r\nContent-Length: 17\r\n\r\n{{\"action\":\"stop\"}}"
        );
        status(&send(at, text.as_bytes())).to_owned()
    };
    let wrong: Vec<String> = (0..30).map(|i| post(&format!("{i:032x}"))).collect();
    assert_eq!((wrong[0].as_str(), wrong[29].as_str()), ("401", "429"));
    // 405: it passed the gate; a recorded session cannot be steered.
    assert_eq!(post(server.token().text()), "405");
}

/// Answers that never come, more of them than are made at the same time. Truth: a command is answered meanwhile, and an ordinary request once they are done.
#[test]
fn slow_answers_do_not_hold_up_a_command() {
    /// Answers commands at once, and all else when it is told.
    struct Slow(std::sync::Mutex<bool>, std::sync::Condvar);
    impl Source for Slow {
        fn answer(&self, request: &Request) -> Answer {
            if !request.is_command() {
                let done = self.0.lock().unwrap();
                drop(self.1.wait_while(done, |done| !*done).unwrap());
            }
            Answer::json(&1)
        }
    }
    let source = Arc::new(Slow(std::sync::Mutex::new(false), std::sync::Condvar::new()));
    let server = Server::start(Some("127.0.0.1:0".parse().unwrap()), source.clone()).unwrap();
    let at = server.address();
    let slow = format!("GET /api/marks HTTP/1.1\r\nHost: {at}\r\nConnection: close\r\n\r\n");
    let mut waiting: Vec<TcpStream> = (0..8)
        .map(|_| {
            let mut stream = TcpStream::connect(at).unwrap();
            stream.write_all(slow.as_bytes()).unwrap();
            stream
        })
        .collect();
    // The commands wait for nothing; each one is seen after the slow ones.
    for (path, body) in [("control", r#"{"action":"stop"}"#), ("reduction/cancel", "{}")] {
        let text = format!(
            "POST /api/{path} HTTP/1.1\r\nHost: {at}\r\nConnection: close\r\nContent-Type: application/json\r\nAuthorization: Bearer {}\r\nContent-Length: {}\r\n\r\n{body}",
            server.token().text(),
            body.len()
        );
        let mut stream = TcpStream::connect(at).unwrap();
        stream.set_read_timeout(Some(Duration::from_secs(60))).unwrap();
        stream.write_all(text.as_bytes()).unwrap();
        let mut answer = String::new();
        stream.read_to_string(&mut answer).unwrap();
        assert_eq!(status(&answer), "200", "{path}: {answer}");
    }
    *source.0.lock().unwrap() = true;
    source.1.notify_all();
    for stream in &mut waiting {
        stream.set_read_timeout(Some(Duration::from_secs(60))).unwrap();
        let mut answer = String::new();
        stream.read_to_string(&mut answer).unwrap();
        assert_eq!(status(&answer), "200", "{answer}");
    }
}

/// Beyond this computer nothing is told without the token. It listens at an address of loopback's network that is no name of it, as another computer's would be.
#[test]
fn open_servers_ask_for_the_token() {
    struct Empty;
    impl Source for Empty {
        fn answer(&self, _: &Request) -> Answer {
            Answer::json(&1)
        }
    }
    let server = Server::start(Some("0.0.0.0:0".parse().unwrap()), Arc::new(Empty)).unwrap();
    assert!(server.is_open() && server.url_with_token().contains("/#token="));
    let at: SocketAddr = format!("127.0.0.1:{}", server.address().port()).parse().unwrap();
    let get = |more: &str, host: &str| {
        let text =
            format!("GET /api/about HTTP/1.1\r\nHost: {host}\r\nConnection: close\r\n{more}\r\n");
        status(&send(at, text.as_bytes())).to_owned()
    };
    let host = at.to_string();
    let right = format!("Authorization: Bearer {}\r\n", server.token().text());
    assert_eq!(get("", &host), "401");
    assert_eq!(get(&right, &host), "200");
    assert_eq!(get(&right, &format!("observatory.example:{}", at.port())), "421");
    drop(server);
    // It is gone with its owner.
    assert!(TcpStream::connect(at).is_err());
}
