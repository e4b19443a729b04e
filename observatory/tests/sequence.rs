//! Sequences through simulated devices behind their protocols: what the frames' headers and the log say against the plan.

#![allow(clippy::unwrap_used, reason = "helper functions of tests")]

use std::path::{Path, PathBuf};
use std::sync::Arc;
use sunglint_drivers::clock::{Cancel, Deadline, DeviceClock};
use sunglint_drivers::device::{
    Camera, Device, DeviceError, FilterWheel, Identity, Limits, PhotonCounter, Setting, Value,
    Window,
};
use sunglint_formats::Frame;
use sunglint_formats::session::{Session, TargetKind, What};
use sunglint_observatory::{
    CameraPlan, Catalogue, CounterPlan, Level, Night, Opener, Plan, PreflightOptions, Summary,
    WheelPlan, preflight,
};

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
    run_with(folder, text, Arc::new(Catalogue))
}

fn run_with(folder: &Path, text: &str, opener: Arc<dyn Opener>) -> (Summary, Session) {
    let plan = plan(folder, text).unwrap();
    let root = folder.join("session");
    let night = Night::planned(plan, opener, Some(&root), "a test");
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
                  [[visit]]\noff = \"dark\"\nframes = 2\nfor_s = 3\n\
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
    let (summary, session) = run(&folder, &format!("{CAMERA}{visits}"));
    // A step without a frame is no good end.
    let missing = summary.check().unwrap_err().to_string();
    assert!(missing.contains("no frames in step 1"), "{missing}");
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
            format!("{CAMERA}{WHEEL}filters = [\"B\", \"V\", \"B\"]\n"),
            visit("for_s = 10"),
            "each name once",
        ),
        (format!("name = \"../../evil\"\n{CAMERA}"), visit("for_s = 10"), "session's folder"),
        (
            ["cam", "guide"]
                .map(|name| {
                    CAMERA
                        .replace("\"cam\"", &format!("\"{name}\""))
                        .replace("sim-camera", "indi-camera:localhost/CCD Simulator")
                })
                .concat(),
            visit("for_s = 10"),
            "camera `cam` is this one already",
        ),
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

/// The catalogue's devices, with a camera whose computer's clock is ahead.
#[derive(Debug)]
struct Ahead(f64);

impl Opener for Ahead {
    fn clock(&self, device: &str) -> DeviceClock {
        Catalogue.clock(device)
    }
    fn camera(&self, plan: &CameraPlan, d: &Deadline) -> Result<Box<dyn Camera>, DeviceError> {
        Ok(Box::new(AheadCamera { camera: Catalogue.camera(plan, d)?, ahead_s: self.0 }))
    }
    fn counter(
        &self,
        plan: &CounterPlan,
        d: &Deadline,
    ) -> Result<Box<dyn PhotonCounter>, DeviceError> {
        Catalogue.counter(plan, d)
    }
    fn wheel(&self, plan: &WheelPlan, d: &Deadline) -> Result<Box<dyn FilterWheel>, DeviceError> {
        Catalogue.wheel(plan, d)
    }
}

struct AheadCamera {
    camera: Box<dyn Camera>,
    ahead_s: f64,
}

impl Device for AheadCamera {
    fn identity(&mut self, d: &Deadline) -> Result<Identity, DeviceError> {
        self.camera.identity(d)
    }
    fn settings(&mut self, d: &Deadline) -> Result<Vec<Setting>, DeviceError> {
        self.camera.settings(d)
    }
    fn own_settings(&self) -> &'static [(&'static str, &'static str)] {
        self.camera.own_settings()
    }
    fn set_own(&mut self, name: &str, value: &str, d: &Deadline) -> Result<Value, DeviceError> {
        self.camera.set_own(name, value, d)
    }
}

impl Camera for AheadCamera {
    fn limits(&self) -> Option<Limits> {
        self.camera.limits()
    }
    fn sensor_px(&self) -> [u32; 2] {
        self.camera.sensor_px()
    }
    fn set_window(&mut self, window: Window, d: &Deadline) -> Result<Window, DeviceError> {
        self.camera.set_window(window, d)
    }
    fn set_gain(&mut self, gain: f64, d: &Deadline) -> Result<f64, DeviceError> {
        self.camera.set_gain(gain, d)
    }
    fn set_temperature_c(&mut self, celsius: f64, d: &Deadline) -> Result<f64, DeviceError> {
        self.camera.set_temperature_c(celsius, d)
    }
    fn expose(&mut self, exposure_s: f64, d: &Deadline) -> Result<Frame, DeviceError> {
        let mut frame = self.camera.expose(exposure_s, d)?;
        frame.start += hifitime::Duration::from_seconds(self.ahead_s);
        frame.header.set("HOSTDIFF", self.ahead_s, "synthetic");
        Ok(frame)
    }
}

