//! When a camera exposes: measured by a lamp, taken off the times of frames, and what a frame says where it was not measured.

#![allow(clippy::unwrap_used, reason = "in helpers too, a failure should stop the run")]

use crate::common::Folder;
use hifitime::{Epoch, Unit};
use std::sync::Arc;
use std::time::Duration;
use sunglint_drivers::clock::{Deadline, VirtualClock};
use sunglint_drivers::device::Camera as _;
use sunglint_formats::atomic::Overwrite;
use sunglint_formats::ecsv;
use sunglint_formats::time::parse_utc;
use sunglint_observatory::begin_doubt_s;
use sunglint_radiometry::light_curve::{
    ChannelCurve, Flags, LightCurve, Provenance, RateKind, Samples,
};
use sunglint_radiometry::sky::EarthOrientation;
use sunglint_radiometry::station::Station;
use sunglint_virtual::observatory::devices::VirtualObservatory;

const START: &str = "2020-11-18T18:00:00Z";

fn start() -> Epoch {
    parse_utc(START).unwrap()
}

/// A plan of a camera and a counter, both virtual.
fn plan(options: &str, visits: &str) -> String {
    format!(
        "station = \"ufo\"\nfrom = \"{START}\"\nvirtual = \"{options}\"\n[[camera]]\nname = \"cam\"\ndevice = \"virtual\"\nexposure_s = 0.1\nwindow_px = [645, 469, 100, 100]\n\
         [[counter]]\nname = \"tagger\"\ndevice = \"virtual\"\nchannels = {{ spcm = 1 }}\nbin_s = 0.01\n{visits}"
    )
}

const LAMP: &str = "[lamp]\ne_per_px_s = 20000\nhz = 50000\non_s = 0.06\n";
const SKY: &str = "[[visit]]\noff = \"sky\"\nfor_s = 90\n";

fn late(folder: &Folder, name: &str, camera: &str, lamp: &str) {
    let options = format!("{name}-virtual.toml");
    std::fs::write(folder.path(&options), format!("[camera]\nreadout_s = 0.037\n{camera}\n{lamp}"))
        .unwrap();
    let night = format!("{name}.toml");
    std::fs::write(folder.path(&night), plan(&options, SKY)).unwrap();
    folder.done(&["observe", &night, "-o", name, "-q"]);
}

/// Brightness of a train of flashes 0.4 s long at unequal times, s after the night's begin.
fn train(time_s: f64) -> f64 {
    let begins = [3.0, 4.1, 6.4, 7.9, 10.7, 11.6, 14.3, 17.1, 18.2, 21.9, 24.0, 26.6];
    let flash = |begin: f64| {
        let part = (time_s - begin) / 0.4;
        if (0.0..1.0).contains(&part) {
            0.5 - 0.5 * (std::f64::consts::TAU * part).cos()
        } else {
            0.0
        }
    };
    0.1 + begins.into_iter().map(flash).sum::<f64>()
}

/// Shift of samples against the train, s: where a straight line of its mean over each exposure leaves least.
fn shift_s(curve: &LightCurve, channel: &str) -> f64 {
    let rates = &curve.channels.iter().find(|c| c.name == channel).unwrap().rate_hz;
    let samples: Vec<(f64, f64, f64)> = (0..rates.len())
        .filter(|i| rates[*i].is_finite())
        .map(|i| {
            let middle_s = (curve.samples.time[i] - start()).to_seconds();
            (middle_s, curve.samples.exposure_s[i], rates[i])
        })
        .collect();
    assert!(samples.len() > 60, "{channel}: {}", samples.len());
    let left = |shift_s: f64| {
        let model = |(middle_s, exposure_s, _): &(f64, f64, f64)| {
            let at = |i: u32| middle_s + shift_s + exposure_s * ((f64::from(i) + 0.5) / 20.0 - 0.5);
            (0..20).map(|i| train(at(i))).sum::<f64>() / 20.0
        };
        let model: Vec<f64> = samples.iter().map(model).collect();
        let n = samples.len() as f64;
        let (x, y) = (model.iter().sum::<f64>() / n, samples.iter().map(|s| s.2).sum::<f64>() / n);
        let xx: f64 = model.iter().map(|m| (m - x).powi(2)).sum();
        let xy: f64 = model.iter().zip(&samples).map(|(m, s)| (m - x) * (s.2 - y)).sum();
        samples.iter().map(|s| (s.2 - y).powi(2)).sum::<f64>() - xy * xy / xx
    };
    let shifts = (-700..=700).map(|ms| f64::from(ms) * 1e-3);
    shifts.min_by(|a, b| left(*a).total_cmp(&left(*b))).unwrap()
}

