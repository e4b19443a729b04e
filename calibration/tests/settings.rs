//! A night with two filters and two exposures, each with its own dark, bias and flat frames. The frames are made here, electron by electron: nothing of the reduction
//! is used for them.

#![allow(clippy::unwrap_used, reason = "helper functions of tests")]

use hifitime::Epoch;
use ndarray::Array2;
use rand::SeedableRng as _;
use rand_distr::{Distribution as _, Normal, Poisson};
use rand_xoshiro::Xoshiro256PlusPlus;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use sunglint_calibration::reduction::{ReduceOptions, Reduced, Visited, reduce};
use sunglint_formats::Frame;
use sunglint_formats::fits::Header;
use sunglint_formats::session::{
    ClockState, Device, DeviceKind, Disk, FORMAT, Manifest, Session, SessionWriter, Target,
    TargetKind, What,
};
use sunglint_formats::time::parse_utc;
use sunglint_numerics::progress::Silent;
use sunglint_radiometry::light_curve::Flags;
use sunglint_radiometry::station::Station;

const SIDE: usize = 96;
/// Electrons for one ADU, read noise in electrons.
const GAIN: f64 = 1.5;
const READ_E: f64 = 4.0;
/// The star's electrons a second behind each filter, where the sensor sees best.
const STAR_E: [(&str, f64, f64); 2] = [("R", 0.5, 60_000.0), ("B", 1.0, 20_000.0)];
const PLACE: [f64; 2] = [22.3, 24.8];

fn station(folder: &Path, filters: &[&str]) -> Station {
    let mut text = String::from(
        "name = \"two\"\ndescription = \"synthetic\"\n[site]\nlatitude_deg = 48.8\nlongitude_deg = 9.2\nheight_m = 400\n\
         [telescope]\nprimary_diameter_m = 0.4\nobstruction_diameter_m = 0.1\nfocal_length_m = 2\nmount = \"equatorial\"\n[air]\nprofile = \"midlatitude_winter\"\n\
         [camera]\nname = \"made\"\nwidth_px = 96\nheight_px = 96\npixel_size_um = 5\ngain_e_per_adu = 1.5\nread_noise_e = 4\nfull_well_e = 90000\nadc_bits = 16\n",
    );
    for filter in filters {
        text += &format!(
            "[[channel]]\nname = \"{}\"\ncamera_plane = \"L\"\nfilter = \"{filter}\"\nefficiency = \"all.csv\"\n",
            filter.to_lowercase()
        );
    }
    std::fs::write(folder.join("all.csv"), "wavelength_nm,efficiency\n400,0.5\n700,0.5\n").unwrap();
    let path = folder.join("station.toml");
    std::fs::write(&path, text).unwrap();
    Station::read(&path).unwrap()
}

/// How well a pixel sees: from 1 in the middle to 0.6 in the corners, in another way behind each filter.
fn response(filter: &str, row: usize, column: usize) -> f64 {
    let middle = if filter == "R" { 48.0 } else { 60.0 };
    let r2 = (row as f64 - middle).powi(2) + (column as f64 - middle).powi(2);
    1.0 - 0.4 * r2 / (2.0 * 60.0 * 60.0)
}

struct Maker {
    rng: Xoshiro256PlusPlus,
    /// Dark current of every second column, e/s.
    warm_e: f64,
}

impl Maker {
    /// A frame of a light that falls on each pixel, e/s, behind a filter.
    fn frame(
        &mut self,
        start: Epoch,
        exposure_s: f64,
        filter: &str,
        light: &dyn Fn(usize, usize) -> f64,
    ) -> Frame {
        let pixels = Array2::from_shape_fn((SIDE, SIDE), |(row, column)| {
            // Every second column is warmer: a dark of another exposure would leave that.
            let dark = if column % 2 == 1 { self.warm_e } else { 300.0 };
            let mean = (light(row, column) * response(filter, row, column) + dark) * exposure_s;
            let electrons = Poisson::new(mean).unwrap().sample(&mut self.rng);
            let read = Normal::new(0.0, READ_E).unwrap().sample(&mut self.rng);
            ((electrons + read) / GAIN + 500.0).round().clamp(0.0, 65535.0) as u16
        });
        let mut header = Header::default();
        header.set("FILTER", filter, "");
        Frame {
            pixels,
            origin: [0, 0],
            binning: [1, 1],
            bayer: None,
            start,
            exposure_s,
            gain_e_per_adu: None,
            temperature_c: Some(-10.0),
            saturation_adu: None,
            header,
        }
    }
}

