//! The recorded conversations of `fixtures/indi`: each replays strictly, in memory, and ends as it did.
//!
//! They were recorded from the simulators of indi-bin 1.9.9, live; `SUNGLINT_UPDATE=1` records them anew.
#![allow(clippy::unwrap_used, reason = "helper functions of tests")]

use crate::common::indi::{CAMERA, ROTATOR, Server, WHEEL, live};
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;
use sunglint_drivers::clock::{Clock, Deadline, SystemClock, VirtualClock};
use sunglint_drivers::device::{
    Camera as _, Device as _, FilterWheel as _, RotationStage as _, Window,
};
use sunglint_drivers::indi::{
    Camera, CameraSettings, RotatorSettings, SessionSettings, Wanted, open_camera, open_rotator,
    open_wheel,
};
use sunglint_drivers::recording::{Event, Header, Recorded, Recording, Replay};
use sunglint_drivers::transport::Bytes;
use sunglint_formats::Frame;
use sunglint_formats::atomic::Overwrite;
use sunglint_formats::time::format_utc;
use sunglint_formats::time::parse_utc;
use sunglint_testkit::{fixture, peer_python, run_python};

/// How a session went, in words that a clock does not change.
type Words = Vec<String>;

struct Host {
    clock: Arc<dyn Clock>,
    words: Words,
}

impl Host {
    fn within(&self, seconds: u64) -> Deadline {
        Deadline::after(self.clock.clone(), Duration::from_secs(seconds))
    }

    fn say<R: std::fmt::Debug, E: std::fmt::Display>(&mut self, result: Result<R, E>) {
        self.words.push(match result {
            Ok(value) => format!("{value:?}"),
            Err(error) => without_time(&error.to_string()),
        });
    }

    fn camera<T: Bytes>(&mut self, line: T, packed: bool) -> Camera<T> {
        // The host's time of the recording: its server's is kept.
        let utc = || parse_utc("2026-11-21T19:01:47Z").unwrap();
        let settings = CameraSettings { packed, utc, ..CameraSettings::default() };
        open_camera(line, CAMERA, settings, &self.within(20)).unwrap()
    }
}

/// The text without how long something took, and what came at last, which depends on it.
fn without_time(text: &str) -> String {
    match text.split_once(" did not come within") {
        Some((before, _)) => format!("{before} did not come"),
        None => text.to_owned(),
    }
}

fn small(x: u32, y: u32) -> Window {
    Window { origin_px: [x, y], size_px: [12, 10], binning: [1, 1] }
}

fn describe(frame: &Frame) -> String {
    let sum: u64 = frame.pixels.iter().map(|&pixel| u64::from(pixel)).sum();
    format!(
        "{} {:?} at {:?} {:?} {} s {:?} °C gain {:?} sum {sum}",
        format_utc(frame.start, 3),
        frame.pixels.dim(),
        frame.origin,
        frame.bayer,
        frame.exposure_s,
        frame.temperature_c,
        frame.header.real("GAIN")
    )
}

type Session = fn(&mut Host, Box<dyn Bytes>);

fn camera_good(host: &mut Host, line: Box<dyn Bytes>) {
    let mut camera = host.camera(line, false);
    host.say(camera.identity(&host.within(5)));
    let on = Wanted::Switches(&[("INDI_ENABLED", true), ("INDI_DISABLED", false)]);
    host.say(camera.configure("SIMULATE_BAYER", on, &host.within(5)));
    host.say(camera.set_window(small(501, 400), &host.within(5)));
    host.say(camera.set_gain(42.0, &host.within(5)));
    host.say(camera.expose(0.2, &host.within(5)).map(|frame| describe(&frame)));
    host.say(camera.set_temperature_c(-5.0, &host.within(5)));
    host.say(camera.expose(0.1, &host.within(5)).map(|frame| describe(&frame)));
}

fn camera_alert(host: &mut Host, line: Box<dyn Bytes>) {
    let mut camera = host.camera(line, false);
    let exposure = Wanted::Numbers(&[("CCD_EXPOSURE_VALUE", -1.0)]);
    host.say(camera.configure("CCD_EXPOSURE", exposure, &host.within(5)));
    host.say(camera.set_window(small(0, 0), &host.within(5)));
    host.say(camera.expose(0.05, &host.within(5)).map(|frame| describe(&frame)));
}

fn camera_no_blob(host: &mut Host, line: Box<dyn Bytes>) {
    let mut camera = host.camera(line, false);
    host.say(camera.set_window(small(0, 0), &host.within(5)));
    let local = [("UPLOAD_CLIENT", false), ("UPLOAD_LOCAL", true), ("UPLOAD_BOTH", false)];
    host.say(camera.configure("UPLOAD_MODE", Wanted::Switches(&local), &host.within(5)));
    host.say(camera.expose(0.1, &host.within(3)).map(|frame| describe(&frame)));
}

