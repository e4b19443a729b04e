//! Frame grabbers through the program: films and numbered images as the cameras of a night, and a program that was built without OpenCV.

#![allow(clippy::unwrap_used, reason = "in helpers too, a failure should stop the run")]

use crate::common::Folder;
use std::path::{Path, PathBuf};

/// The film that FFmpeg made.
fn film() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/films/spot.avi")
}

/// A night whose camera is a recording of frames of 0.04 s, with a first visit of ten of its frames.
fn plan(device: &str, more: &str) -> String {
    format!(
        r#"
station = "ufo"
from = "2026-11-24T21:00:00Z"

[[camera]]
name = "cam"
device = "opencv:{device}"
exposure_s = 0.04
with = ["first_utc=2026-11-24T21:00:00Z", "exposure_s=0.04", "interval_s=0.04"]
{more}
[[visit]]
off = "sky"
for_s = 0.4

[[visit]]
star = "Vega"
for_s = 10
"#
    )
}

/// Without OpenCV every way to a grabber says how to get it, and fails.
#[cfg(not(feature = "opencv"))]
#[test]
fn a_program_without_opencv_says_so() {
    let folder = Folder::new("no-opencv");
    let film = film();
    let address = format!("opencv:{}", film.display());
    let output = folder.run(&["devices", "check", &address]);
    let message = String::from_utf8(output.stderr).unwrap();
    assert!(output.status.code() == Some(1) && message.contains("--features opencv"), "{message}");
    std::fs::write(folder.path("night.toml"), plan(film.to_str().unwrap(), "")).unwrap();
    let output = folder.run(&["observe", "night.toml", "-o", "session"]);
    let message = String::from_utf8([output.stdout, output.stderr].concat()).unwrap();
    assert!(!output.status.success() && message.contains("--features opencv"), "{message}");
}

#[cfg(feature = "opencv")]
mod with_opencv {
    use super::*;
    use crate::common::night::frames;
    use crate::common::virtual_night::{observe, plan_of};
    use hifitime::Epoch;
    use std::fmt::Write as _;
    use std::time::Duration;
    use sunglint_drivers::clock::Deadline;
    use sunglint_drivers_opencv::Recorder;
    use sunglint_formats::session::{Session, TargetKind};
    use sunglint_formats::time::{format_utc, parse_utc};
    use sunglint_formats::{Frame, Table, ecsv};

    const SIZE: [usize; 2] = [64, 48];

    fn bytes(frame: &Frame) -> Vec<u8> {
        frame.pixels.iter().map(|pixel| u8::try_from(*pixel).unwrap()).collect()
    }

    /// Truth: the pixels as FFmpeg decodes them (`spot.gray`), each exact; the times that the plan says of the film; ten frames belong to
    /// the first visit and ten to the second.
    #[test]
    fn a_film_is_observed_to_the_pixel() {
        let folder = Folder::with_opencv("film");
        // As seen from the plan, not from where the program runs.
        std::fs::create_dir(folder.path("plans")).unwrap();
        std::fs::copy(film(), folder.path("plans/spot.avi")).unwrap();
        std::fs::write(folder.path("plans/night.toml"), plan("spot.avi", "")).unwrap();
        let text = folder.done(&["observe", "plans/night.toml", "--check"]);
        assert!(text.contains("cam") && text.contains("64 × 48"), "{text}");
        folder.done(&["observe", "plans/night.toml", "-o", "session"]);
        let session = Session::open(folder.path("session")).unwrap();
        assert_eq!(session.manifest().clock.method, "recording");
        let truth = std::fs::read(film().with_extension("gray")).unwrap();
        let (all, begun) = (frames(&session), parse_utc("2026-11-24T21:00:00Z").unwrap());
        assert_eq!(all.len(), 20);
        for (i, (number, frame)) in all.iter().enumerate() {
            assert_eq!(*number, i as u64 + 1);
            assert_eq!(bytes(frame), truth[i * SIZE[0] * SIZE[1]..][..SIZE[0] * SIZE[1]], "{i}");
            let start: Epoch = begun + hifitime::Duration::from_seconds(0.04 * i as f64);
            assert!((frame.start - start).to_seconds().abs() < 1e-6, "{i}");
            let name = if i < 10 { "sky" } else { "Vega" };
            assert_eq!(frame.header.text("OBJECT"), Some(name), "{i}");
        }
        folder.done(&["session", "check", "session"]);
        // What can be gone on with is a live night.
        let message = folder.refused(1, &["observe", "--resume", "session"]);
        assert!(message.contains("recordings"), "{message}");
        // A part of the frame.
        let part = plan("spot.avi", "window_px = [8, 16, 32, 20]\n");
        std::fs::write(folder.path("plans/part.toml"), part).unwrap();
        folder.done(&["observe", "plans/part.toml", "-o", "part"]);
        let first = frames(&Session::open(folder.path("part")).unwrap()).swap_remove(0).1;
        let expected: Vec<u8> =
            (16..36).flat_map(|y| truth[y * SIZE[0] + 8..][..32].to_vec()).collect();
        assert_eq!((first.origin, bytes(&first)), ([8, 16], expected));
        let address = format!("opencv:{}", film().display());
        let with = ["--with", "first_utc=2026-11-24T21:00:00Z", "--with", "exposure_s=0.04"];
        let text = folder.done(&[&["devices", "check", &address][..], &with].concat());
        assert!(text.contains("identity  OpenCV (") && text.contains("at most 217 ADU"), "{text}");
        let film = ["devices", "record", &address, "-o", "film.rec", "--", "check"];
        assert!(folder.refused(1, &film).contains("nothing of it can be written down"));
    }

