//! `sunglint passes` as a person runs it.

#![allow(clippy::unwrap_used, reason = "a test says what it expects")]

mod common;

use common::Folder;
use sunglint_testkit::fixture;

fn elements() -> String {
    fixture("passes/satellites.tle").display().to_string()
}

/// The arguments of a night, with others behind them.
fn night<'a>(tle: &'a str, more: &[&'a str]) -> Vec<&'a str> {
    let mut all = vec![
        "passes",
        "--tle",
        tle,
        "--station",
        "ufo",
        "--from",
        "2024-08-12T18:00",
        "--to",
        "2024-08-13T04:00",
    ];
    all.extend(more);
    all
}

/// Truth: the magnitude by hand from the geometry that the program prints: a diffuse sphere of 1 m, ρ = 0.2, V☉ = −26.75 ± 0.05 at 1 au (Willmer
/// 2018 has −26.76); and the definition of the visible part: within the stay, sunlit, the Sun below −6°.
#[test]
fn a_night_in_text_table_and_json() {
    let folder = Folder::new("passes-night");
    let tle = elements();
    let one = ["--norad", "90002,90004", "-o", "night.ecsv", "-o", "sky.svg", "-o", "sky.png"];
    let text = folder.done(&night(&tle, &one));
    // The list itself is readable in 110 columns.
    let list = text.lines().skip_while(|l| !l.starts_with("number")).take_while(|l| !l.is_empty());
    assert!(list.clone().count() > 5 && list.clone().all(|l| l.chars().count() <= 110), "{text}");
    assert!(text.contains("visible passes of 2 objects") && text.contains("SYNTHETIC POLAR"));
    let svg = std::fs::read_to_string(folder.path("sky.svg")).unwrap();
    assert!(svg.contains("SYNTHETIC HIGH LEO") && svg.contains("highest"));
    assert!(folder.path("sky.png").metadata().unwrap().len() > 10_000);
    let table = sunglint_formats::ecsv::read(folder.path("night.ecsv")).unwrap();
    let json = folder.json(&night(&tle, &["--norad", "90002,90004", "--json"]));
    let passes = json["passes"].as_array().unwrap();
    assert_eq!(passes.len(), table.rows());
    assert!(passes.len() >= 4);
    let v = table.f64("brightest_v_mag").unwrap();
    for (i, pass) in passes.iter().enumerate() {
        let b = &pass["brightest"];
        let number = |key: &str| b[key].as_f64().unwrap();
        let (phase, range) = (number("phase_deg").to_radians(), number("range_m"));
        let f = 2.0 / (3.0 * std::f64::consts::PI)
            * (phase.sin() + (std::f64::consts::PI - phase) * phase.cos());
        let ratio = 0.2 * (0.5 / range).powi(2) * f * number("sunlit");
        let by_hand = -26.75 - 2.5 * ratio.log10();
        // The Sun is 1.013 au away in August: 0.03 mag.
        assert!((number("v_mag") - by_hand - 0.028).abs() < 0.06, "{by_hand} {pass}");
        assert!((v[i] - number("v_mag")).abs() < 1e-6);
        let extinction = pass["v_station_mag"].as_f64().unwrap() - number("v_mag");
        assert!((0.05..2.5).contains(&extinction), "{extinction}");
        assert!(number("sun_altitude_deg") < -6.0 && number("altitude_deg") >= 9.99);
        assert!(pass["start"]["time_utc"].as_str() <= pass["end"]["time_utc"].as_str());
        for channel in pass["rates"].as_object().unwrap().values() {
            assert!(channel["rate_hz"].as_f64().unwrap() > 0.0);
        }
    }
}

#[test]
fn the_result_does_not_depend_on_threads() {
    let folder = Folder::new("passes-threads");
    let tle = elements();
    let of = |threads: &str| {
        folder.done(&night(
            &tle,
            &["--norad", "90001,90002,90004,90005", "--threads", threads, "-o", "-", "-q"],
        ))
    };
    assert_eq!(of("1"), of("3"));
}

#[test]
fn no_visible_pass_is_said_with_its_reasons() {
    let folder = Folder::new("passes-none");
    let tle = elements();
    let text = folder.done(&night(&tle, &["--norad", "90008"]));
    assert!(text.contains("no visible pass of 1 object between 2024-08-12T18:00:00Z"), "{text}");
    assert!(text.contains("1 object never rose above 10°"), "{text}");
    let day = [
        "passes",
        "--tle",
        &tle,
        "--station",
        "ufo",
        "--norad",
        "90001",
        "--from",
        "2024-08-12T12:00",
        "--to",
        "2024-08-12T13:00",
    ];
    let text = folder.done(&day);
    assert!(text.contains("the Sun never stands below -6° in that time"), "{text}");
    assert!(text.contains("of 1 pass above 10° 1 under a bright sky"), "{text}");
    let text = folder.done(&night(&tle, &["--norad", "90002", "--brighter-than", "-9"]));
    assert!(text.contains("left out by"), "{text}");
}

#[test]
fn bad_input_is_said_clearly_and_hides_nothing_else() {
    let folder = Folder::new("passes-bad");
    let tle = elements();
    let good = std::fs::read_to_string(&tle).unwrap();
    // A satellite that decays within hours, and a set with a wrong checksum.
    let wrong = good.replacen("15.50000000    13", "15.50000000    14", 1);
    std::fs::write(folder.path("bad.tle"), wrong).unwrap();
    let json = folder.json(&night("bad.tle", &["--name", "polar", "--json", "-q"]));
    assert_eq!(json["failures"].as_array().unwrap().len(), 1, "{}", json["failures"]);
    assert!(json["failures"][0]["why"].as_str().unwrap().contains("bad.tle:3"), "{json}");
    assert!(!json["passes"].as_array().unwrap().is_empty());
    for (code, more, expected) in [
        (2, vec!["--norad", "12345"], "--norad: `12345` is not among"),
        (2, vec!["--name", "nothing"], "--name nothing"),
        (1, vec!["--diameter-m", "0"], "--diameter-m is 0"),
        (1, vec!["--reflectance", "1.5"], "--reflectance is 1.5"),
        (1, vec!["--exposure-s", "-1"], "--exposure-s is -1"),
        (1, vec!["--min-elevation", "95"], "the lowest altitude is 95°"),
        (2, vec!["-o", "sky.txt"], "found the extension `txt`"),
        (2, vec!["--standard-magnitude", "4", "--diameter-m", "2"], "cannot be used with"),
    ] {
        let message = folder.refused(code, &night(&tle, &more));
        assert!(message.contains(expected), "{more:?}: {message}");
    }
    let backwards =
        ["passes", "--tle", &tle, "--station", "ufo", "--from", "2024-08-12", "--to", "2024-08-11"];
    assert!(folder.refused(1, &backwards).contains("--to must be later than --from"));
    std::fs::write(folder.path("empty.tle"), "").unwrap();
    assert!(folder.refused(1, &night("empty.tle", &[])).contains("no elements"));
    assert!(folder.refused(1, &night("missing.tle", &[])).contains("missing.tle"));
}
