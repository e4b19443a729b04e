//! From a virtual night to its linear light curves: held against the night's truth; nothing lost; what cannot be reduced.

#![allow(clippy::unwrap_used, reason = "in helpers too, a failure should stop the run")]

use crate::common::Folder;
use crate::common::virtual_night::{observe, plan_of, write};
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;
use sunglint_calibration::reduction::{ReduceOptions, Reduced, Visited, reduce};
use sunglint_formats::session::Session;
use sunglint_numerics::progress::Silent;
use sunglint_radiometry::light_curve::Flags;
use sunglint_radiometry::station::Station;
use sunglint_testkit::{peer_python, run_python};
use sunglint_virtual::observatory::night::Night;
use sunglint_virtual::observatory::watch::Watch;

fn ufo() -> Station {
    Station::built_in("ufo").unwrap().unwrap()
}

fn reduced(session: &Session) -> (Reduced, Vec<Visited>) {
    let station = ufo();
    let options = ReduceOptions::for_station(&station);
    let mut night = reduce(session, &station, &options, &Silent).unwrap();
    let mut visits = Vec::new();
    while let Some(visited) = night.take(session, &station).unwrap() {
        visits.push(visited);
    }
    (night, visits)
}

/// (reduced − truth) / σ of each channel's samples without a flag. The truth is what arrives of the target at the fibre's middle, times twinkling and clouds,
/// averaged over the exposure.
fn pulls(night: &Arc<Night>, visits: &[Visited]) -> BTreeMap<String, Vec<f64>> {
    let mut watch = Watch::new(night.clone());
    let mut pulls = BTreeMap::<String, Vec<f64>>::new();
    for visited in visits {
        let curve = &visited.linear;
        for i in 0..curve.len() {
            let exposure_s = curve.samples.exposure_s[i];
            let middle_s = night.seconds(curve.samples.time[i]);
            let steps = (exposure_s / 0.005).round() as u32;
            let times: Vec<f64> = (0..steps)
                .map(|k| middle_s + exposure_s * ((f64::from(k) + 0.5) / f64::from(steps) - 0.5))
                .collect();
            let moments: Vec<_> = times.iter().map(|t| watch.moment(*t)).collect();
            for channel in &curve.channels {
                // Masked pixels are made up for, with their uncertainty, unless too much lies on them.
                let flagged = !(channel.flags[i] - Flags::MASKED_PIXELS).is_empty();
                if flagged || !channel.rate_hz[i].is_finite() {
                    continue;
                }
                let number = night.channels.iter().position(|c| c.name == channel.name).unwrap();
                let truth: f64 = (times.iter().zip(&moments))
                    .map(|(t, m)| {
                        let visit = &night.visits[m.visit.unwrap()];
                        visit.arriving_hz(number, *t) * m.scintillation * m.clouds
                    })
                    .sum();
                let pull = (channel.rate_hz[i] - truth / f64::from(steps)) / channel.sigma_hz[i];
                pulls.entry(channel.name.clone()).or_default().push(pull);
            }
        }
    }
    pulls
}

/// How far tracks are off the truth on average, px, by visit.
fn place_errors(night: &Arc<Night>, visits: &[Visited]) -> Vec<[f64; 2]> {
    let mut watch = Watch::new(night.clone());
    let mut of = |visited: &Visited| {
        let mut sum = ([0.0; 2], 0.0);
        for point in &visited.track.points {
            let Some(place) = point.place else { continue };
            let truth = watch.moment(night.seconds(point.time)).offset_px;
            for ((sum, place), truth) in
                sum.0.iter_mut().zip(place.offset_px.to_array()).zip(truth.to_array())
            {
                *sum += place - truth;
            }
            sum.1 += 1.0;
        }
        sum.0.map(|error| error / sum.1)
    };
    visits.iter().map(&mut of).collect()
}

/// Mean and mean square of pulls.
fn moments(pulls: &[f64]) -> [f64; 2] {
    let n = pulls.len() as f64;
    [pulls.iter().sum::<f64>() / n, pulls.iter().map(|p| p * p).sum::<f64>() / n]
}