    /// Truth: the pixels as FFmpeg decodes them, taken row by row: a film's frame gives its even rows first, its odd rows 20 ms later; and with a gamma of 0.45 each number n as 65 535 (n / 255)^(1/0.45),
    /// to the rounding.
    #[test]
    fn an_interlaced_film_is_observed_field_by_field() {
        let folder = Folder::with_opencv("fields");
        let plan = plan(film().to_str().unwrap(), "");
        let truth = std::fs::read(film().with_extension("gray")).unwrap();
        let begun = parse_utc("2026-11-24T21:00:00Z").unwrap();
        for (name, more) in [("plain", ""), ("bent", ", \"gamma=0.45\"")] {
            let plan = plan.replace("exposure_s = 0.04\n", "exposure_s = 0.02\n").replace(
                "\"interval_s=0.04\"]",
                &format!("\"interval_s=0.04\", \"fields=top\"{more}]"),
            );
            assert!(plan.contains("fields=top") && plan.contains("exposure_s = 0.02"), "{plan}");
            std::fs::write(folder.path("night.toml"), plan).unwrap();
            folder.done(&["observe", "night.toml", "-o", name]);
            folder.done(&["session", "check", name]);
            let fields = frames(&Session::open(folder.path(name)).unwrap());
            assert_eq!(fields.len(), 40, "{name}");
            for (i, (_, field)) in fields.iter().enumerate() {
                let (frame, second) = (i / 2, i % 2);
                let start: Epoch = begun + hifitime::Duration::from_seconds(0.02 * i as f64);
                assert!((field.start - start).to_seconds().abs() < 1e-6, "{name} {i}");
                assert_eq!((field.exposure_s, field.binning), (0.02, [1, 2]), "{name} {i}");
                let side = ["top", "bottom"][second];
                assert_eq!(field.header.text("FIELD").map(str::trim), Some(side), "{name} {i}");
                assert_eq!(field.pixels.dim(), (SIZE[1] / 2, SIZE[0]));
                for ((row, column), found) in field.pixels.indexed_iter() {
                    let number = truth[(frame * SIZE[1] + 2 * row + second) * SIZE[0] + column];
                    let light = match more {
                        "" => f64::from(number),
                        _ => 65_535.0 * (f64::from(number) / 255.0).powf(1.0 / 0.45),
                    };
                    let off = (f64::from(*found) - light).abs();
                    assert!(off <= 0.5 + 1e-6, "{name} {i} {row} {column}: {found} {light}");
                }
            }
        }
    }

    /// Each of these is said, with what to do, and no exit code calls it a night: another exposure than the film's, a film that is cut
    /// off, none at all, one without times, a plan without a beginning, live devices beside it.
    #[test]
    fn what_is_wrong_with_a_film_is_said() {
        let folder = Folder::with_opencv("film-wrong");
        let film = film();
        let at = film.to_str().unwrap();
        let good = plan(at, "");
        let tried = |name: &str, text: &str, code: i32| {
            std::fs::write(folder.path(&format!("{name}.toml")), text).unwrap();
            let output = folder.run(&["observe", &format!("{name}.toml"), "-o", name]);
            let message = [output.stdout, output.stderr].concat();
            let message = String::from_utf8(message).unwrap();
            assert_eq!(output.status.code(), Some(code), "{name}: {message}");
            message
        };
        let other = good.replace("exposure_s = 0.04", "exposure_s = 0.02");
        let message = tried("exposure", &other, 1);
        assert!(message.contains("cam"), "{message}");
        let log = std::fs::read_to_string(folder.path("exposure/events.jsonl")).unwrap();
        assert!(
            log.contains("it was exposed 0.04 s by its recording, 0.02 s by the plan"),
            "{log}"
        );
        let half = std::fs::read(&film).unwrap();
        std::fs::write(folder.path("half.avi"), &half[..half.len() / 2]).unwrap();
        let message = tried("cut", &plan("half.avi", ""), 1);
        assert!(message.contains("damaged, or cut off"), "{message}");
        let none = plan("none.avi", "");
        assert!(tried("none", &none, 1).contains("none.avi"));
        let times = good.replace("with = [", "with = [] # ");
        assert!(tried("times", &times, 1).contains("without it nobody knows when the frames"));
        let from = good.replace("from = ", "# ");
        assert!(tried("from", &from, 1).contains("the recording's first frame"));
        let interval = plan(at, "interval_s = 1.0\n");
        assert!(tried("interval", &interval, 1).contains("come when they were taken"));
        let counter = "\n[[counter]]\nname = \"tagger\"\ndevice = \"sim-timetagger\"\nchannels = { g = 1 }\nbin_s = 0.1\n";
        let beside = tried("beside", &plan(at, counter), 1);
        assert!(beside.contains("counter[0].device") && beside.contains("cam is one"), "{beside}");
        for (option, expected) in [
            ("format=grey16", "an option of a live grabber"),
            ("interval_s=0.04", "first_utc and exposure_s together"),
            ("first_utc=yesterday", "a time in UTC"),
        ] {
            let address = format!("opencv:{at}");
            let arguments = ["devices", "check", &address, "--with", option];
            let message = folder.run(&arguments);
            let message = String::from_utf8(message.stderr).unwrap();
            assert!(message.contains(expected), "{option}: {message}");
        }
    }

