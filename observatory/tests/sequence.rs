//! Sequences through simulated devices behind their protocols: what the frames' headers and the log say against the plan.

#![allow(clippy::unwrap_used, reason = "helper functions of tests")]

use std::path::{Path, PathBuf};
use std::sync::Arc;
use sunglint_drivers::clock::Cancel;
use sunglint_formats::Frame;
use sunglint_formats::session::{Session, TargetKind, What};
use sunglint_observatory::{Catalogue, Level, Night, Plan, PreflightOptions, Summary, preflight};

const CAMERA: &str =
    "[[camera]]\nname = \"cam\"\ndevice = \"sim-camera\"\nexposure_s = 0.05\ngain = 50\n";
const WHEEL: &str = "[[wheel]]\nname = \"wheel\"\ndevice = \"sim-wheel\"\n";

fn folder(name: &str) -> PathBuf {
    let folder =
        std::env::temp_dir().join(format!("sunglint-sequence-{}-{name}", std::process::id()));
    let _ = std::fs::remove_dir_all(&folder);
    std::fs::create_dir_all(&folder).unwrap();
    folder
}

fn plan(folder: &Path, text: &str) -> Result<Plan, String> {
    let path = folder.join("night.toml");
    std::fs::write(&path, format!("station = \"ufo\"\n{text}")).unwrap();
    Plan::read(&path).map_err(|error| error.to_string())
}

fn run(folder: &Path, text: &str) -> (Summary, Session) {
    let plan = plan(folder, text).unwrap();
    let root = folder.join("session");
    let night = Night::planned(plan, Arc::new(Catalogue), Some(&root), "a test");
    let summary = night.run(&Cancel::new(), &mut |_| ()).unwrap();
    (summary, Session::open(&root).unwrap())
}

fn frames(session: &Session) -> Vec<Frame> {
    let mut files = session.frames("cam").unwrap().files;
    files.sort_by_key(|file| file.sequence);
    files.iter().map(|file| file.read().unwrap()).collect()
}

fn text<'a>(frame: &'a Frame, key: &str) -> &'a str {
    frame.header.text(key).unwrap_or("-").trim()
}

/// Three filters twice, then darks, then bias frames. Truth: the plan, by hand: which frames, in which order; the filter's name is what the wheel's own driver
/// calls it.
#[test]
fn a_sequence_is_what_the_frames_say() {
    let folder = folder("filters");
    let visits = "[[visit]]\nstar = \"Vega\"\nfilters = [\"Blue\", \"Green\", \"Red\"]\nrepeat = 2\nframes = 3\nexposure_s = 0.02\ngain = 10\n\
                  [[visit]]\noff = \"dark\"\nframes = 2\n\
                  [[visit]]\noff = \"bias\"\nexposure_s = 0.001\nframes = 2\nwindow_px = [8, 4, 64, 32]\nbinning = 2\n";
    let (summary, session) = run(&folder, &format!("{CAMERA}{WHEEL}{visits}"));
    summary.check().unwrap();
    let one = |frame: &Frame| {
        let gain = frame.header.real("GAIN").unwrap();
        let words = [text(frame, "IMAGETYP"), text(frame, "FILTER")].join(", ");
        (words, frame.exposure_s, gain, frame.pixels.dim())
    };
    let said: Vec<_> = frames(&session).iter().map(one).collect();
    let mut expected = Vec::new();
    for filter in ["Blue", "Green", "Red", "Blue", "Green", "Red"] {
        for _ in 0..3 {
            expected.push((format!("Light Frame, {filter}"), 0.02, 10.0, (120, 160)));
        }
    }
    let dark = ("Dark Frame, Red".to_owned(), 0.05, 50.0, (120, 160));
    let bias = ("Bias Frame, Red".to_owned(), 0.001, 50.0, (16, 32));
    expected.extend([dark.clone(), dark, bias.clone(), bias]);
    assert_eq!(said, expected);
    // The steps of a visit are one stay, and the night ends with its last visit.
    let visits = session.visits().unwrap();
    let kinds: Vec<TargetKind> = visits.iter().map(|visit| visit.target.target_kind).collect();
    assert_eq!(kinds, [TargetKind::Star, TargetKind::Dark, TargetKind::Bias]);
    let length_s = (summary.utc - session.manifest().start_utc).to_seconds();
    assert!(length_s < 20.0, "{length_s} s; planned were more than 100");
    let turned: Vec<String> = session
        .events()
        .unwrap()
        .filter_map(|event| match event.unwrap().what {
            What::Set { device, settings } if device == "wheel" => {
                Some(settings["filter"].as_str().unwrap().to_owned())
            }
            _ => None,
        })
        .collect();
    assert_eq!(turned, ["Blue", "Green", "Red", "Blue", "Green", "Red"]);
    std::fs::remove_dir_all(&folder).unwrap();
}