/// Four stars of 60 s each, the sky beside each, dark at both ends; a point that lies within the aperture but for 1e-4, a sensor without differences that a
/// dark frame does not show, nothing that crosses. Slow twinkling, so that it
/// does not matter at which moments within a bin light and truth are taken.
const OPTIONS: &str = r#"
seed = 11
[plan]
stars = 4
visit_s = 60
sky_s = 20
slew_s = 5
dark_s = 20
v_mag = [3.5, 4.5]
[scintillation]
time_s = 0.37
[seeing]
fwhm_arcsec = 2.0
moffat_beta = 100.0
[pointing]
jitter_px = JITTER
aim_scatter_px = 3.0
[camera]
response_scatter = 0.0
cold_fraction = 0.0
dead_fraction = 0.0
[passing]
streaks_per_h = 0.0
"#;

fn options(jitter_px: f64) -> String {
    OPTIONS.replace("JITTER", &format!("{jitter_px:?}"))
}

/// Every bin and frame of the session is in the reduction's account, and every row of a curve in the channels' own.
fn nothing_lost(session: &Session, night: &Reduced, visits: &[Visited]) {
    let counter = &night.counters[0];
    let rows = session.counts("tagger").unwrap().count() as u64;
    assert_eq!(counter.summary.bins, rows);
    let camera = &night.cameras[0];
    let frames = session.frames("cam").unwrap().files.len() as u64;
    assert_eq!(camera.tally.frames + camera.outside + camera.failed.len() as u64, frames);
    let sampled = |name: &str| {
        let of = |visited: &Visited| {
            let flags = &visited.linear.channel(name).unwrap().flags;
            flags.iter().filter(|f| !f.contains(Flags::NOT_SAMPLED)).count() as u64
        };
        visits.iter().map(of).sum::<u64>()
    };
    let summary = &counter.summary;
    assert_eq!(sampled("spcm") + summary.outside + summary.without_length, summary.bins);
    assert_eq!(sampled("spcm"), summary.channels[1].samples);
    assert_eq!(sampled("g"), camera.tally.frames);
    for visited in visits {
        let curve = &visited.linear;
        assert!(curve.samples.time.is_sorted());
        // A value that is none stands beside its reason.
        for channel in &curve.channels {
            let silent = (channel.rate_hz.iter().zip(&channel.flags))
                .filter(|(rate, flags)| !rate.is_finite() && flags.is_empty());
            assert_eq!(silent.count(), 0, "{}", channel.name);
        }
    }
}

/// Truth: the virtual night's own light; it shares no formula with the reduction. A telescope that stands still: each bin's counting is its own, so that pulls
/// are independent but for the background, common to a visit: of the mppc 35 of 500 Hz. Mean and mean square within five of their standard deviations.
#[test]
fn counters_of_a_still_telescope_are_true_to_their_sigma() {
    let folder = Folder::new("reduce-still");
    let (summary, night) = observe(&folder.0, &plan_of(&[]), &options(0.0));
    assert_eq!(summary.not_written, 0);
    let session = Session::open(folder.path("session")).unwrap();
    let (reduced, visits) = reduced(&session);
    assert!(reduced.warnings.is_empty(), "{:?}", reduced.warnings);
    assert_eq!(visits.len(), 4);
    nothing_lost(&session, &reduced, &visits);
    // A tenth of a pixel, at three from the fibre's middle, is 0.1 % of the coupling.
    for error in place_errors(&night, &visits) {
        eprintln!("places off by {error:.3?} px");
        assert!(error[0].hypot(error[1]) < 0.1, "{error:?}");
    }
    let pulls = pulls(&night, &visits);
    for name in ["id400", "spcm", "mppc"] {
        let n = pulls[name].len();
        let [mean, square] = moments(&pulls[name]);
        eprintln!("{name}: {n} samples, mean {mean:+.3}, mean square {square:.3}");
        assert!(n > 2000, "{name}: {n}");
        let most = 5.0 * (1.0 / n as f64 + 0.1_f64.powi(2) / 4.0).sqrt();
        assert!(mean.abs() < most, "{name}: {mean} {most}");
        let most = 5.0 * (2.0 / n as f64).sqrt() + 0.01;
        assert!((square - 1.0).abs() < most, "{name}: {square} {most}");
    }
}