    /// Truth: a night with the virtual camera's own frames: recorded as numbered images, played as a grabber's and reduced, its rates are the same
    /// numbers in each channel of the camera, and each pixel is.
    #[test]
    fn a_night_as_numbered_images_gives_the_same_rates() {
        let folder = Folder::with_opencv("film-night");
        let options = "seed = 5\n[plan]\nstars = 2\nvisit_s = 20\nsky_s = 8\nslew_s = 2\ndark_s = 8\nv_mag = [2.5, 4.5]\n";
        observe(&folder.0, &plan_of(&[]), options);
        let old = Session::open(folder.path("session")).unwrap();
        let recorded = frames(&old);
        let mut recorder = Recorder::create(folder.path("night_%05d.png"), 10.0).unwrap();
        for (_, frame) in &recorded {
            recorder.write(frame).unwrap();
        }
        let within = Deadline::within(Duration::from_secs(120));
        assert_eq!(recorder.finish(&within).unwrap().frames, recorded.len() as u64);
        let begun = format_utc(old.manifest().start_utc, 3);
        let mut plan = format!(
            "station = \"ufo\"\nfrom = \"{begun}\"\n[[camera]]\nname = \"cam\"\ndevice = \"opencv:night_%05d.png\"\nexposure_s = 0.5\n"
        );
        for visit in old.visits().unwrap() {
            let target = visit.target;
            let what = match target.target_kind {
                TargetKind::Star => format!(
                    "name = \"{}\"\nra_deg = {}\ndec_deg = {}",
                    target.name,
                    target.ra_deg.unwrap(),
                    target.dec_deg.unwrap()
                ),
                kind => format!("off = {}", serde_json::to_value(kind).unwrap()),
            };
            let (from, to) = (format_utc(visit.from, 3), format_utc(visit.to.unwrap(), 3));
            let _ = write!(plan, "[[visit]]\n{what}\nfrom = \"{from}\"\nto = \"{to}\"\n");
        }
        std::fs::write(folder.path("film.toml"), plan).unwrap();
        folder.done(&["observe", "film.toml", "-o", "film"]);
        let new = frames(&Session::open(folder.path("film")).unwrap());
        assert_eq!(new.len(), recorded.len());
        for ((_, new), (number, old)) in new.iter().zip(&recorded) {
            assert_eq!((&new.pixels, new.start), (&old.pixels, old.start), "{number}");
        }
        let reduced = |session: &str| {
            let out = format!("{session}-out/");
            let json = folder.json(&["reduce", session, "-o", &out, "--json"]);
            let files = json["visits"].as_array().unwrap().iter();
            let read = |visit: &serde_json::Value| {
                let file = folder.path(&format!("{out}{}", visit["file"].as_str().unwrap()));
                ecsv::read(file).unwrap()
            };
            files.map(read).collect::<Vec<_>>()
        };
        let (before, after) = (reduced("session"), reduced("film"));
        assert_eq!((before.len(), after.len()), (2, 2));
        for (before, after) in before.iter().zip(&after) {
            for channel in ["r", "g", "b"] {
                let column = format!("{channel}_rate_hz");
                let of = |table: &Table| -> Vec<f64> {
                    let all = table.f64(&column).unwrap();
                    all.iter().copied().filter(|rate| rate.is_finite()).collect()
                };
                assert_eq!(of(before), of(after), "{channel}");
                assert_eq!(of(before).len(), 10, "{channel}");
            }
        }
    }
}
