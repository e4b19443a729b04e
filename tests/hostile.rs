//! Nights beside INDI servers that do wrong: the other devices lose nothing, memory stays bounded, the night ends in time.

#![allow(clippy::unwrap_used, reason = "in helpers too, a failure should stop the run")]

use crate::common::Folder;
use crate::common::hostile::{DEVICE, Hostile, KINDS};
use crate::common::night::bins;
use std::process::{Command, Stdio};
use std::time::Duration;
use sunglint_drivers::clock::computer_utc;
use sunglint_formats::CountFlags;
use sunglint_formats::session::{Session, What};
use sunglint_testkit::Campaign;

/// Time between two frames of the healthy camera, s.
const EVERY_S: f64 = 0.5;

/// How a night beside hostile servers went.
#[derive(Debug)]
struct Outcome {
    code: Option<i32>,
    /// Most memory of the program, MB (VmHWM).
    peak_mb: f64,
    /// How much later than the healthy counter's last bin the program ended, s.
    late_s: f64,
    /// Bins that are missing between those that are there.
    bins_lost: f64,
    /// Turns of the healthy camera without a frame, between those with one.
    frames_lost: f64,
    bins: usize,
    frames: usize,
    /// How often a healthy device was lost or refused something.
    troubles: usize,
    /// Lines of the log.
    lines: usize,
    /// Frames of each hostile camera, and how many of them are not what was asked for.
    taken: Vec<(&'static str, usize, usize)>,
}

/// A night of so many seconds with a simulated camera and counter and a server of each of these kinds.
fn night(kinds: &[&'static str], seconds: f64) -> Outcome {
    let folder = Folder::new("hostile");
    let servers: Vec<(&str, Hostile)> =
        kinds.iter().map(|&kind| (kind, Hostile::start(kind))).collect();
    let mut plan = format!(
        "station = \"ufo\"\nfor_s = {seconds}\n\
         [[camera]]\nname = \"healthy\"\ndevice = \"sim-camera\"\nexposure_s = 0.1\ninterval_s = {EVERY_S}\n\
         [[counter]]\nname = \"tagger\"\ndevice = \"sim-timetagger\"\nchannels = {{ g = 1, r = 2 }}\nbin_s = 0.1\n"
    );
    for (kind, server) in &servers {
        let place = &server.place;
        plan += &format!(
            "[[camera]]\nname = \"{kind}\"\ndevice = \"indi-camera:{place}/{DEVICE}\"\nexposure_s = 0.1\n"
        );
    }
    plan += &format!("[[visit]]\noff = \"sky\"\nfor_s = {seconds}\n");
    std::fs::write(folder.0.join("night.toml"), plan).unwrap();
    let mut program = Command::new(crate::common::program())
        .args(["observe", "night.toml", "--anyway", "-o", "s"])
        .current_dir(&folder.0)
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    let status = format!("/proc/{}/status", program.id());
    let mut peak_kb = 0.0_f64;
    let code = loop {
        if let Some(code) = program.try_wait().unwrap() {
            break code.code();
        }
        let text = std::fs::read_to_string(&status).unwrap_or_default();
        let line = text.lines().find_map(|line| line.strip_prefix("VmHWM:"));
        let number = line.and_then(|l| l.split_whitespace().next()?.parse::<f64>().ok());
        peak_kb = peak_kb.max(number.unwrap_or(0.0));
        std::thread::sleep(Duration::from_millis(20));
    };
    let ended = computer_utc();
    let session = Session::open(folder.0.join("s")).unwrap();
    let bins = bins(&session);
    let last = bins.last().unwrap();
    let last_end = last.start + hifitime::Duration::from_seconds(last.length_ps as f64 * 1e-12);
    let gap = |pair: &[sunglint_formats::CountRecord]| {
        let [one, next] = pair else { return 0.0 };
        ((next.start_ps - one.start_ps - one.length_ps) as f64 / one.length_ps as f64).abs()
    };
    let flagged = bins.iter().filter(|bin| bin.flags.contains(CountFlags::GAP)).count();
    let healthy = session.frames("healthy").unwrap().files;
    let starts: Vec<_> = healthy.iter().map(|file| file.read().unwrap().start).collect();
    let turns = starts.windows(2).map(|p| ((p[1] - p[0]).to_seconds() / EVERY_S).round() - 1.0);
    let events: Vec<What> = session.events().unwrap().map(|event| event.unwrap().what).collect();
    let own = |device: &str| device == "healthy" || device == "tagger";
    let troubles = events.iter().filter(|what| match what {
        What::DeviceLost { device, .. }
        | What::DeviceFailed { device, .. }
        | What::FramesRefused { device, .. } => own(device),
        _ => false,
    });
    let taken = kinds.iter().map(|&kind| {
        let files = session.frames(kind).unwrap().files;
        let frames = files.iter().map(|file| file.read().unwrap());
        let false_ones = frames.filter(|f| f.exposure_s != 0.1 || f.pixels.dim() != (48, 64));
        (kind, files.len(), false_ones.count())
    });
    Outcome {
        code,
        peak_mb: peak_kb / 1024.0,
        late_s: (ended - last_end).to_seconds(),
        bins_lost: bins.windows(2).map(gap).sum::<f64>() + flagged as f64,
        frames_lost: turns.sum(),
        bins: bins.len(),
        frames: starts.len(),
        troubles: troubles.count(),
        lines: events.len(),
        taken: taken.collect(),
    }
}

/// Servers of every kind, eight at a time, in nights of 4 s. Truth: the healthy devices' own grids: no bin is missing, no healthy device is lost; the program ends by itself with
/// the code of a night in which a camera gave nothing. Frames are taken where a server is only talkative, never where it lies about them.
#[test]
fn hostile_servers_hold_up_no_other_device() {
    // In an order that mixes floods with silence.
    let mut order: Vec<&str> = KINDS.to_vec();
    order.sort_by_key(|kind| KINDS.iter().position(|k| k == kind).map(|i| i * 11 % KINDS.len()));
    for kinds in order.chunks(8) {
        let outcome = night(kinds, 4.0);
        eprintln!("{outcome:?}");
        assert_eq!((outcome.code, outcome.troubles), (Some(1), 0), "{outcome:?}");
        assert!(outcome.bins_lost == 0.0 && outcome.bins >= 20, "{outcome:?}");
        assert!(outcome.frames >= 2, "{outcome:?}");
        assert!(outcome.lines < 500, "{outcome:?}");
        for (kind, taken, false_ones) in &outcome.taken {
            assert_eq!(*false_ones, 0, "{kind} gave frames that are not ours: {outcome:?}");
            if !GIVE_FRAMES.contains(kind) {
                assert_eq!(*taken, 0, "{kind} gave a frame that it did not take: {outcome:?}");
            }
        }
    }
}

/// Servers among whose words there are true frames.
const GIVE_FRAMES: [&str; 6] = [
    "message_flood",
    "long_messages",
    "update_flood",
    "duplicate_device",
    "flapping_device",
    "frame_flood",
];

/// One server of each kind, a minute each (floods before the first definition ten), beside a healthy camera and counter. In a run of the suite the first two kinds for 3 s.
#[test]
fn campaign_hostile_servers() {
    let columns = &["peak_mb", "late_s", "bins_lost", "frames_lost", "troubles", "taken"];
    let mut campaign = Campaign::in_shards("hostile_servers", KINDS.len() as u64, 2, columns);
    let whole = std::env::var("SUNGLINT_CAMPAIGN").is_ok_and(|name| name == "hostile_servers");
    for seed in campaign.seeds() {
        let kind = KINDS[seed as usize];
        let seconds = match (whole, kind) {
            (false, _) => 3.0,
            (true, "flood_before") => 600.0,
            (true, _) => 60.0,
        };
        let outcome = night(&[kind], seconds);
        eprintln!("{seed} {kind}: {outcome:?}");
        let taken = outcome.taken[0].1 as f64;
        let Outcome { peak_mb, late_s, bins_lost, frames_lost, troubles, .. } = outcome;
        let values = [peak_mb, late_s, bins_lost, frames_lost, troubles as f64, taken];
        campaign.keep(seed, &values);
    }
    let most = |name: &str| campaign.column(name).into_iter().fold(0.0, f64::max);
    let [bins_lost, troubles] = ["bins_lost", "troubles"].map(most);
    let [peak_mb, late_s, frames_lost] = ["peak_mb", "late_s", "frames_lost"].map(most);
    assert!(bins_lost == 0.0 && troubles == 0.0, "{bins_lost} bins, {troubles} losses");
    campaign.largest("bins_lost", bins_lost);
    campaign.largest("losses_of_healthy_devices", troubles);
    if whole {
        // What depends on the machine's other work is judged in the whole campaign alone.
        assert!(peak_mb < 300.0, "{peak_mb} MB");
        campaign.largest("peak_mb", peak_mb);
        campaign.largest("late_s", late_s);
        campaign.largest("frames_lost", frames_lost);
    }
    campaign.finish();
}