/// Truth: as above, of a telescope that wanders by 2 px: the camera's rates (every frame a place of its own between the pixels), and the counters', whose
/// pulls between two frames hang together: as many as frames are independent at least.
#[test]
fn all_channels_of_a_wandering_telescope_are_true_to_their_sigma() {
    let folder = Folder::new("reduce-wander");
    let plan = plan_of(&[("exposure_s = 0.5", "exposure_s = 0.2"), ("= 2.0", "= 0.5")]);
    let (_, night) = observe(&folder.0, &plan, &options(2.0));
    let session = Session::open(folder.path("session")).unwrap();
    let (reduced, visits) = reduced(&session);
    nothing_lost(&session, &reduced, &visits);
    let pulls = pulls(&night, &visits);
    assert_eq!(pulls.len(), 6);
    for (name, pulls) in &pulls {
        let [mean, square] = moments(pulls);
        eprintln!("{name}: {} samples, mean {mean:+.3}, mean square {square:.3}", pulls.len());
        assert!(pulls.len() > 100, "{name}: {}", pulls.len());
        let independent = pulls.len().min(400) as f64;
        let most = 5.0 * (1.0 / independent + 0.1_f64.powi(2) / 4.0).sqrt();
        assert!(mean.abs() < most, "{name}: {mean} {most}");
        // The camera's σ holds where the target may fall between the pixels of a colour at worst: it may be too large, never too small.
        let least = if ["r", "g", "b"].contains(&name.as_str()) { 0.2 } else { 0.6 };
        let most = 1.0 + 5.0 * (2.0 / independent).sqrt();
        assert!((least..most).contains(&square), "{name}: {square} {most}");
    }
}

/// Two stars of 20 s.
const SHORT: &str = "seed = 5\n[plan]\nstars = 2\nvisit_s = 20\nsky_s = 8\nslew_s = 2\ndark_s = 8\nv_mag = [2.5, 4.5]\n";