/// Truth: a camera that begins 0.23 s late ± 20 ms, and a train of flashes whose formula stands here. The camera's curve and the counter's each fit it best at some shift; the two agree within
/// 10 ms once the measured latency is taken off (asked; 2.2 ms are what 80 frames with 20 ms leave), and are 0.23 s apart before.
#[test]
fn camera_and_counter_agree_on_a_train_of_flashes() {
    let folder = Folder::new("timing-train");
    let camera = "latency_s = 0.23\nlatency_jitter_s = 0.02";
    late(&folder, "lamp", camera, LAMP);
    let found =
        folder.json(&["timing", "lamp", "--timing-out", "timing.toml", "-o", "t/", "--json"]);
    let of = |key: &str| found["cameras"][0][key].as_f64().unwrap();
    let (latency_s, sigma_s) = (of("latency_s"), of("latency_sigma_s"));
    assert!((latency_s - 0.23).abs() < 3.0 * sigma_s && sigma_s < 5e-3, "{found}");
    assert!((of("jitter_s") / 0.02 - 1.0).abs() < 0.4, "{found}");
    assert!(found["cameras"][0]["row_time_s"].is_null(), "{found}");

    let times: Vec<Epoch> =
        (0..6000).map(|i| start() + f64::from(i) * 0.005 * Unit::Second).collect();
    let channel = |name: &str, most: f64| ChannelCurve {
        name: name.into(),
        rate_hz: (0..6000).map(|i| most * train(f64::from(i) * 0.005)).collect(),
        sigma_hz: vec![0.0; 6000],
        flags: vec![Flags::empty(); 6000],
        model_error_hz: None,
        common_sigma_hz: None,
    };
    let curve = LightCurve {
        kind: RateKind::Predicted,
        samples: Samples::new(times, 0.005),
        channels: vec![
            channel("spcm", 3e6),
            channel("r", 4e5),
            channel("g", 4e5),
            channel("b", 4e5),
        ],
        provenance: Provenance { target: "train".into(), ..Provenance::default() },
        other: sunglint_formats::Meta::default(),
    };
    let table = curve.to_table().unwrap();
    ecsv::write_file(folder.path("train.ecsv"), &table, Overwrite::Refuse).unwrap();
    let options = format!(
        "[camera]\nreadout_s = 0.037\n{camera}\n[scintillation]\nstrength = 0\n[pointing]\njitter_px = 0\naim_scatter_px = 0\n[seeing]\nscatter = 0\n\
         [[visit]]\nkind = \"satellite\"\nname = \"train\"\ncurve = \"train.ecsv\"\nfrom_s = 1\nto_s = 29\n[[visit]]\nkind = \"sky\"\nfrom_s = 29\nto_s = 32\n"
    );
    std::fs::write(folder.path("train-virtual.toml"), options).unwrap();
    std::fs::write(folder.path("train.toml"), plan("train-virtual.toml", "")).unwrap();
    folder.done(&["observe", "train.toml", "-o", "train", "-q"]);
    let apart_s = |output: &str, more: &[&str]| {
        let arguments = [&["reduce", "train", "-o", output, "-q"], more].concat();
        folder.done(&arguments);
        let path = folder.path(&format!("{output}train_1.ecsv"));
        let curve = LightCurve::from_table(&path, &ecsv::read(&path).unwrap()).unwrap();
        let notes = curve.provenance.notes.join("\n");
        (shift_s(&curve, "g") - shift_s(&curve, "spcm"), notes)
    };
    let (before_s, notes) = apart_s("before/", &[]);
    assert!((before_s - 0.23).abs() < 0.02, "{before_s}");
    assert!(notes.contains("latency is not measured"), "{notes}");
    let (after_s, notes) = apart_s("after/", &["--timing", "timing.toml"]);
    assert!(after_s.abs() < 0.01, "{after_s}");
    assert!(notes.contains("measured latency is taken off"), "{notes}");
    // The times of another binning are no times of these frames: said, and the frames are as before.
    let text = std::fs::read_to_string(folder.path("timing.toml")).unwrap();
    std::fs::write(folder.path("other.toml"), text.replace("[1, 1]", "[2, 2]")).unwrap();
    let said = folder.run(&["reduce", "train", "-o", "other/", "--timing", "other.toml"]);
    let said = String::from_utf8_lossy(&said.stderr).into_owned();
    assert!(said.contains("keep their own times") && said.contains("other.toml"), "{said}");
}

