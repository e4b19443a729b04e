//! Alpaca servers that are slow, endless, wrong, or lie.
#![allow(clippy::unwrap_used, reason = "helper functions of tests")]

use crate::common::alpaca::{Scripted, body, connect, error, place, value, within};
use std::io::Write as _;
use std::net::TcpStream;
use std::sync::atomic::{AtomicU32, Ordering};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};
use sunglint_drivers::alpaca::{Camera, Focuser, Mount, MountSettings, SessionSettings};
use sunglint_drivers::clock::utc_now;
use sunglint_drivers::device::{
    Camera as _, Device as _, DeviceError, Focuser as _, Mount as _, MountAxes, MountClock,
    MountMotion, MountPlace, MountRates, Window,
};
use sunglint_drivers::transport::TransportError;

/// A telescope that stands at 6 h, +10°; `None` for what a test answers itself.
fn telescope(request: &str, stream: &mut TcpStream) -> bool {
    match request {
        "GET telescope/0/connected" => value(stream, "true"),
        "GET telescope/0/alignmentmode" => value(stream, "1"),
        "GET telescope/0/equatorialsystem" => value(stream, "1"),
        "GET telescope/0/axisrates" => value(stream, r#"[{"Minimum":0.0,"Maximum":5.0}]"#),
        "GET telescope/0/rightascension" => value(stream, "6.0"),
        "GET telescope/0/declination" => value(stream, "10.0"),
        "GET telescope/0/atpark" | "GET telescope/0/slewing" => value(stream, "false"),
        get if get.starts_with("GET telescope/0/can") || get.ends_with("tracking") => {
            value(stream, "true")
        }
        put if put.starts_with("PUT ") => value(stream, "null"),
        _ => error(stream, 0x400, "not implemented"),
    }
}

fn mount_of(server: &Scripted) -> Mount<sunglint_drivers::transport::tcp::Tcp> {
    let settings = MountSettings {
        session: SessionSettings {
            answer_within: Duration::from_millis(500),
            ..SessionSettings::default()
        },
        ..MountSettings::default()
    };
    Mount::open(connect(server.port), &place(server.port), settings, &within(10.0)).unwrap()
}

/// Truth: each server breaks one rule; the call ends within its half second (five are allowed for a busy machine) with an error that names the rule, and the next
/// call, on a new connection, is answered right: no answer of before is taken for it.
#[test]
fn every_broken_answer_ends_in_time_and_is_not_mixed_up() {
    type Case = (&'static str, fn(&mut TcpStream) -> bool, &'static str);
    let cases: [Case; 11] = [
        (
            "slow",
            |s| {
                std::thread::sleep(Duration::from_millis(1200));
                value(s, "1.0")
            },
            "no answer within",
        ),
        (
            "trickle",
            |s| {
                let text = b"HTTP/1.1 200 OK\r\nContent-Length: 60\r\n\r\n                  ";
                text.iter().all(|byte| {
                    std::thread::sleep(Duration::from_millis(30));
                    s.write_all(&[*byte]).is_ok()
                })
            },
            "no answer within",
        ),
        (
            "endless body",
            |s| {
                let _ = s.write_all(b"HTTP/1.1 200 OK\r\n\r\n");
                let block = [b' '; 4096];
                while s.write_all(&block).is_ok() {}
                false
            },
            "longer than the 262144 bytes",
        ),
        (
            "endless head",
            |s| {
                let _ = s.write_all(b"HTTP/1.1 200 OK\r\n");
                while s.write_all(b"X-Y: zzzzzzzzzzzzzzzzzzzzzzzzzzzzzzzzzzzzzzzzz\r\n").is_ok() {}
                false
            },
            "a head of more than 16384 bytes",
        ),
        (
            "huge length",
            |s| s.write_all(b"HTTP/1.1 200 OK\r\nContent-Length: 99999999999\r\n\r\n").is_ok(),
            "99999999999 bytes is announced",
        ),
        (
            "endless chunks",
            |s| {
                let _ = s.write_all(b"HTTP/1.1 200 OK\r\nTransfer-Encoding: chunked\r\n\r\n");
                while s.write_all(b"4\r\nabcd\r\n").is_ok() {}
                false
            },
            "longer than the 262144 bytes",
        ),
        (
            "no HTTP",
            |s| s.write_all(b"<defNumberVector device='x'/>\r\n\r\n").is_ok(),
            "is no answer of HTTP",
        ),
        ("no JSON", |s| body(s, "<html>hello</html>"), "no JSON of Alpaca"),
        ("wrong type", |s| value(s, r#""six""#), "expected a number, 0 to 24"),
        ("out of range", |s| value(s, "1e300"), "expected a number, 0 to 24"),
        (
            "another's answer",
            |s| {
                body(
                    s,
                    r#"{"Value":5.0,"ErrorNumber":0,"ClientTransactionID":999999,"ServerTransactionID":1}"#,
                )
            },
            "the answer is that of request 999999",
        ),
    ];
    for (name, answer, expected) in cases {
        let times = Arc::new(AtomicU32::new(0));
        let count = times.clone();
        let server = Scripted::start(Arc::new(move |request, _, stream| {
            let is_it = request == "GET telescope/0/rightascension";
            if is_it && count.fetch_add(1, Ordering::SeqCst) == 0 {
                return answer(stream);
            }
            telescope(request, stream)
        }));
        let mut mount = mount_of(&server);
        let begun = Instant::now();
        let failed = mount.reading(&within(5.0)).unwrap_err().to_string();
        assert!(failed.contains(expected), "{name}: {failed}");
        assert!(begun.elapsed() < Duration::from_secs(5), "{name}");
        let good = mount.reading(&within(5.0)).unwrap_or_else(|e| panic!("{name}: {e}"));
        assert_eq!(good.place, MountPlace::Equatorial { ra_deg: 90.0, dec_deg: 10.0 }, "{name}");
        assert!(times.load(Ordering::SeqCst) >= 2);
    }
}

/// Truth: a server that says `Slewing` false at once and stands still elsewhere, one that says it for ever, one that says false while it still moves, and one that ends before its goal: that
/// was somebody else's stop.
#[test]
fn a_mount_that_lies_about_its_slew_is_not_believed() {
    let goal = MountPlace::Equatorial { ra_deg: 120.0, dec_deg: 30.0 };
    let lazy = Scripted::start(Arc::new(|request, _, stream| telescope(request, stream)));
    let mut mount = mount_of(&lazy);
    mount.begin_goto(goal, &within(5.0)).unwrap();
    // A mount may be late to say that it slews.
    assert_eq!(mount.reading(&within(5.0)).unwrap().motion, MountMotion::Slewing);
    std::thread::sleep(Duration::from_millis(5100));
    let lied = mount.reading(&within(5.0)).unwrap_err();
    assert!(matches!(lied, DeviceError::NotTaken { name: "place, deg", .. }), "{lied}");
    assert!(
        lied.to_string().contains("set to 120.0000 +30.0000, the device says 90.0000 +10.0000")
    );

    let busy = Scripted::start(Arc::new(|request, _, stream| match request {
        "GET telescope/0/slewing" => value(stream, "true"),
        request => telescope(request, stream),
    }));
    let mut mount = mount_of(&busy);
    mount.begin_goto(goal, &within(5.0)).unwrap();
    assert_eq!(mount.reading(&within(5.0)).unwrap().motion, MountMotion::Slewing);

    let step = Arc::new(AtomicU32::new(0));
    let at = step.clone();
    let moving = Scripted::start(Arc::new(move |request, _, stream| match request {
        "GET telescope/0/declination" => {
            let dec = 10 + at.fetch_add(1, Ordering::SeqCst).min(20);
            value(stream, &dec.to_string())
        }
        "GET telescope/0/rightascension" => value(stream, "8.0"),
        request => telescope(request, stream),
    }));
    let mut mount = mount_of(&moving);
    mount.begin_goto(goal, &within(5.0)).unwrap();
    std::thread::sleep(Duration::from_millis(1600));
    let states: Vec<MountMotion> =
        (0..25).map(|_| mount.reading(&within(5.0)).unwrap().motion).collect();
    assert_eq!(states[..15], [MountMotion::Slewing; 15]);
    assert_eq!(states[24], MountMotion::Tracking);

    let step = Arc::new(AtomicU32::new(0));
    let short = Scripted::start(Arc::new(move |request, _, stream| match request {
        "GET telescope/0/declination" => {
            let dec = 10 + step.fetch_add(1, Ordering::SeqCst).min(5);
            value(stream, &dec.to_string())
        }
        request => telescope(request, stream),
    }));
    let mut mount = mount_of(&short);
    mount.begin_goto(goal, &within(5.0)).unwrap();
    let ended = (0..100).find_map(|_| {
        std::thread::sleep(Duration::from_millis(50));
        mount.reading(&within(5.0)).err()
    });
    assert!(matches!(ended, Some(DeviceError::Taken { .. })), "{ended:?}");
}

/// Truth: a mount that answers yes to its rates and stands still; a mount whose axes turn the wrong way is told by its own reading (see the live test).
#[test]
fn a_mount_that_does_not_move_has_no_senses() {
    let server = Scripted::start(Arc::new(|request, _, stream| match request {
        "GET telescope/0/tracking" => value(stream, "false"),
        request => telescope(request, stream),
    }));
    let mut mount = mount_of(&server);
    let still = mount.learn_senses(&|| (), &within(20.0)).unwrap_err();
    assert!(matches!(still, DeviceError::NotTaken { .. }), "{still}");
    // It was stopped after it.
    let last = server.requests();
    assert!(
        last.iter().rev().take(4).any(|r| r.starts_with("PUT telescope/0/abortslew")),
        "{last:?}"
    );
    assert!(mount.set_rates([0.1, 0.0], &within(5.0)).is_err());
}

/// A telescope whose axes turn as they are told, and that somebody else may stop or park.
struct Turns {
    /// Rates, deg/s, and hour angle and declination, deg.
    rates: [f64; 2],
    angle: [f64; 2],
    since: Instant,
    parked: bool,
    /// Whether it says that it slews while its axes turn.
    says: bool,
}

impl Turns {
    fn go_on(&mut self) {
        let s = self.since.elapsed().as_secs_f64();
        self.since = Instant::now();
        for (angle, rate) in self.angle.iter_mut().zip(self.rates) {
            *angle += rate * s;
        }
    }
}

/// Truth: the telescope's own state: what somebody else stops while rates are in force stands a second later, what somebody else parks is parked, and its refusal of a rate says so. A mount that
/// never says that its axes turn is not taken for one that stands.
#[test]
fn what_somebody_else_does_to_rates_is_noticed() {
    for says in [true, false] {
        let turns = Arc::new(Mutex::new(Turns {
            rates: [0.0; 2],
            angle: [20.0, 10.0],
            since: Instant::now(),
            parked: false,
            says,
        }));
        let (of, began) = (turns.clone(), Instant::now());
        let server = Scripted::start(Arc::new(move |request, form, stream| {
            let mut turns = of.lock().unwrap();
            turns.go_on();
            match request {
                "GET telescope/0/rightascension" => {
                    let stars = began.elapsed().as_secs_f64() * 15.041 / 3600.0;
                    value(stream, &((100.0 + stars - turns.angle[0]) / 15.0).to_string())
                }
                "GET telescope/0/declination" => value(stream, &turns.angle[1].to_string()),
                "GET telescope/0/tracking" => value(stream, "false"),
                "GET telescope/0/atpark" => value(stream, &turns.parked.to_string()),
                "GET telescope/0/slewing" => {
                    let turn = turns.says && turns.rates != [0.0; 2];
                    value(stream, &turn.to_string())
                }
                "PUT telescope/0/moveaxis" if turns.parked => error(stream, 0x408, "parked"),
                "PUT telescope/0/moveaxis" => {
                    let of = |key: &str| {
                        let found = form.split('&').find_map(|part| part.strip_prefix(key));
                        found.unwrap().to_owned()
                    };
                    let axis: usize = of("Axis=").parse().unwrap();
                    turns.rates[axis] = of("Rate=").parse().unwrap();
                    value(stream, "null")
                }
                request => telescope(request, stream),
            }
        }));
        let mut mount = mount_of(&server);
        let beats = std::cell::Cell::new(0);
        mount.learn_senses(&|| beats.set(beats.get() + 1), &within(30.0)).unwrap();
        assert!(beats.get() >= 6, "{}", beats.get());
        let read = |mount: &mut Mount<_>| mount.reading(&within(5.0)).unwrap().motion;
        mount.set_rates([0.5, 0.2], &within(5.0)).unwrap();
        assert_eq!([(); 3].map(|()| read(&mut mount)), [MountMotion::Tracking; 3]);
        // Slower than it was ever seen to say it: that it does not is no sign, nor what it said of the rates before.
        mount.set_rates([0.001, 0.0], &within(5.0)).unwrap();
        assert_eq!(read(&mut mount), MountMotion::Tracking);
        turns.lock().unwrap().says = false;
        assert_eq!(read(&mut mount), MountMotion::Tracking);
        std::thread::sleep(Duration::from_millis(1200));
        assert_eq!(read(&mut mount), MountMotion::Tracking);
        turns.lock().unwrap().says = says;
        mount.set_rates([0.5, 0.2], &within(5.0)).unwrap();
        assert_eq!(read(&mut mount), MountMotion::Tracking);
        turns.lock().unwrap().rates = [0.0; 2];
        let then = [read(&mut mount), {
            std::thread::sleep(Duration::from_millis(1200));
            read(&mut mount)
        }];
        let stands = if says { MountMotion::Still } else { MountMotion::Tracking };
        assert_eq!(then, [MountMotion::Tracking, stands]);
        turns.lock().unwrap().parked = true;
        let refused = mount.set_rates([0.5, 0.2], &within(5.0)).unwrap_err();
        assert!(matches!(refused, DeviceError::Taken { .. }), "{refused}");
        assert_eq!(read(&mut mount), MountMotion::Parked);
    }
}

/// Truth: the lists of rates: a few values are no continuum, gaps are none, no list is none; a mount of another equinox is refused.
#[test]
fn rates_and_equinoxes_are_told_apart() {
    let with = |rates: &'static str, system: &'static str| {
        Scripted::start(Arc::new(move |request, _, stream| match request {
            "GET telescope/0/axisrates" => value(stream, rates),
            "GET telescope/0/equatorialsystem" => value(stream, system),
            request => telescope(request, stream),
        }))
    };
    let of = |rates| mount_of(&with(rates, "1")).abilities().rates.clone();
    assert_eq!(
        of(r#"[{"Minimum":0.5,"Maximum":0.5},{"Minimum":2.0,"Maximum":2.0}]"#),
        MountRates::Discrete { deg_s: vec![0.5, 2.0] }
    );
    let gap = of(r#"[{"Minimum":0.0,"Maximum":0.1},{"Minimum":1.0,"Maximum":2.0}]"#);
    assert!(matches!(gap, MountRates::Discrete { .. }));
    assert_eq!(of("[]"), MountRates::Absent);
    assert_eq!(of(r#"[{"Minimum":-5,"Maximum":1e9}]"#), MountRates::Absent);
    assert_eq!(
        of(r#"[{"Minimum":0.0,"Maximum":1.0},{"Minimum":1.0,"Maximum":4.0}]"#),
        MountRates::Continuous { most_deg_s: [4.0, 4.0].into() }
    );
    // A range within another one leaves no gap behind it.
    assert_eq!(
        of(
            r#"[{"Minimum":0.0,"Maximum":5.0},{"Minimum":1.0,"Maximum":2.0},{"Minimum":4.0,"Maximum":6.0}]"#
        ),
        MountRates::Continuous { most_deg_s: [6.0, 6.0].into() }
    );
    let plain = with("[]", "1");
    let abilities = mount_of(&plain).abilities().clone();
    assert_eq!((abilities.turns_about, abilities.refracts), (Some(MountAxes::Equatorial), None));
    let other = Scripted::start(Arc::new(|request, _, stream| match request {
        "GET telescope/0/doesrefraction" => value(stream, "true"),
        "GET telescope/0/alignmentmode" => error(stream, 0x400, "not implemented"),
        "GET telescope/0/siderealtime" => value(stream, "2.5"),
        request => telescope(request, stream),
    }));
    let mut mount = mount_of(&other);
    let abilities = mount.abilities().clone();
    assert_eq!((abilities.turns_about, abilities.refracts), (None, Some(true)));
    let time = mount.time(&within(5.0)).unwrap().map(|time| time.clock);
    assert_eq!(time, Some(MountClock::SiderealDeg(37.5)));
    let server = with("[]", "2");
    let settings = MountSettings::default();
    let opened = Mount::open(connect(server.port), &place(server.port), settings, &within(10.0));
    assert!(opened.unwrap_err().to_string().contains("equinox of date"));
}

/// A camera of 4 × 3 pixels.
fn camera(request: &str, stream: &mut TcpStream) -> bool {
    match request {
        "GET camera/0/connected" | "GET camera/0/imageready" => value(stream, "true"),
        "GET camera/0/cameraxsize" | "GET camera/0/numx" => value(stream, "4"),
        "GET camera/0/cameraysize" | "GET camera/0/numy" => value(stream, "3"),
        "GET camera/0/startx" | "GET camera/0/starty" => value(stream, "0"),
        "GET camera/0/binx" | "GET camera/0/biny" => value(stream, "1"),
        put if put.starts_with("PUT ") => value(stream, "null"),
        _ => error(stream, 0x400, "not implemented"),
    }
}

/// Truth: frames of the wrong size, cut off, of an error, of colour planes, in a form of no camera are refused by name; the old form in JSON is read, and the
/// exposure is asked for once, whatever happens to it.
#[test]
fn frames_that_are_not_the_one_asked_for_are_refused() {
    fn image(stream: &mut TcpStream, head: [i32; 11], pixels: &[u8]) -> bool {
        let mut bytes: Vec<u8> = head.iter().flat_map(|n| n.to_le_bytes()).collect();
        bytes.extend(pixels);
        let length = bytes.len();
        let text = format!(
            "HTTP/1.1 200 OK\r\nContent-Type: application/imagebytes\r\nContent-Length: {length}\r\n\r\n"
        );
        stream.write_all(text.as_bytes()).is_ok() && stream.write_all(&bytes).is_ok()
    }
    type Case = (fn(&mut TcpStream) -> bool, &'static str);
    let cases: [Case; 8] = [
        (
            |s| image(s, [1, 0, 0, 0, 44, 2, 8, 2, 3, 4, 0], &[0; 24]),
            "3 × 4 pixels, expected 4 × 3",
        ),
        (|s| image(s, [1, 0, 0, 0, 44, 2, 8, 2, 4, 3, 0], &[0; 20]), "20 bytes of pixels"),
        (|s| image(s, [1, 0x40B, 0, 0, 44, 0, 0, 0, 0, 0, 0], b"no image yet"), "no image yet"),
        (|s| image(s, [1, 0, 0, 0, 44, 2, 8, 3, 4, 3, 3], &[0; 72]), "rank 3"),
        (|s| image(s, [2, 0, 0, 0, 44, 2, 8, 2, 4, 3, 0], &[0; 24]), "version 2"),
        (|s| image(s, [1, 0, 0, 0, -9, 2, 8, 2, 4, 3, 0], &[0; 24]), "begin at byte -9"),
        (
            |s| image(s, [1, 0, 0, 0, 44, 2, 2, 2, 4, 3, 0], &[255; 48]),
            "is -1, expected 0 to 65535",
        ),
        (
            |s| {
                let _ = s.write_all(b"HTTP/1.1 200 OK\r\nContent-Type: application/imagebytes\r\nContent-Length: 68\r\n\r\nab");
                false
            },
            "is gone",
        ),
    ];
    for (answer, expected) in cases {
        let server = Scripted::start(Arc::new(move |request, _, stream| match request {
            "GET camera/0/imagearray" => answer(stream),
            request => camera(request, stream),
        }));
        let settings = SessionSettings::default();
        let line = connect(server.port);
        let mut camera = Camera::open(line, &place(server.port), settings, &within(10.0)).unwrap();
        let failed = camera.expose(0.01, &within(5.0)).unwrap_err().to_string();
        assert!(failed.contains(expected), "{expected}: {failed}");
        let asked = server.requests().iter().filter(|r| r.contains("startexposure")).count();
        assert_eq!(asked, 1);
    }
    let server = Scripted::start(Arc::new(|request, _, stream| match request {
        "GET camera/0/imagearray" => body(
            stream,
            r#"{"Type":2,"Rank":2,"Value":[[1,2,3],[4,5,6],[7,8,9],[10,11,12]],"ErrorNumber":0,"ServerTransactionID":4}"#,
        ),
        request => camera(request, stream),
    }));
    let settings = SessionSettings::default();
    let mut camera =
        Camera::open(connect(server.port), &place(server.port), settings, &within(10.0)).unwrap();
    let frame = camera.expose(0.01, &within(5.0)).unwrap();
    assert_eq!(frame.pixels.rows().into_iter().next().unwrap().to_vec(), [1, 4, 7, 10]);
    let window = Window { origin_px: [0, 0], size_px: [5, 3], binning: [1, 1] };
    assert!(camera.set_window(window, &within(5.0)).is_err());
}

/// Truth: ASCOM's `StartExposure(Duration, Light)`: no light in dark and bias frames alone. And a camera computer whose clock is years off: the frame has the host's time, and says how far the
/// other one was.
#[test]
fn a_camera_is_told_what_a_frame_is_for() {
    let server = Scripted::start(Arc::new(|request, _, stream| match request {
        "GET camera/0/lastexposurestarttime" => value(stream, r#""2020-01-01T00:00:00.125""#),
        "GET camera/0/imagearray" => body(
            stream,
            r#"{"Type":2,"Rank":2,"Value":[[1,2,3],[4,5,6],[7,8,9],[10,11,12]],"ErrorNumber":0,"ServerTransactionID":4}"#,
        ),
        request => camera(request, stream),
    }));
    let settings = SessionSettings::default();
    let mut camera =
        Camera::open(connect(server.port), &place(server.port), settings, &within(10.0)).unwrap();
    let kinds = [("light", true), ("dark", false), ("bias", false), ("flat", true)];
    for (kind, light) in kinds {
        camera.set_own("frame_type", kind, &within(5.0)).unwrap();
        let before = utc_now();
        let frame = camera.expose(0.01, &within(10.0)).unwrap();
        assert!(before <= frame.start && frame.start <= utc_now(), "{}", frame.start);
        assert!(frame.header.real("HOSTDIFF").unwrap() < -1e8);
        assert_eq!(frame.header.text("DATE-SRV"), Some("2020-01-01T00:00:00.125"));
        let asked = server.requests().into_iter().rfind(|r| r.contains("startexposure")).unwrap();
        assert!(asked.contains(&format!("Light={light}")), "{kind}: {asked}");
    }
    assert!(camera.set_own("frame_type", "sky", &within(5.0)).is_err());
    let own: Vec<&str> = camera.own_settings().iter().map(|(name, _)| *name).collect();
    assert_eq!(own, ["frame_type"]);
}

/// Truth: a focuser that says that it stands where it was not sent, and a server that closes after each answer: every request makes a new connection, none is lost.
#[test]
fn a_server_that_keeps_no_connection_is_served_all_the_same() {
    let closing = |stream: &mut TcpStream, value: &str| {
        let text = format!(r#"{{"Value":{value},"ErrorNumber":0,"ServerTransactionID":1}}"#);
        let _ = stream.write_all(format!("HTTP/1.0 200 OK\r\n\r\n{text}").as_bytes());
        false
    };
    let server = Scripted::start(Arc::new(move |request, _, stream| match request {
        "GET focuser/0/connected" | "GET focuser/0/absolute" => closing(stream, "true"),
        "GET focuser/0/maxstep" => closing(stream, "1000"),
        "GET focuser/0/position" => closing(stream, "77"),
        "GET focuser/0/ismoving" => closing(stream, "false"),
        _ => closing(stream, "null"),
    }));
    let settings = SessionSettings::default();
    let mut focuser =
        Focuser::open(connect(server.port), &place(server.port), settings, &within(10.0)).unwrap();
    assert_eq!(focuser.move_to(77, &within(10.0)).unwrap(), 77);
    let moves = server.requests().iter().filter(|r| r.starts_with("PUT focuser/0/move ")).count();
    assert_eq!(moves, 1);
}

/// Truth: a link that is cut for good: the stop tries each of its four commands in its own share of the time, and says that it failed.
#[test]
fn a_stop_that_does_not_arrive_is_said() {
    let server = Scripted::start(Arc::new(|request, _, stream| {
        if request.starts_with("PUT ") {
            std::thread::sleep(Duration::from_secs(3));
            return false;
        }
        telescope(request, stream)
    }));
    let mut mount = mount_of(&server);
    let begun = Instant::now();
    let failed = mount.stop(&within(0.8)).unwrap_err();
    assert!(
        matches!(
            failed,
            DeviceError::Transport {
                source: TransportError::Timeout { .. } | TransportError::Disconnected { .. },
                ..
            }
        ),
        "{failed}"
    );
    assert!(begun.elapsed() < Duration::from_secs(4));
    std::thread::sleep(Duration::from_millis(50));
    let asked = server.requests();
    for member in ["moveaxis", "abortslew", "tracking"] {
        assert!(
            asked.iter().any(|r| r.starts_with(&format!("PUT telescope/0/{member}"))),
            "{asked:?}"
        );
    }
}