/// Truth: the plan: two stars, 200 bins and 10 frames each. Astropy's reader: the table opens, its rows are those of both instruments, NaN only beside a flag.
#[test]
fn the_programs_reduce_a_night_and_astropy_reads_it() {
    let folder = Folder::new("reduce-program");
    write(&folder.0, &plan_of(&[]), SHORT);
    folder.done(&["observe", "night.toml", "-o", "session"]);
    folder.done(&["session", "check", "session"]);
    let json = folder.json(&["reduce", "session", "-o", "out/", "--raw", "--json"]);
    let visits = json["visits"].as_array().unwrap();
    assert_eq!(visits.len(), 2);
    for visit in visits {
        assert_eq!(visit["channels"].as_array().unwrap().len(), 6);
        let of = |name: &str| {
            let channels = visit["channels"].as_array().unwrap();
            channels.iter().find(|c| c["name"] == name).unwrap()["samples"].as_u64().unwrap()
        };
        assert_eq!((of("spcm"), of("g")), (200, 10));
    }
    assert_eq!(json["cameras"][0]["dark_frames"], 8);
    let file = visits[0]["file"].as_str().unwrap();
    let stem = file.strip_suffix(".ecsv").unwrap();
    for name in ["", "_frames"] {
        assert!(folder.path(&format!("out/{stem}{name}.png")).is_file());
    }
    // A second time nothing is overwritten, and that is said before the work.
    let error = folder.refused(1, &["reduce", "session", "-o", "out/"]);
    assert!(error.contains("is there already"), "{error}");
    // Frames are searched side by side: the same bytes on any machine.
    for threads in ["1", "4"] {
        folder.done(&["reduce", "session", "-q", "-o", "beside/", "--raw", "--threads", threads]);
        for entry in std::fs::read_dir(folder.path("beside")).unwrap() {
            let path = entry.unwrap().path();
            let other = folder.path("out").join(path.file_name().unwrap());
            let same = std::fs::read(&path).unwrap() == std::fs::read(&other).unwrap();
            assert!(same, "{} differs with {threads} threads", path.display());
        }
        std::fs::remove_dir_all(folder.path("beside")).unwrap();
    }
    let Some(python) =
        peer_python("the_programs_reduce_a_night_and_astropy_reads_it", &["astropy"])
    else {
        return;
    };
    let script = "
import sys, warnings
import numpy as np
from astropy.table import Table
warnings.simplefilter('error')
for path in sys.argv[1:]:
    t = Table.read(path, format='ascii.ecsv')
    if 'time_utc' not in t.colnames:
        assert len(t) == 12, len(t)
        continue
    raw = path.endswith('_raw.ecsv')
    assert len(t) == (200 if raw else 210), len(t)
    assert t.meta['target']['kind'] == 'star' and t.meta['target']['visit'] == 1
    assert t.meta['quantity'] == ('raw' if raw else 'linear')
    assert np.all((np.asarray(t['zenith_deg']) > 0) & (np.asarray(t['zenith_deg']) < 90))
    channels = [c[:-8] for c in t.colnames if c.endswith('_rate_hz')]
    assert len(channels) == (3 if raw else 6), channels
    for c in channels:
        nan = ~np.isfinite(np.asarray(t[c + '_rate_hz'], dtype=float))
        assert not np.any(nan & (np.asarray(t[c + '_flags']) == '')), c
print('read')
";
    let tables: Vec<String> = std::fs::read_dir(folder.path("out"))
        .unwrap()
        .map(|entry| entry.unwrap().path().display().to_string())
        .filter(|path| path.ends_with(".ecsv"))
        .collect();
    assert_eq!(tables.len(), 5);
    let tables: Vec<&str> = tables.iter().map(String::as_str).collect();
    assert_eq!(run_python(&python, script, &tables).trim(), "read");
}

/// Truth: the night's own κ. Six stars of 20 s each, as bright as the catalogue says: from the folder of the session to κ in one step. A mean of six stars of
/// 20 s twinkles by 0.2 %; a percent is five of that. Outside the camera's aperture, which is 2.5 times as wide as the widest point and up to 3.4 times as others,
/// lie 0.6 to 1.8 % of a Moffat profile (β = 3): (1 + r²/α²)⁻², α = 0.98 widths; so much larger is its κ.
#[test]
fn a_session_calibrates_to_the_true_kappa() {
    let folder = Folder::new("reduce-kappa");
    let options = "seed = 8\n[plan]\nstars = 6\nvisit_s = 20\nsky_s = 6\nslew_s = 2\ndark_s = 8\nv_mag = [3.5, 4.5]\n\
                   [stars]\nscatter = 0.001\ndimmed = 0\n[camera]\nresponse_scatter = 0.001\n";
    let (_, truth) = observe(&folder.0, &plan_of(&[]), options);
    let found = folder.json(&["calibrate", "session", "--station", "ufo", "--json"]);
    let channels = found["nights"][0]["channels"].as_array().unwrap();
    for name in ["id400", "spcm", "mppc", "r", "g", "b"] {
        let channel = channels.iter().find(|channel| channel["channel"] == name).unwrap();
        let kappa = truth.channels.iter().find(|c| c.name == name).unwrap().kappa;
        let ratio = channel["kappa"].as_f64().unwrap() / kappa;
        eprintln!("{name}: {ratio:.4} of the true kappa");
        let outside = if ["r", "g", "b"].contains(&name) { 0.018 } else { 0.0 };
        assert!((0.99..1.01 + outside).contains(&ratio), "{name}: {ratio}");
    }
}

fn change(path: &Path, from: &str, to: &str) {
    let text = std::fs::read_to_string(path).unwrap();
    assert!(text.contains(from), "{}: no {from}", path.display());
    std::fs::write(path, text.replace(from, to)).unwrap();
}