struct Made {
    darks: bool,
    bias: bool,
    flats: bool,
    /// Filters of the star's frames.
    filters: &'static [(&'static str, f64, f64)],
}

fn session(root: &Path, made: &Made) -> Session {
    let start = parse_utc("2026-02-11T20:00:00Z").unwrap();
    let camera = Device {
        name: "cam".into(),
        kind: DeviceKind::Camera,
        address: "made".into(),
        options: vec![],
        channels: vec![],
        inputs: vec![],
        raw_tags: false,
        exposure_s: 0.5,
        interval_s: None,
        filter: None,
    };
    let clock =
        ClockState { method: "none".into(), synchronised: None, offset_s: None, error_s: None };
    let manifest = Manifest {
        format: FORMAT.into(),
        program: "a test".into(),
        station: "two".into(),
        start_utc: start,
        clock,
        devices: vec![camera],
        files: vec![],
    };
    let mut writer = SessionWriter::create(Arc::new(Disk), root, &manifest, &[]).unwrap();
    let warm_e = if made.darks { 700.0 } else { 300.0 };
    let mut maker = Maker { rng: Xoshiro256PlusPlus::seed_from_u64(20_260_211), warm_e };
    let (mut now, mut number) = (start, 0);
    let mut take = |writer: &mut SessionWriter,
                    now: &mut Epoch,
                    exposure_s: f64,
                    filter: &str,
                    light: &dyn Fn(usize, usize) -> f64| {
        number += 1;
        let frame = maker.frame(*now, exposure_s, filter, light);
        assert!(writer.frame("cam", number, &frame).unwrap().is_none());
        *now += hifitime::Duration::from_seconds(exposure_s + 0.1);
    };
    if made.bias {
        writer.event(now, What::Target(Target::off(TargetKind::Bias)));
        for _ in 0..8 {
            take(&mut writer, &mut now, 0.001, "R", &|_, _| 0.0);
        }
    }
    if made.darks {
        writer.event(now, What::Target(Target::off(TargetKind::Dark)));
        for (_, exposure_s, _) in STAR_E {
            for _ in 0..12 {
                take(&mut writer, &mut now, exposure_s, "B", &|_, _| 0.0);
            }
        }
    }
    if made.flats {
        writer.event(now, What::Target(Target::off(TargetKind::Flat)));
        for filter in ["R", "B"] {
            // The sky fades: each exposure is another one.
            for k in 0..8 {
                take(&mut writer, &mut now, 0.2 + 0.02 * f64::from(k), filter, &|_, _| 2e5);
            }
        }
    }
    let star = Target {
        name: "Vega".into(),
        target_kind: TargetKind::Star,
        on: true,
        ra_deg: Some(279.2347),
        dec_deg: Some(38.7837),
        tle: None,
        omm: None,
    };
    writer.event(now, What::Target(star));
    for _ in 0..3 {
        for (filter, exposure_s, star_e) in made.filters {
            for _ in 0..6 {
                let sigma = 1.9_f64;
                let light = |row: usize, column: usize| {
                    let r2 = (column as f64 - PLACE[0]).powi(2) + (row as f64 - PLACE[1]).powi(2);
                    let star = star_e / (std::f64::consts::TAU * sigma * sigma)
                        * (-0.5 * r2 / (sigma * sigma)).exp();
                    // Without flats an even sky would not look even.
                    star + if made.flats { 200.0 } else { 10.0 }
                };
                take(&mut writer, &mut now, *exposure_s, filter, &light);
            }
        }
    }
    assert_eq!(writer.finish(now, "done").lost, 0);
    Session::open(root).unwrap()
}

