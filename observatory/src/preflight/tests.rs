//! Plans with known faults, and sound ones.

use super::*;
use crate::Catalogue;
use sunglint_formats::time::parse_utc;

const STATION: &str = "station = \"ufo\"\n";
const DEVICES: &str = "[[camera]]\nname = \"cam\"\ndevice = \"sim-camera\"\nexposure_s = 0.3\n";
const ISS: &str = "1 25544U 98067A   08264.51782528 -.00002182  00000-0 -11606-4 0  2927\n\
                   2 25544  51.6416 247.4627 0006703 130.5360 325.0288 15.72125391563537\n";
/// Synthetic satellites: one in low orbit, and one that passes near Stuttgart's zenith in the afternoon of 2026-11-29.
const MADE: &str = "1 99101U 24001A   26332.50000000  .00000000  00000-0  10000-4 0    17\n\
                    2 99101  51.6400  20.0000 0007000  30.0000   0.0000 15.50000000    12\n\
                    1 99003U 24001A   26332.50000000  .00000000  00000-0  10000-4 0    18\n\
                    2 99003  98.6000 328.0000 0010000  90.0000  60.0000 14.27000000    10\n";

/// The findings of a plan at 2026-11-23T20:00:00Z: a November night at Stuttgart.
fn findings(name: &str, top: &str, devices: &str, visits: &str) -> Preflight {
    let folder =
        std::env::temp_dir().join(format!("sunglint-preflight-{}-{name}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    std::fs::write(folder.join("iss.tle"), ISS).unwrap();
    std::fs::write(folder.join("made.tle"), MADE).unwrap();
    let path = folder.join("night.toml");
    std::fs::write(&path, format!("{STATION}{top}\n{devices}\n{visits}")).unwrap();
    let plan = Plan::read(&path).unwrap();
    let opener: Arc<dyn Opener> = Arc::new(Catalogue);
    let now = parse_utc("2026-11-23T20:00:00Z").unwrap();
    let options = PreflightOptions { now, ..PreflightOptions::default() };
    let begun = Instant::now();
    let found = preflight(&plan, &opener, &options);
    assert!(begun.elapsed() < Duration::from_secs(2), "{:?}", begun.elapsed());
    std::fs::remove_dir_all(&folder).unwrap();
    found
}

const NIGHT: &str = "from = \"2026-11-23T20:05:00Z\"\nto = \"2026-11-23T23:00:00Z\"";

fn visit(target: &str, from: &str) -> String {
    format!("[[visit]]\n{target}\nfrom = \"{from}\"\nfor_s = 600\n")
}

/// Truth: what is wrong with each plan is put in by hand. Canopus (declination −52.7°) never rises at Stuttgart (latitude 48.7°); Arcturus has set on a
/// November evening; the elements are of 2008; the simulated camera has 160 × 120 px.
#[test]
fn impossible_plans_are_named() {
    let late = "2026-11-23T20:10:00Z";
    let gain = format!("{DEVICES}gain = 1e9\n");
    let window = format!("{DEVICES}window_px = [100, 100, 200, 200]\n");
    let long = DEVICES.replace("0.3", "1e7");
    let channel = "[[counter]]\nname = \"tagger\"\ndevice = \"sim-timetagger\"\nchannels = { nosuch = 1 }\nbin_s = 0.1\n";
    let bright = DEVICES.replace("0.3", "30");
    let cases: [(&str, &str, String, &str); 10] = [
        // Vega is 10^4 times brighter than a star of V 10; 30 s at a 43 cm telescope.
        ("saturated", &bright, visit("star = \"Capella\"", late), "it saturates"),
        ("canopus", DEVICES, visit("star = \"Canopus\"", late), "never rises"),
        ("arcturus", DEVICES, visit("star = \"Arcturus\"", late), "not up"),
        ("past", DEVICES, visit("star = \"Vega\"", "2020-11-18T20:00:00Z"), "is past"),
        ("day", DEVICES, visit("star = \"Capella\"", "2026-11-24T11:00:00Z"), "day"),
        ("elements", DEVICES, visit("tle = \"iss.tle\"", late), "elements are"),
        ("gain", &gain, visit("star = \"Capella\"", late), "gain is"),
        ("window", &window, visit("star = \"Capella\"", late), "window_px"),
        ("exposure", &long, visit("star = \"Capella\"", late), "exposure_s"),
        ("channel", channel, visit("star = \"Capella\"", late), "no channel `nosuch`"),
    ];
    for (name, devices, visits, expected) in cases {
        // Each with its own beginning: without one it is the present, whatever the day of the test.
        let top = match name {
            "day" => "from = \"2026-11-23T20:05:00Z\"\nto = \"2026-11-24T12:00:00Z\"",
            "past" => "from = \"2020-11-18T19:00:00Z\"\nto = \"2026-11-23T23:00:00Z\"",
            _ => NIGHT,
        };
        let found = findings(name, top, devices, &visits);
        let named = |level| found.of(level).any(|finding| finding.text.contains(expected));
        let level =
            if ["channel", "saturated"].contains(&name) { Level::Warning } else { Level::Error };
        assert!(named(level), "{name}: {found:?}");
    }
}

/// Truth: by hand: each of these plans has one fault that the devices, or the frames, would show too late; its words name it. The sensor has 160 × 120 px.
#[test]
fn faults_that_a_night_would_show_too_late_are_named() {
    let late = "2026-11-23T20:10:00Z";
    let star = visit("star = \"Capella\"", late);
    let off = |keys: &str| format!("{star}[[visit]]\n{keys}\n");
    let binned = format!("{DEVICES}binning = 2\nwindow_px = [11, 10, 60, 60]\n");
    let plain = format!("{DEVICES}binning = 2\nwindow_px = [10, 10, 60, 60]\n");
    let step = off(
        "off = \"bias\"\nexposure_s = 0.001\nfor_s = 9\nbinning = 2\nwindow_px = [11, 10, 60, 60]",
    );
    let tagger = |keys: &str| {
        format!(
            "[[counter]]\nname = \"tagger\"\ndevice = \"sim-timetagger\"\nchannels = {{ spcm = 1 }}\nbin_s = 0.1\n{keys}\n"
        )
    };
    let level = |adu: u32| off(&format!("off = \"flat\"\nfor_s = 60\nlevel_adu = {adu}"));
    let (bad, worse) = (Level::Warning, Level::Error);
    let cases: [(&str, String, String, Level, &str); 9] = [
        ("odd", binned, star.clone(), worse, "no multiple of the binning"),
        ("odd-step", DEVICES.into(), step, worse, "no multiple of the binning"),
        ("flat", DEVICES.into(), level(70_000), worse, "no frame has more than 65535"),
        ("bright", DEVICES.into(), level(65_000), bad, "its pixels are full"),
        (
            "bias",
            DEVICES.into(),
            off("off = \"bias\"\nexposure_s = 10\nfor_s = 60"),
            bad,
            "hold dark current",
        ),
        ("darkless", DEVICES.into(), star.clone(), bad, "no dark or bias frames are planned"),
        (
            "other",
            DEVICES.into(),
            off("off = \"dark\"\nexposure_s = 5\nfor_s = 60"),
            bad,
            "(0.3 s, binning 1)",
        ),
        (
            "dead",
            tagger("dead_time_ps = { spcm = 1_000_000_000_000_000 }"),
            star.clone(),
            worse,
            "less than a bin",
        ),
        ("trigger", tagger("trigger_level_v = { spcm = 50 }"), star.clone(), bad, "50 V"),
    ];
    for (name, devices, visits, level, expected) in cases {
        let found = findings(name, NIGHT, &devices, &visits);
        let named = found.of(level).any(|finding| finding.text.contains(expected));
        assert!(named, "{name}: {found:?}");
    }
    // What fits raises none of them.
    let dark = off("off = \"dark\"\nfor_s = 60");
    let found = findings("fits", NIGHT, &plain, &dark);
    let quiet = ["multiple", "dark or bias"];
    let said = found.findings.iter().any(|f| quiet.iter().any(|word| f.text.contains(word)));
    assert!(!said, "{found:?}");
}

/// Truth: by hand: what each plan gets wrong. Right ascension in hours puts Vega (279.2°) at 18.6°; the made satellite is lit only while it is below the horizon (that the same visit cut to its pass is wholly in
/// shadow is the second case; tests/shadow.rs has the shadow's own truth); a year is wrong in one visit, and in the end of the night.
#[test]
fn mistakes_of_planners_are_named() {
    let vega = "name = \"Vega\"\nra_deg = 18.6156\ndec_deg = 38.78";
    let early = "2026-11-23T20:10:00Z";
    let capella = visit("star = \"Capella\"", early);
    let next_year = visit("star = \"Capella\"", "2027-11-23T20:30:00Z");
    let made = |from: &str, to: &str| {
        format!(
            "[[visit]]\ntle = \"made.tle\"\nobject = \"99101\"\nfrom = \"2026-11-29T{from}Z\"\nto = \"2026-11-29T{to}Z\"\n"
        )
    };
    let week = "from = \"2026-11-23T20:05:00Z\"\nto = \"2026-11-30T00:00:00Z\"";
    let cases: [(&str, &str, String, Level, &str); 6] = [
        ("hours", NIGHT, visit(vega, early), Level::Warning, "from the catalogue's 279."),
        (
            "lit-below",
            week,
            made("23:00:00", "23:50:00"),
            Level::Error,
            "shadow as long as it is up",
        ),
        ("dark", week, made("23:43:30", "23:49:00"), Level::Error, "shadow for the whole visit"),
        (
            "gap",
            "",
            capella.clone() + &next_year,
            Level::Warning,
            "365.0 days after the visit before it",
        ),
        (
            "years",
            "from = \"2026-11-23T20:05:00Z\"\nto = \"2062-11-23T23:00:00Z\"",
            capella.clone(),
            Level::Warning,
            "36.0 years long",
        ),
        (
            "far",
            "from = \"2026-11-26T20:05:00Z\"\nto = \"2026-11-26T21:00:00Z\"",
            visit("star = \"Capella\"", "2026-11-26T20:10:00Z"),
            Level::Warning,
            "begins in 3.0 days: cameras wait",
        ),
    ];
    for (name, top, visits, level, expected) in cases {
        let found = findings(name, top, DEVICES, &visits);
        let named = found.of(level).any(|finding| finding.text.contains(expected));
        assert!(named, "{name}: {found:?}");
    }
}

/// A mount that does not answer is the one that the plan tells of. Truth: by hand: Capella culminates at Stuttgart at 0:25 UTC; 1 °/s about the vertical is too slow for a pass near the zenith, of
/// 1.6 °/s across the sky.
#[test]
fn a_mount_that_is_off_is_held_against_the_plan() {
    let mount = |keys: &str| {
        format!(
            "{DEVICES}[mount]\ndevice = \"indi-telescope:localhost:1/T\"\ntrust_clock = true\n{keys}\n"
        )
    };
    let star = "[[visit]]\nstar = \"Capella\"\nfrom = \"2026-11-23T22:00:00Z\"\nto = \"2026-11-24T02:00:00Z\"\n";
    let pass = "[[visit]]\ntle = \"made.tle\"\nobject = \"99003\"\nfrom = \"2026-11-29T16:06:00Z\"\nto = \"2026-11-29T16:13:00Z\"\n";
    let found = findings("german", "", &mount("axes = \"equatorial\"\ngerman = true"), star);
    let turns = found.of(Level::Warning).any(|f| f.text.contains("the mount turns over"));
    assert!(turns, "{found:?}");
    let found = findings("slow", "", &mount("axes = \"altaz\"\nmost_rate_deg_s = 1"), pass);
    let keyhole = found.findings.iter().any(|f| {
        f.level != Level::Fine && f.about.starts_with("visit 1") && f.text.contains("cannot follow")
    });
    assert!(keyhole, "{found:?}");
    let found = findings("unknown", "", &mount(""), pass);
    assert!(!found.findings.iter().any(|f| f.text.contains("can follow it")), "{found:?}");
}

/// Truth: by hand: 200 bias frames of 160 × 120 px, 16 bits and a header of two blocks are 8.8 MB, and no more however short they are; after them the camera takes a frame of
/// 0.3 s each 0.31 to 2.3 s for the rest of three hours.
#[test]
fn the_forecast_counts_what_each_step_takes() {
    let bias = "[[visit]]\noff = \"bias\"\nexposure_s = 0.001\nframes = 200\nfrom = \"2026-11-23T20:10:00Z\"\nto = \"2026-11-23T23:00:00Z\"\n";
    let found = findings("forecast", NIGHT, DEVICES, bias);
    let disk = found.findings.iter().find(|finding| finding.about == "disk").unwrap();
    let frame = 160.0 * 120.0 * 2.0 + FRAME_BYTES;
    // From 5 s before the night to the step the camera is set as for it, and takes frames without a number; a camera that rests does so for 5 s only.
    let told = |before_s: f64| {
        let [least, most] = [SLOW_S, FAST_S + frame / FAST_BYTES_S]
            .map(|readout_s| 1e-9 * frame * (200.0 + before_s / (0.001 + readout_s)));
        format!("the night takes {least:.3} to {most:.3} GB")
    };
    let text = told(305.0);
    assert!(disk.text.contains(&text), "{text}: {}", disk.text);
    assert_ne!(disk.level, Level::Error);
    let rests = format!("{DEVICES}rests_between_visits = true\n");
    let found = findings("forecast-rests", NIGHT, &rests, bias);
    let disk = found.findings.iter().find(|finding| finding.about == "disk").unwrap();
    assert!(disk.text.contains(&told(5.0)), "{}: {}", told(5.0), disk.text);
}

/// Truth: stars that culminate high at Stuttgart on a November night (right ascension 1 h to 7 h, declination above 10°), in the dark.
#[test]
fn sound_plans_raise_no_error() {
    let stars = ["Capella", "Aldebaran", "Hamal", "Mirfak", "Algol", "Alcyone", "Elnath"];
    for (number, star) in stars.iter().enumerate() {
        for from in ["2026-11-23T20:10:00Z", "2026-11-23T21:30:00Z", "2026-11-23T22:30:00Z"] {
            let visits = visit(&format!("star = \"{star}\""), from)
                + "[[visit]]\noff = \"dark\"\nfor_s = 60\n";
            let found = findings(&format!("sound{number}"), NIGHT, DEVICES, &visits);
            assert!(found.is_possible(), "{star}: {found:?}");
        }
    }
}