/// Truth: what was taken away. What is left is reduced, and said; what cannot be is refused with what to do.
#[test]
fn what_is_missing_is_said() {
    let folder = Folder::new("reduce-missing");
    // Without dark frames: no mask, and a name for that.
    let dark = SHORT.replace("dark_s = 8", "dark_s = 0");
    write(&folder.0, &plan_of(&[]), &dark);
    folder.done(&["observe", "night.toml", "-o", "nodark", "-q"]);
    let text = folder.done(&["reduce", "nodark"]);
    assert!(text.contains("no dark frames: no mask"), "{text}");
    // A target that was not there.
    let error = folder.refused(1, &["reduce", "nodark", "--target", "Betelgeuze"]);
    assert!(error.contains("there is no target Betelgeuze; there are "), "{error}");
    // No target at all.
    let sky = "seed = 1\n[[visit]]\nkind = \"sky\"\nfrom_s = 0\nto_s = 5\n";
    write(&folder.0, &plan_of(&[]), sky);
    folder.done(&["observe", "night.toml", "-o", "sky", "-q"]);
    let error = folder.refused(1, &["reduce", "sky"]);
    assert!(error.contains("session sky") && error.contains("no target"), "{error}");
    // Channels that the station has not.
    let manifest = folder.path("nodark/session.toml");
    for (name, other) in [("id400", "x"), ("spcm", "y"), ("mppc", "z")] {
        change(&folder.path("nodark/counts/tagger.ecsv"), name, other);
        change(&manifest, name, other);
    }
    let error = folder.refused(1, &["reduce", "nodark"]);
    assert!(error.contains("channels x, y, z") && error.contains("station ufo"), "{error}");
    // A station that nobody has.
    change(&manifest, "station = \"ufo\"", "station = \"nowhere\"");
    let error = folder.refused(1, &["reduce", "nodark"]);
    assert!(error.contains("`nowhere`") && error.contains("--station"), "{error}");
    let error = folder.refused(1, &["reduce", "elsewhere"]);
    assert!(error.contains("elsewhere"), "{error}");
}

/// Truth: the session cut at a byte: bins up to there, the frames that are there, one of them damaged, no end in the log.
#[test]
fn a_night_that_was_cut_is_reduced_as_far_as_it_is_there() {
    let folder = Folder::new("reduce-cut");
    observe(&folder.0, &plan_of(&[]), SHORT);
    let cut = |name: &str, part: f64| {
        let path = folder.path("session").join(name);
        let bytes = std::fs::read(&path).unwrap();
        std::fs::write(&path, &bytes[..(part * bytes.len() as f64) as usize]).unwrap();
    };
    let before = Session::open(folder.path("session")).unwrap();
    let last = before.frames("cam").unwrap().files.last().unwrap().path.clone();
    let (whole, _) = reduced(&before);
    cut("counts/tagger.ecsv", 0.5);
    let events = folder.path("session/events.jsonl");
    let text = std::fs::read_to_string(&events).unwrap();
    let end = text.rfind("{\"utc\"").unwrap_or(0).max(text.trim_end().rfind('\n').unwrap());
    std::fs::write(&events, &text[..end + 20]).unwrap();
    std::fs::write(&last, "SIMPLE  =").unwrap();
    let session = Session::open(folder.path("session")).unwrap();
    let (night, visits) = reduced(&session);
    let rows = session.counts("tagger").unwrap().filter(Result::is_ok).count() as u64;
    assert!(rows > 100 && rows < whole.counters[0].summary.bins);
    assert_eq!(night.counters[0].summary.bins, rows);
    assert!(!visits.is_empty() && visits[0].linear.channel("spcm").unwrap().flags.len() >= 200);
    assert_eq!(night.cameras[0].tally.frames, whole.cameras[0].tally.frames);
    // The damaged frame lies in the dark behind the stars: it is named.
    assert_eq!(night.cameras[0].failed.len(), 1, "{:?}", night.warnings);
    assert!(night.warnings.iter().any(|w| w.contains("is left out")), "{:?}", night.warnings);
}