/// Truth: a sensor whose rows begin 0.3 ms apart, 30 ms over the frame, with a first row 0.31 s late; within three of the stated uncertainties.
#[test]
fn rows_that_begin_one_after_the_other() {
    let folder = Folder::new("timing-rows");
    late(&folder, "rows", "latency_s = 0.31\nlatency_jitter_s = 0.002\nrow_time_s = 3e-4", LAMP);
    let found = folder.json(&["timing", "rows", "--json"]);
    let of = |key: &str| found["cameras"][0][key].as_f64().unwrap_or(f64::NAN);
    assert!((of("row_time_s") - 3e-4).abs() < 3.0 * of("row_time_sigma_s"), "{found}");
    assert!(of("row_time_sigma_s") < 3e-5, "{found}");
    assert!((of("latency_s") - 0.31).abs() < 3.0 * of("latency_sigma_s"), "{found}");
}

/// Truth: the begins that the virtual camera drew. A frame's begin is within twice the stated uncertainty (TIMSYER, half of the bound) in all of 800 frames with latencies of 0.05 to 0.5 s and 20 ms
/// of jitter; asked are 95 %.
#[test]
fn a_latency_that_nobody_measured_is_within_what_frames_say() {
    let station = Station::built_in("ufo").unwrap().unwrap();
    let folder = Folder::new("timing-bound");
    for latency_s in [0.05, 0.15, 0.3, 0.5] {
        let options = format!(
            "[camera]\nlatency_s = {latency_s}\nlatency_jitter_s = 0.02\nreadout_s = 0.03\n[[visit]]\nkind = \"sky\"\nfrom_s = 0\nto_s = 1000\n"
        );
        let path = folder.path("virtual.toml");
        std::fs::write(&path, options).unwrap();
        let made = VirtualObservatory::read(&path, &station, start(), EarthOrientation::embedded())
            .unwrap();
        let mut camera = made.camera().unwrap();
        let clock = Arc::new(VirtualClock::new());
        let deadline = |s: f64| Deadline::after(clock.clone(), Duration::from_secs_f64(s));
        camera
            .set_window(
                sunglint_drivers::device::Window {
                    origin_px: [600, 400],
                    size_px: [8, 8],
                    binning: [1, 1],
                },
                &deadline(1.0),
            )
            .unwrap();
        for _ in 0..200 {
            let asked_s = deadline(0.0).now().as_secs_f64();
            let frame = camera.expose(0.1, &deadline(10.0)).unwrap();
            let took_s = deadline(0.0).now().as_secs_f64() - asked_s;
            let asked = start() + asked_s * Unit::Second;
            let bound_s = begin_doubt_s(frame.start, frame.exposure_s, asked, took_s);
            let said_s = (frame.start - start()).to_seconds();
            let off_s = camera.last_truth().unwrap().start_s - said_s;
            assert!(off_s >= 0.0 && off_s <= bound_s + 1e-6, "{latency_s}: {off_s} {bound_s}");
            // As tight as can be: it is off by no more than the readout beside the latency.
            assert!(bound_s < latency_s + 0.03 + 0.1, "{latency_s}: {bound_s}");
        }
    }
}

/// Truth: by hand: no lamp, no session, a range that is none.
#[test]
fn what_no_latency_comes_from_is_said() {
    let folder = Folder::new("timing-none");
    late(&folder, "dark", "latency_s = 0.2", "");
    for (arguments, said, code) in [
        (vec!["timing", "dark"], "does not follow its counts", 1),
        (vec!["timing", "dark", "--channel", "g"], "no channel g", 1),
        (vec!["timing", "dark", "--camera", "other"], "no camera other", 1),
        (vec!["timing", "nowhere"], "nowhere", 1),
        (vec!["timing", "dark", "--most-s", "-1"], "--most-s is -1", 2),
    ] {
        let output = folder.run(&arguments);
        let stderr = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(stderr.contains(said), "{arguments:?}: {stderr}");
        assert_eq!(output.status.code(), Some(code), "{arguments:?}: {stderr}");
    }
    let frames = folder.path("dark");
    let one = walk(&frames).into_iter().find(|path| path.extension().is_some_and(|e| e == "fits"));
    let frame = sunglint_formats::Frame::read(one.unwrap()).unwrap();
    // By hand: 0.2 s latency and 37 ms readout: off by up to 0.237 s.
    let half_s = frame.header.real("TIMSYER").unwrap();
    assert!((half_s - 0.1185).abs() < 1e-3, "{half_s}");
    assert!(frame.header.text("DATE-END").is_some());
}

fn walk(folder: &std::path::Path) -> Vec<std::path::PathBuf> {
    let mut found = Vec::new();
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() { found.extend(walk(&path)) } else { found.push(path) }
    }
    found.sort();
    found
}