fn camera_fz(host: &mut Host, line: Box<dyn Bytes>) {
    let mut camera = host.camera(line, true);
    host.say(camera.set_window(small(0, 0), &host.within(5)));
    host.say(camera.expose(0.1, &host.within(5)).map(|frame| describe(&frame)));
}

fn camera_lost(host: &mut Host, line: Box<dyn Bytes>) {
    let mut camera = host.camera(line, false);
    let crash = Wanted::Switches(&[("CRASH", true)]);
    host.say(camera.configure("CCD_SIMULATE_CRASH", crash, &host.within(5)));
    host.say(camera.expose(0.1, &host.within(5)).map(|frame| describe(&frame)));
}

fn rotator(host: &mut Host, line: Box<dyn Bytes>) {
    let settings = RotatorSettings::default();
    let mut rotator = open_rotator(line, ROTATOR, settings, &host.within(20)).unwrap();
    host.say(rotator.move_to(5.5, &host.within(10)));
    let late = rotator.move_to(90.0, &host.within(2));
    host.words
        .push(format!("it was stopped at a place: {}", late.as_ref().unwrap_err().done.is_some()));
    host.say(late);
    host.say(
        rotator.sync(33.0, &host.within(5)).map_err(|error| {
            error.to_string().split(", the device says").next().unwrap().to_owned()
        }),
    );
}

fn wheel(host: &mut Host, line: Box<dyn Bytes>) {
    let settings = SessionSettings::default();
    let mut wheel = open_wheel(line, WHEEL, settings, &host.within(20)).unwrap();
    host.words.push(wheel.names().join(" "));
    host.say(wheel.select(3, &host.within(5)));
    host.say(wheel.slot(&host.within(5)));
    host.say(wheel.select(8, &host.within(5)));
}

/// Name, driver, what the host does, and what must be in its words, one by one. Times and sums of pixels are the recording's.
fn cases() -> Vec<(&'static str, &'static str, Session, Vec<&'static str>)> {
    vec![
        (
            "camera_good",
            "ccd",
            camera_good as Session,
            vec![
                "Identity { vendor: \"INDI, indi_simulator_ccd\", model: \"CCD Simulator\"",
                "()",
                "Window { origin_px: [501, 400], size_px: [12, 10], binning: [1, 1] }",
                "42.0",
                "(10, 12) at [501, 400] Some(Grbg) 0.2 s Some(0.0) °C gain Some(42.0) sum",
                "0.0",
                "(10, 12) at [501, 400] Some(Grbg) 0.1 s Some(-",
            ],
        ),
        (
            "camera_alert",
            "ccd",
            camera_alert,
            vec![
                "INDI camera refused CCD_EXPOSURE CCD_EXPOSURE_VALUE=-1: [ERROR] Requested exposure value (-1) seconds out of bounds [0.01,3600].",
                "Window",
                "(10, 12) at [0, 0] None 0.05 s Some(0.0) °C gain Some(90.0) sum",
            ],
        ),
        (
            "camera_no_blob",
            "ccd",
            camera_no_blob,
            vec!["Window", "()", "INDI camera: the frame of an exposure of 0.1 s did not come"],
        ),
        (
            "camera_fz",
            "ccd",
            camera_fz,
            vec![
                "Window",
                "INDI camera: the frame came tile-compressed (.fits.fz), which is not read",
            ],
        ),
        (
            "camera_lost",
            "ccd",
            camera_lost,
            vec![
                "INDI camera: the driver of `CCD Simulator` has ended (delProperty); connect again once it is back",
                "INDI camera: ",
            ],
        ),
        (
            "rotator",
            "rotator",
            rotator,
            vec![
                "5.5",
                "it was stopped at a place: true",
                "INDI rotator: the answer to ABS_ROTATOR_ANGLE ANGLE=90 did not come",
                "INDI rotator: angle, deg was set to 33",
            ],
        ),
        (
            "wheel",
            "wheel",
            wheel,
            vec!["Red Green Blue H_Alpha SII OIII LPR Luminance", "3", "3", "8"],
        ),
    ]
}

fn run(session: Session, line: Box<dyn Bytes>, clock: Arc<dyn Clock>) -> Words {
    let mut host = Host { clock, words: Words::new() };
    session(&mut host, line);
    host.words
}

fn check(name: &str, words: &Words, expected: &[&str]) {
    assert_eq!(words.len(), expected.len(), "{name}: {words:#?}");
    for (said, part) in words.iter().zip(expected) {
        assert!(said.contains(part), "{name}: `{said}` has no `{part}`");
    }
}