fn reduced(name: &str, filters: &[&str], made: &Made) -> (Reduced, Visited) {
    let folder: PathBuf =
        std::env::temp_dir().join(format!("sunglint-settings-{}-{name}", std::process::id()));
    let _ = std::fs::remove_dir_all(&folder);
    std::fs::create_dir_all(&folder).unwrap();
    let station = station(&folder, filters);
    let session = session(&folder.join("night"), made);
    let options = ReduceOptions::for_station(&station);
    let mut night = reduce(&session, &station, &options, &Silent).unwrap();
    let visited = night.take(&session, &station).unwrap().unwrap();
    std::fs::remove_dir_all(&folder).unwrap();
    (night, visited)
}

/// The mean rate of a channel over its samples, e/s, its standard error, and how many samples that is.
fn mean_e(visited: &Visited, name: &str) -> (f64, f64, usize) {
    let channel = visited.linear.channels.iter().find(|channel| channel.name == name).unwrap();
    let rates: Vec<f64> = channel.rate_hz.iter().copied().filter(|rate| rate.is_finite()).collect();
    let n = rates.len() as f64;
    let mean = rates.iter().sum::<f64>() / n;
    let variance = rates.iter().map(|rate| (rate - mean).powi(2)).sum::<f64>() / (n - 1.0);
    (GAIN * mean, GAIN * (variance / n).sqrt(), rates.len())
}

/// Each filter gives its channel, calibrated by its own frames. Truth: the electrons that were put in, times the mean response of the sensor (a flat is normalised to
/// its median, within 1 % of the mean here). Tolerance: four standard errors, and 2 % for what lies outside the aperture and for the flat's median.
#[test]
fn each_filter_is_calibrated_by_its_own_frames() {
    let made = Made { darks: true, bias: true, flats: true, filters: &STAR_E };
    let (night, visited) = reduced("both", &["R", "B"], &made);
    let camera = &night.cameras[0];
    assert_eq!((camera.sensor.darks, camera.sensor.flats, camera.settings), ([24, 0], [16, 0], 2));
    assert!(camera.failed.is_empty() && camera.warnings.is_empty(), "{:?}", camera.warnings);
    for (filter, exposure_s, star_e) in STAR_E {
        let mut all: Vec<f64> =
            (0..SIDE * SIDE).map(|k| response(filter, k / SIDE, k % SIDE)).collect();
        all.sort_by(f64::total_cmp);
        let expected = star_e * all[all.len() / 2];
        let (mean, error, samples) = mean_e(&visited, &filter.to_lowercase());
        assert_eq!(samples, 18, "{filter}");
        assert!(
            (mean - expected).abs() < 4.0 * error + 0.02 * expected,
            "{filter}: {mean} ± {error}, {expected}"
        );
        // The others' frames are no samples of this channel.
        let channel =
            visited.linear.channels.iter().find(|c| c.name == filter.to_lowercase()).unwrap();
        let skipped =
            channel.flags.iter().filter(|flags| flags.contains(Flags::NOT_SAMPLED)).count();
        assert_eq!(skipped, 18, "{filter} at {exposure_s} s");
    }
}

/// Without darks the bias frames are taken, without flats the star is as dim as its pixels see it. Truth: as before; the response at the star's place.
#[test]
fn bias_frames_stand_in_for_darks() {
    let made = Made { darks: false, bias: true, flats: false, filters: &STAR_E };
    let (night, visited) = reduced("bias", &["R", "B"], &made);
    assert_eq!((night.cameras[0].sensor.darks, night.cameras[0].sensor.bias), ([0, 0], 8));
    for (filter, _, star_e) in STAR_E {
        let expected = star_e * response(filter, PLACE[1] as usize, PLACE[0] as usize);
        let (mean, error, _) = mean_e(&visited, &filter.to_lowercase());
        assert!(
            (mean - expected).abs() < 4.0 * error + 0.02 * expected,
            "{filter}: {mean} ± {error}, {expected}"
        );
    }
}

/// Frames behind a filter that no channel has are counted and named. Truth: by hand: 18 frames.
#[test]
fn a_filter_without_a_channel_is_named() {
    let made = Made { darks: true, bias: false, flats: false, filters: &STAR_E };
    let (night, visited) = reduced("unknown", &["R"], &made);
    assert_eq!(visited.linear.channels.len(), 1);
    assert_eq!(mean_e(&visited, "r").2, 18);
    let warnings = &night.warnings;
    assert!(
        warnings.iter().any(|w| w.contains("18 frames behind filter B") && w.contains("have R")),
        "{warnings:?}"
    );
}
