//! A virtual night through the devices.
#![allow(clippy::unwrap_used, reason = "helper functions of tests")]

use hifitime::Epoch;
use std::ops::ControlFlow;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;
use sunglint_drivers::clock::{Clock, Deadline, VirtualClock};
use sunglint_drivers::device::{Camera, Device as _, PhotonCounter, Window};
use sunglint_drivers::indi::{CameraSettings, open_camera};
use sunglint_drivers::simulated::indi::{CameraSpec, Server, ServerSettings, Simulated};
use sunglint_drivers::simulated::swabian::Light as _;
use sunglint_drivers::tags::Tag;
use sunglint_formats::time::parse_utc;
use sunglint_radiometry::sky::EarthOrientation;
use sunglint_radiometry::station::Station;
use sunglint_virtual::observatory::devices::{ThroughLight, ThroughScene, VirtualObservatory};

const BIN_PS: i64 = 100_000_000_000;

fn start() -> Epoch {
    parse_utc("2020-11-18T18:00:00Z").unwrap()
}

fn file(text: &str) -> (tempfile::TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("virtual.toml");
    std::fs::write(&path, text).unwrap();
    (folder, path)
}

fn read(text: &str) -> anyhow::Result<VirtualObservatory> {
    let (_folder, path) = file(text);
    let station = Station::built_in("ufo").unwrap().unwrap();
    Ok(VirtualObservatory::read(path, &station, start(), EarthOrientation::embedded())?)
}

const NIGHT: &str = r#"
seed = 7
[pointing]
aim_px = [0.0, 8.0]
[[visit]]
kind = "star"
name = "Capella"
from_s = 0
to_s = 60
[[visit]]
kind = "dark"
from_s = 60
to_s = 90
"#;

struct Desk(Arc<VirtualClock>);

impl Desk {
    fn new() -> Self {
        Self(Arc::new(VirtualClock::new()))
    }

    fn within(&self, seconds: u64) -> Deadline {
        Deadline::after(self.0.clone(), Duration::from_secs(seconds))
    }
}