/// A step that the camera cannot be set for takes no frame and says so; the next is as planned. Too short a step says how many frames it has. Truth: by hand: the
/// simulated camera's gain ends at 100; 30 frames of 0.2 s do not fit into 2 s.
#[test]
fn what_a_step_cannot_have_is_said() {
    let folder = folder("barred");
    let visits = "[[visit]]\nstar = \"Vega\"\ngain = 1000\nfor_s = 1\n\
                  [[visit]]\nstar = \"Deneb\"\nframes = 30\nexposure_s = 0.2\nfor_s = 2\n";
    let (_, session) = run(&folder, &format!("{CAMERA}{visits}"));
    let frames = frames(&session);
    assert!(!frames.is_empty());
    for frame in &frames {
        assert_eq!((text(frame, "OBJECT"), frame.exposure_s), ("Deneb", 0.2));
    }
    let errors: Vec<String> = session
        .events()
        .unwrap()
        .filter_map(|event| match event.unwrap().what {
            What::Error { error, .. } => Some(error),
            _ => None,
        })
        .collect();
    assert!(
        errors.iter().any(|e| e.contains("no frames in step 1") && e.contains("1000")),
        "{errors:?}"
    );
    let short = format!("{} of 30 frames in step 2", frames.len());
    assert!(errors.contains(&short), "{errors:?}");
    std::fs::remove_dir_all(&folder).unwrap();
}

/// A rotator turns before the first frame. Truth: by hand: the angles of the plan.
#[test]
fn a_rotator_stands_where_the_visit_wants_it() {
    let folder = folder("rotator");
    let visits = "[[visit]]\nstar = \"Vega\"\nrotator_deg = 10\nframes = 2\n\
                  [[visit]]\nstar = \"Deneb\"\nrotator_deg = 15\nframes = 2\n";
    let rotator = "[[rotator]]\nname = \"rot\"\ndevice = \"sim-rotator\"\n";
    let (summary, session) = run(&folder, &format!("{CAMERA}{rotator}{visits}"));
    summary.check().unwrap();
    let said: Vec<(String, f64)> = frames(&session)
        .iter()
        .map(|f| (text(f, "OBJECT").to_owned(), f.header.real("ROTATANG").unwrap().round()))
        .collect();
    let expected = [("Vega", 10.0), ("Vega", 10.0), ("Deneb", 15.0), ("Deneb", 15.0)];
    assert_eq!(said, expected.map(|(name, deg)| (name.to_owned(), deg)));
    std::fs::remove_dir_all(&folder).unwrap();
}

/// Plans that no night can follow, each with the words that name what is wrong. Truth: by hand.
#[test]
fn impossible_sequences_are_refused() {
    let folder = folder("refused");
    let visit = |keys: &str| format!("[[visit]]\nstar = \"Vega\"\n{keys}\n");
    let plain = CAMERA.replace("gain = 50\n", "");
    for (devices, visits, expected) in [
        (CAMERA.to_owned(), visit("for_s = 10\nfilter = \"Red\""), "[[wheel]]"),
        (
            format!("{CAMERA}{WHEEL}"),
            visit("for_s = 10\nfilter = \"Red\"\nfilters = [\"Red\"]"),
            "not both",
        ),
        (CAMERA.to_owned(), visit("for_s = 10\nrotator_deg = 3"), "[[rotator]]"),
        (plain, visit("for_s = 10\ngain = 3"), "to which it returns"),
        (CAMERA.to_owned(), visit("repeat = 2"), "`for_s`, `to` or `frames`"),
        (CAMERA.to_owned(), visit("for_s = 10\nframes = 0"), "1 or more"),
        (CAMERA.to_owned(), visit("for_s = 10\nlevel_adu = 20000"), "flat"),
        (CAMERA.to_owned(), visit("for_s = 10\ncamera.cat.gain = 3"), "names of cameras"),
        (CAMERA.to_owned(), "[[visit]]\noff = \"bias\"\nfor_s = 10\n".into(), "shortest exposure"),
        (
            format!("{CAMERA}{WHEEL}filters = [\"B\", \"V\"]\n"),
            visit("for_s = 10\nfilter = \"R\""),
            "it has B, V",
        ),
    ] {
        let error = plan(&folder, &format!("{devices}{visits}")).unwrap_err();
        assert!(error.contains(expected), "{visits}: {error}");
    }
    // What only the devices know is said by the pre-flight.
    let visits = visit("frames = 3\nfilter = \"Ultraviolet\"") + &visit("frames = 3\ngain = 1000");
    let plan = plan(&folder, &format!("for_s = 100\n{CAMERA}{WHEEL}{visits}")).unwrap();
    let opener: Arc<dyn sunglint_observatory::Opener> = Arc::new(Catalogue);
    let found = preflight(&plan, &opener, &PreflightOptions::default());
    let errors: Vec<&str> = found.of(Level::Error).map(|finding| finding.text.as_str()).collect();
    assert!(
        errors.iter().any(|e| e.contains("`Ultraviolet`") && e.contains("Clear, Red")),
        "{errors:?}"
    );
    assert!(errors.iter().any(|e| e.contains("gain is 1000")), "{errors:?}");
    std::fs::remove_dir_all(&folder).unwrap();
}