/// A night without dark frames beside one with them, on a sensor with hot pixels: the masters of the library, which the first reduction fills, stand in. Truth: the first night's own
/// reduction: the second one is the same night, its dark frames removed, and must come out the same to the last digit, while it does not without the library. A master of another
/// temperature, or that is damaged, is not used; what is used is said.
#[test]
fn a_library_of_masters_stands_in_for_dark_frames() {
    let folder = Folder::new("library");
    let options = "seed = 3\n[plan]\nstars = 1\nvisit_s = 40\nsky_s = 5\nslew_s = 2\ndark_s = 20\n[camera]\nhot_fraction = 0.01\nhot_e_per_s = 500\n";
    let (_, _) = observe(&folder.0, &plan_of(&[]), options);
    let session = Session::open(folder.path("session")).unwrap();
    let first = folder.done(&["reduce", "session", "--library", "lib", "-o", "one/"]);
    assert!(first.contains("added to the library: dark_cam_0.5s"), "{first}");
    let masters = || {
        let all = std::fs::read_dir(folder.path("lib")).unwrap();
        all.map(|entry| entry.unwrap().path()).collect::<Vec<_>>()
    };
    assert_eq!(masters().len(), 1);
    // The same night without its dark frames.
    let darks: Vec<_> = {
        let visits = session.visits().unwrap();
        let is_dark = |start: hifitime::Epoch| {
            visits.iter().any(|visit| {
                visit.target.target_kind == sunglint_formats::session::TargetKind::Dark
                    && visit.from <= start
                    && visit.to.is_none_or(|to| start < to)
            })
        };
        let files = session.frames("cam").unwrap().files;
        files.into_iter().filter(|file| file.start().is_some_and(is_dark)).collect()
    };
    assert!(darks.len() >= 5, "{}", darks.len());
    for file in &darks {
        std::fs::remove_file(&file.path).unwrap();
    }
    let rates = |out: &str| {
        let names = std::fs::read_dir(folder.path(out)).unwrap();
        let mut paths: Vec<_> = names.map(|entry| entry.unwrap().path()).collect();
        paths.retain(|path| path.to_str().is_some_and(|path| path.ends_with("_1.ecsv")));
        let table = sunglint_formats::ecsv::read(&paths[0]).unwrap();
        let of = |name| table.f64(name).unwrap().iter().map(|v| v.to_bits()).collect::<Vec<_>>();
        [of("r_rate_hz"), of("g_rate_hz"), of("b_rate_hz")]
    };
    let second = folder.done(&["reduce", "session", "--library", "lib", "-o", "two/"]);
    assert!(second.contains("from the library: dark_cam_0.5s"), "{second}");
    assert_eq!(rates("two"), rates("one"));
    let without = folder.done(&["reduce", "session", "-o", "three/"]);
    assert!(without.contains("no dark frames"), "{without}");
    assert_ne!(rates("three"), rates("one"));
    let text = std::fs::read_dir(folder.path("two")).unwrap();
    let text = text.map(|entry| std::fs::read_to_string(entry.unwrap().path()).unwrap_or_default());
    assert!(
        text.into_iter()
            .any(|text| text.contains("calibrated by masters of the library: dark_cam"))
    );
    // Ten degrees warmer.
    let path = masters()[0].clone();
    let bytes = std::fs::read(&path).unwrap();
    let at = bytes.windows(8).position(|part| part == b"CCD-TEMP").unwrap();
    let mut warmer = bytes.clone();
    let card = format!("{:<80}", "CCD-TEMP=                  0.0 / deg C");
    warmer[at..at + 80].copy_from_slice(card.as_bytes());
    std::fs::write(&path, &warmer).unwrap();
    let other = folder.done(&["reduce", "session", "--library", "lib", "-o", "four/"]);
    assert!(other.contains("no dark frames"), "{other}");
    // Cut off.
    std::fs::write(&path, &bytes[..bytes.len() / 2]).unwrap();
    let cut = folder.run(&["reduce", "session", "--library", "lib", "-o", "five/"]);
    let said = String::from_utf8_lossy(&cut.stderr).into_owned();
    assert!(cut.status.success() && said.contains("left out of the library"), "{said}");
}
