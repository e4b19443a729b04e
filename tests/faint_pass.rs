//! A faint, low pass through camera and counters, many nights of it: what the fit states is what it is off by.

#![allow(clippy::unwrap_used, reason = "in helpers too, a failure should stop the run")]

use crate::common::Folder;
use std::collections::BTreeMap;
use sunglint_calibration::reduction::{ReduceOptions, reduce};
use sunglint_formats::session::Session;
use sunglint_numerics::progress::Silent;
use sunglint_radiometry::station::Station;
use sunglint_report::{Format, Product};
use sunglint_testkit::Campaign;

/// Nights of the campaign, and the channels of each.
const NIGHTS: u64 = 200;
const CHANNELS: usize = 6;
/// Reflectance of the sphere.
const TRUTH: f64 = 0.6;

const COLUMNS: &[&str] = &[
    // Intervals of the six channels with the truth below and above them, mean of their errors over their σ.
    "below",
    "above",
    "pull",
    // The same with the κ that the night was made with in place of the one that its stars gave, and without the part of κ in the uncertainties.
    "exact_below",
    "exact_above",
    "exact_pull",
    // Whether residuals hang together.
    "correlated",
    // What `id400` counted in the 40 s after the pass, less what it counts there in the mean, Hz.
    "off_after",
    // Error and σ of each channel (r, g, b, id400, spcm, mppc), %.
    "error_1",
    "error_2",
    "error_3",
    "error_4",
    "error_5",
    "error_6",
    "sigma_1",
    "sigma_2",
    "sigma_3",
    "sigma_4",
    "sigma_5",
    "sigma_6",
    // The same with the κ that the night was made with.
    "exact_error_1",
    "exact_error_2",
    "exact_error_3",
    "exact_error_4",
    "exact_error_5",
    "exact_error_6",
    "exact_sigma_1",
    "exact_sigma_2",
    "exact_sigma_3",
    "exact_sigma_4",
    "exact_sigma_5",
    "exact_sigma_6",
];

/// κ by channel: of the stars of a night, and those that it was made with.
fn kappas(folder: &Folder) -> [BTreeMap<String, f64>; 2] {
    let text = std::fs::read_to_string(folder.path("kappa.ecsv")).unwrap();
    let mut rows =
        text.lines().filter(|l| !l.starts_with('#')).map(|l| l.split(',').collect::<Vec<_>>());
    let head = rows.next().unwrap();
    let at = |name: &str| head.iter().position(|h| *h == name).unwrap();
    let (channel, kappa) = (at("channel"), at("kappa"));
    let found = rows.map(|row| (row[channel].to_owned(), row[kappa].parse().unwrap())).collect();
    let text = std::fs::read_to_string(folder.path("session/virtual/truth.json")).unwrap();
    let truth: serde_json::Value = serde_json::from_str(&text).unwrap();
    [found, serde_json::from_value(truth["kappa"].clone()).unwrap()]
}

/// Error of the level beside the target that is counted after the pass, `id400`, Hz.
fn off_after(folder: &Folder) -> f64 {
    let text = std::fs::read_to_string(folder.path("session/virtual/truth.json")).unwrap();
    let truth: serde_json::Value = serde_json::from_str(&text).unwrap();
    // The dark rate of the station's file, and the sky.
    let mean = 756.0 + truth["sky_hz"]["id400"].as_f64().unwrap();
    let counts = std::fs::read_to_string(folder.path("session/counts/tagger.ecsv")).unwrap();
    let bins: Vec<f64> = (counts.lines())
        .filter(|l| ("2020-11-18T16:46:30".."2020-11-18T16:47:10").contains(l))
        .map(|l| l.split(',').nth(4).unwrap().parse().unwrap())
        .collect();
    let rate = bins.iter().sum::<f64>() / bins.len() as f64;
    // A dead time of 10 µs that is not prolonged.
    rate / (1.0 - 1e-5 * rate) - mean
}

