//! `sunglint track`: rehearsals and refusals.

#![allow(clippy::unwrap_used, reason = "a test says what it expects")]

use crate::common::Folder;

const ISS: &str = "ISS (ZARYA)
1 25544U 98067A   08264.51782528 -.00002182  00000-0 -11606-4 0  2927
2 25544  51.6416 247.4627 0006703 130.5360 325.0288 15.72125391563537
";

/// Made up: a mean motion that grows by 0.18 revolutions a day, every day, of an object that is 58 days older at the time that is asked for.
const DEBRIS: &str = "DEBRIS
1 25544U 98067A   24064.51782528  .09000000  00000-0  99999-1 0  2925
2 25544  51.6416 247.4627 0006703 130.5360 325.0288 16.42125391563535
";

/// Truth: the virtual telescope's own: its target is 1 s late and 20″ beside its track, and stands within 5″ of the axis. A German mount is turned over once, when the target is at the meridian
/// (2 s: the target is late, and looked at in steps); at 10 °/s half a turn takes 18 s, and less than a minute is lost.
#[test]
fn a_rehearsal_follows() {
    let folder = Folder::new("track");
    std::fs::write(folder.path("iss.tle"), ISS).unwrap();
    for mount in ["virtual", "virtual-equatorial", "virtual-german"] {
        let track = ["track", "iss.tle", "ISS", "--mount", mount, "--station", "ufo"];
        let at = ["--at", "2008-09-21T18:30:00", "--json"];
        let json = folder.json(&[&track[..], &at].concat());
        let rms = json["true_rms_arcsec"].as_f64().unwrap();
        assert!(rms < 5.0, "{mount} {rms}");
        assert!(json["went"]["locked_s"].as_f64().unwrap() < 10.0);
        assert!(json["ended"].is_null());
        let turned: Vec<[f64; 2]> = serde_json::from_value(json["turned_s"].clone()).unwrap();
        let planned: Vec<f64> = serde_json::from_value(json["plan"]["turns_s"].clone()).unwrap();
        assert_eq!(
            (turned.len(), planned.len()),
            if mount == "virtual-german" { (1, 1) } else { (0, 0) }
        );
        for ([from_s, to_s], planned_s) in turned.into_iter().zip(planned) {
            assert!((from_s - planned_s).abs() < 2.0, "{from_s} {planned_s}");
            assert!((18.0..60.0).contains(&(to_s - from_s)), "{from_s} {to_s}");
        }
    }
}

/// Truth: the rules in words; a plan alone follows nothing.
#[test]
fn what_cannot_be_is_refused() {
    let folder = Folder::new("track-refused");
    std::fs::write(folder.path("iss.tle"), ISS).unwrap();
    let track = ["track", "iss.tle", "ISS", "--station", "ufo", "--at", "2008-09-21T18:30:00"];
    let wrong = |code, more: &[&str]| folder.refused(code, &[&track[..], more].concat());
    assert!(wrong(2, &["--mount", "virtual", "--sun-limit", "3"]).contains("10 to 90"));
    assert!(wrong(2, &["--mount", "virtual", "--for-s=0"]).contains("for-s"));
    // Elements that have come down by then, and a planet in a star's place.
    std::fs::write(folder.path("debris.tle"), DEBRIS).unwrap();
    let debris = ["track", "debris.tle", "DEBRIS", "--station", "ufo", "--mount", "virtual"];
    let down = folder.refused(1, &[&debris[..], &["--at", "2024-05-01T00:00:00"]].concat());
    assert!(down.contains("nothing to follow") && down.contains("decayed"), "{down}");
    let planet = folder.refused(1, &["goto", "jupiter", "--mount", "virtual", "--station", "ufo"]);
    assert!(planet.contains("solar system") && planet.contains("right ascension"), "{planet}");
    // A search needs a camera that is said to see something, and a camera something to do.
    let vega = ["goto", "vega", "--mount", "virtual", "--station", "gauss6"];
    let goto = |more: &[&str]| folder.refused(2, &[&vega[..], more].concat());
    let camera = ["--camera", "alpaca-camera:127.0.0.1:1/0"];
    assert!(goto(&["--search", "0.5"]).contains("--camera"));
    assert!(goto(&camera).contains("--solve or --search"));
    let far = goto(&[&camera[..], &["--search", "9"]].concat());
    assert!(far.contains("search is 9") && far.contains("0.001 to 5"), "{far}");
    let plan = folder.json(&[&track[..], &["--mount", "virtual", "--dry-run", "--json"]].concat());
    assert!(plan["went"].is_null() && plan["plan"]["refused"].is_null());
}

/// Truth: reasoning. At 22:00 UTC the Sun stands 40° below the horizon of 48.8° north, 9° east in September, and at 19° no overhead satellite 350 km up is lit any more. At 17:38 it has just set.
#[test]
fn a_pass_in_the_dark_of_the_earth_is_told() {
    let folder = Folder::new("track-shadow");
    std::fs::write(folder.path("iss.tle"), ISS).unwrap();
    for (at, told, untold) in [
        ("2008-09-21T22:00:00", "Earth's shadow", "twilight"),
        ("2008-09-22T17:30:00", "twilight", "Earth's shadow"),
    ] {
        let track =
            ["track", "iss.tle", "ISS", "--mount", "virtual", "--station", "ufo", "--at", at];
        let output = folder.run(&[&track[..], &["--dry-run"]].concat());
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(output.status.success(), "{said}");
        assert!(said.contains(told) && !said.contains(untold), "{at}: {said}");
    }
}