/// Truth: arithmetic on the clock. Frames begin when they are asked for and end an exposure later; bins follow each other without a gap and are given once,
/// and the same night is the same in every piece.
#[test]
fn a_night_comes_through_its_devices() {
    let observatory = read(NIGHT).unwrap();
    let desk = Desk::new();
    let mut camera = observatory.camera().unwrap();
    let window = Window { origin_px: [595, 419], size_px: [200, 200], binning: [1, 1] };
    assert_eq!(camera.set_window(window, &desk.within(1)).unwrap(), window);
    desk.0.sleep(Duration::from_millis(1500));
    let frame = camera.expose(2.0, &desk.within(5)).unwrap();
    assert_eq!(desk.0.now(), Duration::from_millis(3500));
    assert_eq!((frame.start - start()).to_seconds(), 1.5);
    assert_eq!((frame.origin, frame.pixels.dim()), ([595, 419], (200, 200)));
    // RGGB from an odd column and an odd row is BGGR; the station's gain; full wells end before the converter.
    assert_eq!(frame.bayer.unwrap().name(), "BGGR");
    assert_eq!((frame.gain_e_per_adu, frame.saturation_adu), (Some(0.27), Some(65_535.0)));
    assert!(frame.pixels.iter().any(|adu| *adu == 65_535), "Capella saturates in 2 s");
    let truth = camera.last_truth().unwrap().offset_px.unwrap();
    assert!(truth[0].abs() < 20.0 && (truth[1] - 8.0).abs() < 20.0);
    let mut starts = Vec::new();
    let mut take = |frame: sunglint_formats::Frame| {
        starts.push((frame.start - start()).to_seconds());
        if starts.len() == 3 { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    };
    assert_eq!(camera.stream(0.5, &mut take, &desk.within(5)).unwrap(), 3);
    assert_eq!(starts, [3.5, 4.0, 4.5]);

    let counted = |pieces: &[usize]| {
        let desk = Desk::new();
        let mut counter = observatory.counter(&["spcm".into(), "id400".into()]).unwrap();
        counter.start(BIN_PS, &desk.within(1)).unwrap();
        let bins: Vec<_> = (pieces.iter())
            .flat_map(|bins| counter.read(*bins, &desk.within(200)).unwrap())
            .collect();
        assert!((desk.0.now().as_secs_f64() - 0.1 * bins.len() as f64).abs() < 1e-9);
        bins
    };
    let whole = counted(&[850]);
    assert_eq!(whole, counted(&[1, 400, 49, 400]));
    for (i, bin) in whole.iter().enumerate() {
        assert_eq!((bin.start_ps, bin.length_ps), (i as i64 * BIN_PS, BIN_PS));
        assert!(((bin.start - start()).to_seconds() - 0.1 * i as f64).abs() < 1e-6);
    }
    let mean = |bins: &[sunglint_formats::CountRecord]| {
        bins.iter().map(|bin| bin.counts[0] as f64).sum::<f64>() / bins.len() as f64 * 10.0
    };
    // The dark rate of the station's file, 825 Hz, over 25 s: five sigma; and a bright star.
    assert!((mean(&whole[600..]) - 825.0).abs() < 5.0 * (825.0_f64 / 25.0).sqrt());
    assert!(mean(&whole[..600]) > 1e5, "{}", mean(&whole[..600]));
}

/// Truth: the night itself, asked directly: what comes through the protocols of the simulated INDI server and Time Tagger is of the same light.
#[test]
fn a_night_comes_through_the_protocols() {
    let observatory = read(NIGHT).unwrap();
    let desk = Desk::new();
    let night = observatory.night();
    let spec = CameraSpec { sensor_px: [1391, 1039], ..CameraSpec::default() };
    let settings =
        ServerSettings { camera: Some(spec), epoch: start(), ..ServerSettings::default() };
    let server = Server::new(settings, ThroughScene::new(&observatory));
    let mut camera = open_camera(
        Simulated::new(server),
        "Simulated Camera",
        CameraSettings::default(),
        &desk.within(10),
    )
    .unwrap();
    let window = Window { origin_px: [595, 419], size_px: [200, 200], binning: [1, 1] };
    camera.set_window(window, &desk.within(5)).unwrap();
    let frame = camera.expose(1.0, &desk.within(30)).unwrap();
    assert_eq!(frame.pixels.dim(), (200, 200));
    // A bright star in the middle, and the bias of 300 ADU with a noise of 15 in the corner.
    assert_eq!(frame.pixels.slice(ndarray::s![90..120, 85..115]).iter().max(), Some(&65_535));
    let corner = frame.pixels.slice(ndarray::s![..20, ..20]).mapv(f64::from).mean().unwrap();
    assert!(corner > 299.0 && corner < 1000.0, "{corner}");

    let mut light = ThroughLight::new(&observatory, 0);
    let mut tags: Vec<Tag> = Vec::new();
    light.tags(&[2, 1, 9], 10 * BIN_PS, 11 * BIN_PS, &mut tags);
    assert!(tags.is_sorted_by_key(|tag| tag.time_ps));
    let bin = light.bin(&[2, 1, 9], 10 * BIN_PS, 11 * BIN_PS);
    let of = |channel| tags.iter().filter(|tag| tag.channel == channel).count() as u64;
    assert_eq!(bin.counts, [of(2), of(1), 0]);
    // Input 2 is the spcm: the same light as the bins of the device, to six sigma of both.
    let mut watch = sunglint_virtual::observatory::watch::Watch::new(night.clone());
    let counters = watch.counters();
    let counts = watch.counts(&counters[1..2], 10 * BIN_PS..11 * BIN_PS)[0] as f64;
    assert!((of(2) as f64 - counts).abs() < 6.0 * (2.0 * counts).sqrt(), "{} {counts}", of(2));
}

/// Truth: each refusal has the file, the line and the key; the truth names κ and the visits.
#[test]
fn a_file_is_read_strictly_and_the_truth_is_told() {
    let said = |text: &str| format!("{:#}", read(text).unwrap_err());
    let error = said("seed = 1\n[pointing]\njitter_arcsec = 2\n");
    assert!(error.contains("virtual.toml:3: pointing.jitter_arcsec"), "{error}");
    let error = said("[seeing]\nfwhm_arcsec = -1\n");
    assert!(error.contains("virtual.toml:2: seeing.fwhm_arcsec"), "{error}");
    assert!(error.contains("a number above 0"), "{error}");
    let error = said("[[visit]]\nkind = \"satellite\"\nfrom_s = 0\nto_s = 1\n");
    assert!(error.contains("needs a `curve`"), "{error}");
    let error = said("[[visit]]\nkind = \"satellite\"\nfrom_s = 0\nto_s = 1\ncurve = \"no.ecsv\"");
    assert!(error.contains("no.ecsv"), "{error}");
    let observatory = read(NIGHT).unwrap();
    let error = observatory.counter(&["r".into()]).unwrap_err().to_string();
    assert_eq!(error, "channel: found r, expected one of id400, spcm, mppc");
    assert_eq!(observatory.counter_channels(), ["id400", "spcm", "mppc"]);
    let truth: serde_json::Value = serde_json::from_str(&observatory.truth().unwrap()).unwrap();
    assert_eq!(truth["kappa"]["spcm"], 29.64);
    assert_eq!(truth["visits"][0]["name"], "Capella");
    assert_eq!(truth["visits"][1]["kind"], "dark");
    let mut camera = observatory.camera().unwrap();
    let identity = camera.identity(&Desk::new().within(1)).unwrap();
    assert_eq!(identity.driver, "virtual");
    let beyond = Window { origin_px: [1300, 0], size_px: [100, 10], binning: [1, 1] };
    assert!(camera.set_window(beyond, &Desk::new().within(1)).is_err());
}