/// Puts what the device said between two sentences of the host into one line.
fn joined(recording: Recording) -> Recording {
    let mut events: Vec<Event> = Vec::new();
    let mut pause = Duration::ZERO;
    for (_, event) in recording.events {
        match event {
            Event::Pause(time) => pause += time,
            Event::Received(more) => match events.last_mut() {
                Some(Event::Received(data)) => data.extend(more),
                _ => {
                    events.push(Event::Pause(pause));
                    events.push(Event::Received(more));
                    pause = Duration::ZERO;
                }
            },
            other => {
                pause = Duration::ZERO;
                events.push(other);
            }
        }
    }
    events.retain(|event| *event != Event::Pause(Duration::ZERO));
    Recording::new(recording.header, events)
}

fn record(name: &str, driver: &str, session: Session, expected: &[&str], path: &Path) {
    let server = Server::start(&[driver]);
    let header = Header {
        device: format!("INDI {driver} simulator"),
        source: "indi-bin 1.9.9 (Debian 1.9.9+dfsg-2+b1)".into(),
        host: Some("sunglint's INDI driver".into()),
        recorded: Some(format_utc(hifitime::Epoch::now().unwrap(), 0)[..10].to_owned()),
        synthetic: false,
    };
    let line = Recorded::create(server.connect(), path, &header, Overwrite::Allow).unwrap();
    let words = run(session, Box::new(line), Arc::new(SystemClock));
    eprintln!("{name}: {words:#?}");
    check(name, &words, expected);
    let text = joined(Recording::read(path).unwrap()).to_text().unwrap();
    std::fs::write(path, text).unwrap();
}

/// A replay that can be looked at after the session that owned it.
struct Shared(Arc<std::sync::Mutex<Replay>>);

impl Bytes for Shared {
    fn send(
        &mut self,
        bytes: &[u8],
        deadline: &Deadline,
    ) -> Result<(), sunglint_drivers::transport::TransportError> {
        self.0.lock().unwrap().send(bytes, deadline)
    }

    fn receive(
        &mut self,
        buffer: &mut [u8],
        deadline: &Deadline,
    ) -> Result<usize, sunglint_drivers::transport::TransportError> {
        self.0.lock().unwrap().receive(buffer, deadline)
    }

    fn discard(
        &mut self,
        deadline: &Deadline,
    ) -> Result<Vec<u8>, sunglint_drivers::transport::TransportError> {
        self.0.lock().unwrap().discard(deadline)
    }
}

/// Truth: the words above; the server's bytes as recorded, the host's byte for byte.
#[test]
fn every_recording_ends_as_it_did() {
    if std::env::var_os("SUNGLINT_UPDATE").is_some() {
        live("every_recording_ends_as_it_did", || {
            for (name, driver, session, expected) in cases() {
                record(name, driver, session, &expected, &fixture(&format!("indi/{name}.rec")));
            }
        });
    }
    for (name, _, session, expected) in cases() {
        let recording = Recording::read(fixture(&format!("indi/{name}.rec"))).unwrap();
        assert!(!recording.header.synthetic && recording.header.source.contains("indi-bin 1.9.9"));
        let line = Arc::new(std::sync::Mutex::new(Replay::new(recording)));
        let words = run(session, Box::new(Shared(line.clone())), Arc::new(VirtualClock::new()));
        check(name, &words, &expected);
        let line = Arc::into_inner(line).unwrap().into_inner().unwrap();
        line.finish().unwrap_or_else(|error| panic!("{name}: {error}"));
    }
}

/// Truth: astropy's reading of the frames in the recording: their sums and their DATE-OBS.
#[test]
fn astropy_reads_the_recorded_frames_the_same() {
    let name = "astropy_reads_the_recorded_frames_the_same";
    let Some(python) = peer_python(name, &["astropy"]) else { return };
    let script = r#"
import sys, re, base64, io
from astropy.io import fits
data = open(sys.argv[1], "rb").read()
for text in re.findall(rb"<oneBLOB[^>]*>([^<]*)</oneBLOB>", data):
    hdu = fits.open(io.BytesIO(base64.b64decode(b"".join(text.split()))))[0]
    print(hdu.header["DATE-OBS"], int(hdu.data.astype("int64").sum()))
"#;
    let recording = Recording::read(fixture("indi/camera_good.rec")).unwrap();
    let bytes: Vec<u8> = recording
        .events
        .iter()
        .filter_map(
            |(_, event)| if let Event::Received(data) = event { Some(data.clone()) } else { None },
        )
        .flatten()
        .collect();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("bytes");
    std::fs::write(&path, bytes).unwrap();
    let theirs = run_python(&python, script, &[path.to_str().unwrap()]);
    let words = run(camera_good, Box::new(Replay::new(recording)), Arc::new(VirtualClock::new()));
    let ours: Vec<String> = words
        .iter()
        .filter_map(|words| {
            let (start, rest) = words.trim_matches('"').split_once('Z')?;
            Some(format!("{start} {}", rest.rsplit_once("sum ")?.1))
        })
        .collect();
    assert_eq!(ours, theirs.lines().collect::<Vec<_>>());
    assert_eq!(ours.len(), 2);
}