/// The light of both satellites, the same on every night.
fn simulated() -> Folder {
    let folder = Folder::new("faint_pass");
    for (name, text) in sunglint_rehearsal::demo::files(0) {
        std::fs::write(folder.path(name), text).unwrap();
    }
    for [scene, pass] in [["sphere", "sphere_pass"], ["pass", "box_wing_pass"]] {
        folder.done(&["simulate", &format!("{scene}.toml"), "-o", &format!("{pass}.ecsv")]);
    }
    folder
}

/// Curves of a session as `sunglint reduce` writes them, without the figures, whose drawing is half of a night's time.
fn reduced(folder: &Folder) {
    let session = Session::open(folder.path("session")).unwrap();
    let station = Station::of_session(&session).unwrap();
    let mut night =
        reduce(&session, &station, &ReduceOptions::for_station(&station), &Silent).unwrap();
    std::fs::create_dir(folder.path("reduced")).unwrap();
    while let Some(visited) = night.take(&session, &station).unwrap() {
        let table = visited.linear.to_table().unwrap();
        let bytes = Product { table, ..Product::default() }.encode(Format::Ecsv).unwrap();
        let file = format!("reduced/{}.ecsv", visited.stay.file_name());
        std::fs::write(folder.path(&file), bytes).unwrap();
    }
}

/// A night from its plan to the fit: a row of the campaign.
fn night(seed: u64, light: &Folder) -> Vec<f64> {
    let folder = Folder::new(&format!("faint_pass_{seed}"));
    for (name, text) in sunglint_rehearsal::demo::files(seed) {
        std::fs::write(folder.path(name), text).unwrap();
    }
    std::fs::create_dir_all(folder.path("simulated")).unwrap();
    for curve in ["sphere_pass.ecsv", "box_wing_pass.ecsv"] {
        std::fs::copy(light.path(curve), folder.path("simulated").join(curve)).unwrap();
    }
    folder.done(&["observe", "night.toml", "-o", "session"]);
    reduced(&folder);
    folder.done(&["calibrate", "reduced", "--station", "ufo", "-o", "kappa.ecsv"]);
    let apply = ["apply", "kappa.ecsv", "reduced/sphere_1.ecsv", "--station", "ufo"];
    folder.done(&[&apply[..], &["-o", "sphere.ecsv"]].concat());
    let fit = folder.json(&["fit", "sphere.ecsv", "sphere.toml", "--json"]);
    let parameters = fit["fit"]["parameters"].as_array().unwrap();
    assert_eq!(parameters.len(), CHANNELS, "{seed}");
    let [found, truth] = kappas(&folder);
    // Below, above, pull: by the night's κ, and by the true one.
    let (mut sums, mut own) = ([[0.0; 3]; 2], [const { Vec::new() }; 4]);
    for p in parameters {
        let number = |key: &str| p[key].as_f64().unwrap();
        let (value, sigma) = (number("value"), number("sigma"));
        let name = p["name"].as_str().unwrap();
        println!("{seed} {name}: {value:.4} ± {sigma:.4}");
        let interval = p["interval_95"].as_array().unwrap();
        let [low, high] = [0, 1].map(|end| interval[end].as_f64().unwrap());
        // An albedo goes with the rates, and these with κ; what is not of κ is beside it in squares.
        let channel = name.rsplit('.').next().unwrap();
        let part = truth[channel] / found[channel];
        let alone = part * (sigma.powi(2) - number("sigma_calibration").powi(2)).sqrt();
        let half = 0.5 * (high - low) * alone / sigma;
        let exact = part * value;
        let both = [(value, sigma, [low, high]), (exact, alone, [exact - half, exact + half])];
        for (k, (value, sigma, [low, high])) in both.into_iter().enumerate() {
            let row = [
                f64::from(u8::from(TRUTH < low)),
                f64::from(u8::from(TRUTH > high)),
                (value - TRUTH) / sigma / CHANNELS as f64,
            ];
            sums[k].iter_mut().zip(row).for_each(|(sum, own)| *sum += own);
            own[2 * k].push(100.0 * (value / TRUTH - 1.0));
            own[2 * k + 1].push(100.0 * sigma / TRUTH);
        }
    }
    let correlated = f64::from(u8::from(!fit["fit"]["correlation"].is_null()));
    [sums.concat(), vec![correlated, off_after(&folder)], own.concat()].concat()
}

