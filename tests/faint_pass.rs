//! A faint, low pass through camera and counters, many nights of it: what the fit states is what it is off by.

use crate::common::Folder;
use sunglint_testkit::Campaign;

/// Nights of the campaign, and the channels of each.
const NIGHTS: u64 = 30;
const CHANNELS: usize = 6;

/// The demonstration's nights, each with other photons, seeing and clouded stars, up to the fit of the sphere, which climbs from 14° above the horizon: its points are there twice as wide as those of the
/// stars that calibrate it, its light in a frame is a fifteenth of the noise of the pixels (all synthetic). Truth: the sphere's reflectance, 0.6, in each channel. Promise: the mean of all nights within 0.5 % and 3 standard errors of it (the
/// profile of a virtual star is known to the reduction as little as a real one's), nights scatter by no more than 1.3 times the stated uncertainty (30 nights know their scatter to 13 %), and
/// 90 % of all 95 % intervals hold it (the channels of a night share κ, so that 30 nights tell 95 % to 7 %).
#[test]
fn campaign_faint_pass() {
    let mut campaign = Campaign::start("faint_pass", NIGHTS);
    let (mut values, mut sigmas) = (vec![Vec::new(); CHANNELS], vec![Vec::new(); CHANNELS]);
    let (mut held, mut largest) = (0, 0.0_f64);
    for seed in campaign.seeds() {
        let folder = Folder::new(&format!("faint_pass_{seed}"));
        for (name, text) in sunglint_rehearsal::demo::files(seed) {
            std::fs::write(folder.path(name), text).unwrap();
        }
        for [scene, pass] in [["sphere", "sphere_pass"], ["pass", "box_wing_pass"]] {
            let curve = format!("simulated/{pass}.ecsv");
            std::fs::create_dir_all(folder.path("simulated")).unwrap();
            folder.done(&["simulate", &format!("{scene}.toml"), "-o", &curve]);
        }
        folder.done(&["observe", "night.toml", "-o", "session"]);
        folder.done(&["reduce", "session", "-o", "reduced/"]);
        folder.done(&["calibrate", "reduced", "--station", "ufo", "-o", "kappa.ecsv"]);
        let apply = ["apply", "kappa.ecsv", "reduced/sphere_1.ecsv", "--station", "ufo"];
        folder.done(&[&apply[..], &["-o", "sphere.ecsv"]].concat());
        let fit = folder.json(&["fit", "sphere.ecsv", "sphere.toml", "--json"]);
        let parameters = fit["fit"]["parameters"].as_array().unwrap();
        assert_eq!(parameters.len(), CHANNELS, "{seed}");
        for (c, p) in parameters.iter().enumerate() {
            let number = |key: &str| p[key].as_f64().unwrap();
            let (value, sigma) = (number("value"), number("sigma"));
            let interval = p["interval_95"].as_array().unwrap();
            let [low, high] = [0, 1].map(|end| interval[end].as_f64().unwrap());
            held += usize::from((low..=high).contains(&0.6));
            largest = largest.max((value - 0.6).abs() / sigma);
            println!("{seed} {}: {value:.4} ± {sigma:.4}", p["name"]);
            values[c].push(value);
            sigmas[c].push(sigma);
        }
        // A night has 500 frames.
        std::fs::remove_dir_all(folder.path("session")).unwrap();
    }
    assert!(largest < 4.5, "{largest}");
    campaign.largest("largest_off_in_sigmas", largest);
    let nights = values[0].len() as f64;
    if nights >= 10.0 {
        let (mut bias, mut scatter) = (0.0_f64, 0.0_f64);
        for (values, sigmas) in values.iter().zip(&sigmas) {
            let mean = values.iter().sum::<f64>() / nights;
            let square: f64 = values.iter().map(|v| (v - mean).powi(2)).sum();
            let own = (square / (nights - 1.0)).sqrt();
            let stated = sigmas.iter().sum::<f64>() / nights;
            println!(
                "mean {mean:.4} ± {:.4}, scatter {own:.4}, stated {stated:.4}",
                own / nights.sqrt()
            );
            assert!((mean - 0.6).abs() < 0.003 + 3.0 * own / nights.sqrt(), "{mean} {own}");
            assert!(own < 1.3 * stated, "{own} {stated}");
            bias = bias.max((mean / 0.6 - 1.0).abs());
            scatter = scatter.max(own / stated);
        }
        let share = f64::from(held as u32) / (nights * CHANNELS as f64);
        assert!(share > 0.9, "{held}");
        campaign.largest("largest_relative_bias", bias);
        campaign.largest("largest_scatter_over_stated", scatter);
        campaign.largest("missed_by_95_percent_intervals", 1.0 - share);
    }
    campaign.finish();
}