/// A camera's computer that is 12 s ahead: each frame belongs to the visit in which it was asked for. Truth: the type that the camera was told, which its driver writes. The log says that the clock is
/// wrong, once.
#[test]
fn a_frame_belongs_to_the_visit_in_which_it_was_asked_for() {
    let folder = folder("ahead");
    let visits = "[[visit]]\noff = \"sky\"\nfor_s = 3\n[[visit]]\noff = \"dark\"\nfor_s = 3\n";
    let text = format!("{CAMERA}interval_s = 0.2\n{visits}");
    let (_, session) = run_with(&folder, &text, Arc::new(Ahead(12.0)));
    let frames = frames(&session);
    let of = |name: &str| frames.iter().filter(|frame| text_of(frame, "OBJECT") == name).count();
    assert!(of("sky") >= 3 && of("dark") >= 3, "{} of {}", of("sky"), frames.len());
    for frame in &frames {
        let expected = if text_of(frame, "OBJECT") == "sky" { "Light" } else { "Dark" };
        assert_eq!(text_of(frame, "FRAME"), expected);
        assert!(text_of(frame, "IMAGETYP").starts_with(expected));
    }
    let told = session.events().unwrap().filter(|event| {
        matches!(&event.as_ref().unwrap().what, What::Error { error, .. } if error.contains("+12.0 s"))
    });
    assert_eq!(told.count(), 1);
    std::fs::remove_dir_all(&folder).unwrap();
}

fn text_of(frame: &Frame, key: &str) -> String {
    text(frame, key).to_owned()
}

/// Dark frames of a sensor that the simulated cooler brings from 20 °C to what is asked, two seconds later. Truth: by hand: where the visit has time all of them are cold; where it has none they are taken
/// all the same, and that is said.
#[test]
fn dark_frames_wait_for_the_cooler_as_long_as_they_can() {
    for (for_s, expected_c) in [(30.0, -10.0), (1.0, 20.0)] {
        let folder = folder(&format!("cooler{for_s}"));
        let visits = format!("[[visit]]\noff = \"dark\"\nframes = 3\nfor_s = {for_s}\n");
        let (summary, session) = run(&folder, &format!("{CAMERA}temperature_c = -10\n{visits}"));
        summary.check().unwrap();
        let frames = frames(&session);
        let warm: Vec<Option<f64>> = frames.iter().map(|frame| frame.temperature_c).collect();
        assert_eq!(warm.first(), Some(&Some(expected_c)), "{warm:?}");
        assert!(expected_c > 0.0 || warm == [Some(-10.0); 3], "{warm:?}");
        let said = session.events().unwrap().filter(|event| {
            matches!(&event.as_ref().unwrap().what, What::Error { error, .. } if error.contains("taken all the same"))
        });
        assert_eq!(said.count(), usize::from(expected_c > 0.0));
        std::fs::remove_dir_all(&folder).unwrap();
    }
}

/// A camera with time between two visits. Truth: by hand: the second visit begins ten seconds after the plan is made, so that a camera that rests has frames of no visit in the last five seconds
/// only; another one has them all the time.
#[test]
fn a_camera_may_rest_between_visits() {
    for rests in [false, true] {
        let folder = folder(&format!("rests-{rests}"));
        let next = hifitime::Epoch::now().unwrap() + hifitime::Duration::from_seconds(10.0);
        let visits = format!(
            "rests_between_visits = {rests}\n[[visit]]\noff = \"dark\"\nframes = 2\nfor_s = 3\n\
             [[visit]]\noff = \"bias\"\nfrom = \"{}Z\"\nexposure_s = 0.001\nframes = 2\n",
            next.to_isoformat()
        );
        let (summary, session) = run(&folder, &format!("{CAMERA}{visits}"));
        summary.check().unwrap();
        let frames = frames(&session);
        let of = |name: &str| frames.iter().filter(|f| text(f, "OBJECT") == name).count();
        assert_eq!((of("dark"), of("bias")), (2, 2));
        let between = frames.iter().filter(|f| !["dark", "bias"].contains(&text(f, "OBJECT")));
        let before_s: Vec<f64> = between.map(|frame| (next - frame.start).to_seconds()).collect();
        let longest_s = before_s.iter().copied().fold(0.0, f64::max);
        assert!(!before_s.is_empty(), "{before_s:?}");
        assert_eq!(longest_s < 5.5, rests, "{before_s:?}");
        std::fs::remove_dir_all(&folder).unwrap();
    }
}

/// A plan that is started eight seconds before its `from`. Truth: by hand: its camera waits until five seconds before it.
#[test]
fn cameras_wait_for_the_night() {
    let folder = folder("waits");
    let from = hifitime::Epoch::now().unwrap() + hifitime::Duration::from_seconds(8.0);
    let visits = "[[visit]]\noff = \"sky\"\nfor_s = 2\n";
    let top = format!("from = \"{}Z\"\n", from.to_isoformat());
    let (summary, session) = run(&folder, &format!("{top}{CAMERA}{visits}"));
    summary.check().unwrap();
    let frames = frames(&session);
    let before_s = frames.iter().map(|frame| (from - frame.start).to_seconds());
    let longest_s = before_s.fold(0.0, f64::max);
    assert!((3.0..5.5).contains(&longest_s), "{longest_s}");
    std::fs::remove_dir_all(&folder).unwrap();
}