/// The demonstration's nights, each with other photons, seeing and clouded stars, up to the fit of the sphere, which climbs from 14° above the horizon: its points are there twice as wide as those of the
/// stars that calibrate it, its light in a frame is a fifteenth of the noise of the pixels (all synthetic). Truth: the sphere's reflectance, 0.6, in each channel. Promise: the mean of all nights within 0.5 % and 3 standard errors of it (the
/// profile of a virtual star is known to the reduction as little as a real one's), nights scatter by no more than 1.3 times the stated uncertainty (30 nights know their scatter to 13 %), and
/// 90 % of all 95 % intervals hold it (the channels of a night share κ, so that 30 nights tell 95 % to 7 %). `docs/uncertainty.md` says how many held, with an interval by whole nights.
#[test]
fn campaign_faint_pass() {
    let mut campaign = Campaign::in_shards("faint_pass", NIGHTS, 1, COLUMNS);
    let light = simulated();
    for seed in campaign.seeds() {
        let row = night(seed, &light);
        campaign.keep(seed, &row);
    }
    let columns = |name: &str| -> Vec<Vec<f64>> {
        (1..=CHANNELS).map(|c| campaign.column(&format!("{name}_{c}"))).collect()
    };
    let (errors, sigmas) = (columns("error"), columns("sigma"));
    let pulls = errors.iter().flatten().zip(sigmas.iter().flatten());
    let largest = pulls.map(|(e, s)| (e / s).abs()).fold(0.0, f64::max);
    let nights = errors[0].len() as f64;
    let mut figures = vec![("largest_off_in_sigmas", largest)];
    if nights >= 10.0 {
        let (mut bias, mut scatter) = (0.0_f64, 0.0_f64);
        for (errors, sigmas) in errors.iter().zip(&sigmas) {
            let mean = errors.iter().sum::<f64>() / nights;
            let square: f64 = errors.iter().map(|v| (v - mean).powi(2)).sum();
            let own = (square / (nights - 1.0)).sqrt();
            let stated = sigmas.iter().sum::<f64>() / nights;
            println!(
                "mean {mean:.3} ± {:.3} %, scatter {own:.3}, stated {stated:.3}",
                own / nights.sqrt()
            );
            assert!(mean.abs() < 0.5 + 3.0 * own / nights.sqrt(), "{mean} {own}");
            assert!(own < 1.3 * stated, "{own} {stated}");
            bias = bias.max(0.01 * mean.abs());
            scatter = scatter.max(own / stated);
        }
        let sum = |name: &str| campaign.column(name).iter().sum::<f64>();
        let share =
            |below: &str, above: &str| (sum(below) + sum(above)) / (nights * CHANNELS as f64);
        let missed = share("below", "above");
        assert!(missed < 0.1, "{missed}");
        figures.extend([
            ("largest_relative_bias", bias),
            ("largest_scatter_over_stated", scatter),
            ("missed_by_95_percent_intervals", missed),
            ("missed_with_exact_kappa", share("exact_below", "exact_above")),
            ("with_correlated_residuals", sum("correlated")),
        ]);
    }
    for (name, value) in figures {
        campaign.largest(name, value);
    }
    campaign.finish();
    // Last, so that the record is written: blue is 5.4 σ off in one of the first 100 nights, and nobody knows why (docs/uncertainty.md).
    assert!(largest < 4.5, "{largest}");
}
