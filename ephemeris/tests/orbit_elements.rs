//! Elements as messages, and ephemerides of others, against the programs that others wrote for them (`tests/peers/messages.py`: sgp4's
//! own OMM reader, ccsds-ndm, astropy).

#![allow(clippy::unwrap_used, reason = "in helpers too, a failure should stop the run")]

use glam::DVec3;
use hifitime::Unit;
use std::path::Path;
use sunglint_ephemeris::orbit::elements::{self, Form};
use sunglint_ephemeris::orbit::{Ephemeris, Orbit, ReadError, Tle, TleOrbit, tle};
use sunglint_ephemeris::passes::{Conditions, Search};
use sunglint_formats::time::{format_utc_shortest, parse_utc};
use sunglint_radiometry::sky::{EarthOrientation, Geodetic, Site};
use sunglint_radiometry::station::Horizon;
use sunglint_testkit::{peer_python, repository, run_python};

const FORMS: [(&str, Form); 5] = [
    ("sets.json", Form::Json),
    ("space_track.json", Form::Json),
    ("sets.csv", Form::Csv),
    ("sets.xml", Form::Xml),
    ("sets.kvn", Form::Kvn),
];

/// Runs the peer script into a folder of its own; `None` where there are no peers.
fn written_by_others(test: &str) -> Option<tempfile::TempDir> {
    let python = peer_python(test, &["sgp4", "ccsds_ndm", "astropy"])?;
    let folder = tempfile::tempdir().unwrap();
    let script = include_str!("peers/messages.py");
    let repository = repository();
    run_python(&python, script, &[repository.to_str().unwrap(), folder.path().to_str().unwrap()]);
    Some(folder)
}

fn json(path: &Path) -> serde_json::Value {
    serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap()
}

fn numbers(row: &serde_json::Value, from: usize) -> DVec3 {
    let at = |i: usize| row[i].as_f64().unwrap();
    DVec3::new(at(from), at(from + 1), at(from + 2)) * 1e3
}

fn orbit(set: &Tle) -> TleOrbit {
    TleOrbit::new(set.clone()).unwrap()
}

fn bits(set: &Tle, minutes: f64) -> [u64; 6] {
    let state = orbit(set).teme_after(minutes).unwrap();
    let (p, v) = (state.position_m.to_array(), state.velocity_m_s.to_array());
    [p[0], p[1], p[2], v[0], v[1], v[2]].map(f64::to_bits)
}

/// Truth: sgp4's own reader of CSV and XML, given a number that it can hold. Tolerance 1 mm: two implementations of SGP4, and its
/// epoch as a Julian date (0.04 ms of rounding would be 0.3 m; both halves of the date keep 1e-11 day).
#[test]
fn every_form_gives_the_orbit_that_sgp4_gives() {
    let Some(folder) = written_by_others("every_form_gives_the_orbit_that_sgp4_gives") else {
        return;
    };
    let truth = json(&folder.path().join("truth.json"));
    let truth = truth.as_array().unwrap();
    assert_eq!(truth.len(), 5);
    let read: Vec<Vec<Tle>> = FORMS
        .iter()
        .map(|(name, form)| {
            let path = folder.path().join(name);
            assert_eq!(Form::of(&std::fs::read_to_string(&path).unwrap()), *form, "{name}");
            elements::read(&path).unwrap()
        })
        .collect();
    let mut longest = 0;
    for (i, object) in truth.iter().enumerate() {
        let first = &read[0][i];
        assert_eq!(u64::from(first.norad_id), object["number"].as_u64().unwrap());
        longest = longest.max(first.norad_id);
        for place in object["places"].as_array().unwrap() {
            let minutes = place[0].as_f64().unwrap();
            let ours = orbit(first).teme_after(minutes).unwrap().position_m;
            let off = (ours - numbers(place, 1)).length();
            assert!(off < 1e-3, "{}: {off} m after {minutes} min", first.label());
            for (other, (name, _)) in read.iter().zip(FORMS) {
                assert_eq!(bits(&other[i], minutes), bits(first, minutes), "{name}");
            }
        }
        for (other, (name, _)) in read.iter().zip(FORMS) {
            assert_eq!(other.len(), truth.len(), "{name}");
            assert_eq!(other[i], *first, "{name}");
        }
        // Written and read again.
        let again = elements::parse("again", &elements::text([first])).unwrap();
        assert_eq!(again, std::slice::from_ref(first));
    }
    assert!(longest > 10_000_000, "{longest}");
}

/// Truth: the two lines of the same object, which other tests hold against three programs. The TLE's epoch has steps of 0.86 ms, which the
/// message's microseconds keep.
#[test]
fn the_passes_of_a_message_are_those_of_its_two_lines() {
    let Some(folder) = written_by_others("the_passes_of_a_message_are_those_of_its_two_lines")
    else {
        return;
    };
    let truth = json(&folder.path().join("truth.json"));
    let sets = elements::read(folder.path().join("sets.json")).unwrap();
    let site =
        Site::new(Geodetic { latitude_deg: 48.78, longitude_deg: 9.2, height_m: 399.0 }).unwrap();
    let earth = EarthOrientation::zero();
    let mut passes = 0;
    for (set, object) in sets.iter().zip(truth.as_array().unwrap()) {
        let lines = object["lines"].as_array().unwrap();
        let text = format!("{}\n{}\n", lines[0].as_str().unwrap(), lines[1].as_str().unwrap());
        let by_lines = Orbit::from(orbit(&tle::parse("t", &text).unwrap()[0]));
        let by_message = Orbit::from(orbit(set));
        // Some of these orbits come down within the day.
        let window = (set.epoch, set.epoch + 0.4 * Unit::Day);
        let conditions = Conditions { min_altitude_deg: 5.0, sun_below_deg: 90.0 };
        let search = Search::new(&site, &Horizon::Flat(0.0), window, conditions, &earth).unwrap();
        let (one, other) = (search.passes(&by_lines), search.passes(&by_message));
        assert_eq!(one.passes.len(), other.passes.len(), "{}", set.label());
        for (one, other) in one.passes.iter().zip(&other.passes) {
            passes += 1;
            for (a, b) in [
                (one.span.from, other.span.from),
                (one.span.to, other.span.to),
                (one.culmination, other.culmination),
            ] {
                let off = (a - b).abs().to_seconds();
                assert!(off < 1e-3, "{}: {off} s", set.label());
            }
        }
    }
    assert!(passes >= 3, "{passes}");
}

const OMM: &str = r#"[
 {"OBJECT_NAME": "ISS (ZARYA)", "OBJECT_ID": "1998-067A", "EPOCH": "2020-07-12T01:19:07.402656",
  "MEAN_MOTION": 15.49560532, "ECCENTRICITY": 0.0001771, "INCLINATION": 51.6435, "RA_OF_ASC_NODE": 225.4004, "ARG_OF_PERICENTER": 44.9625,
  "MEAN_ANOMALY": 5.1087, "EPHEMERIS_TYPE": 0, "CLASSIFICATION_TYPE": "U", "NORAD_CAT_ID": 25544, "ELEMENT_SET_NO": 999, "REV_AT_EPOCH": 23587,
  "BSTAR": 0.0049645, "MEAN_MOTION_DOT": 0.00289036, "MEAN_MOTION_DDOT": 0}
]"#;

#[test]
fn a_bad_message_is_refused_with_line_and_key() {
    assert_eq!(elements::parse("e.json", OMM).unwrap().len(), 1);
    let refused = |from: &str, to: &str| {
        assert!(OMM.contains(from));
        elements::parse("e.json", &OMM.replace(from, to)).unwrap_err().to_string()
    };
    for (from, to, expected) in [
        (
            "15.49560532",
            "-15.5",
            "e.json:3: MEAN_MOTION: found `-15.5`, expected more than 0 and at most 20 revolutions a day",
        ),
        ("15.49560532", "\"NaN\"", "e.json:3: MEAN_MOTION: found `NaN`"),
        ("15.49560532", "[1]", "e.json:3: MEAN_MOTION: found `[1]`, expected a number or a text"),
        ("0.0001771", "1.5", "e.json:3: ECCENTRICITY: found `1.5`, expected 0 to less than 1"),
        ("51.6435", "351.6435", "e.json:3: INCLINATION"),
        ("\"BSTAR\"", "\"BSTARR\"", "BSTAR: found no such key, expected a value (is it `BSTARR`?)"),
        ("25544", "1234567890", "e.json:4: NORAD_CAT_ID: found `1234567890`"),
        ("25544", "\"I0001\"", "e.json:4: NORAD_CAT_ID: found `I0001`"),
        ("\"EPHEMERIS_TYPE\": 0", "\"EPHEMERIS_TYPE\": 4", "e.json:4: EPHEMERIS_TYPE: found `4`"),
        (
            "2020-07-12T",
            "2020-07-32T",
            "e.json:2: EPOCH: found `2020-07-32T01:19:07.402656`, expected a day of the calendar",
        ),
        (
            "\"OBJECT_ID\"",
            "\"REF_FRAME\": \"ICRF\", \"OBJECT_ID\"",
            "e.json:2: REF_FRAME: found `ICRF`, expected TEME",
        ),
        (
            "\"OBJECT_ID\"",
            "\"MEAN_MOTION\": 15, \"OBJECT_ID\"",
            "e.json:3: MEAN_MOTION: found the key twice",
        ),
        ("15.49560532,", "15.49560532", "e.json:3: found expected `,` or `}`"),
        ("]", "", "e.json:6: found EOF while parsing a list"),
    ] {
        let error = refused(from, to);
        assert!(error.contains(expected), "{error}\nshould have: {expected}");
    }
    // One bad set of two: the other is kept, and the error says where.
    let inner = OMM.trim().trim_start_matches('[').trim_end_matches(']').trim();
    let two = format!("[{inner},\n{}]", inner.replace("0.0001771", "2"));
    let (good, bad) = elements::parse_lenient("two.json", &two);
    assert_eq!((good.len(), bad.len()), (1, 1));
    assert!(bad[0].to_string().starts_with("two.json:6: ECCENTRICITY"), "{}", bad[0]);
    for (text, expected) in [
        ("[]", "found no elements"),
        ("{\"error\": \"no\"}", "EPOCH: found no such key"),
        ("<!DOCTYPE html><html><body>Too many requests</body></html>", "this is a web page"),
        ("<html></html>", "root element: found `html`"),
        ("<ndm><omm><segment/></omm></ndm>", "EPOCH: found no such key"),
        (
            "CCSDS_OMM_VERS = 2.0\nMEAN_MOTION 15\n",
            "x:2: found `MEAN_MOTION 15`, expected KEY = value",
        ),
        (
            "CCSDS_OMM_VERS = 2.0\nEPOCH = 2020-01-01T00:00:00\nMEAN_MOTION = 0.1 [rad/s]\n",
            "x:3: MEAN_MOTION: found the unit `rad/s`, expected rev/day",
        ),
        ("CCSDS_OEM_VERS = 2.0\n", "expected CCSDS_OMM_VERS, the first key"),
        ("MEAN_MOTION,EPOCH\n15\n", "x:2: found CSV error"),
        ("MEAN_MOTION,MEAN_MOTION\n15,15\n", "MEAN_MOTION: found the key twice"),
        ("", "found no elements"),
    ] {
        let error = elements::parse("x", text).unwrap_err().to_string();
        assert!(error.contains(expected), "{text}: {error}");
    }
    // A day of the year, and a leap second.
    let at = |epoch: &str| {
        elements::parse("e", &OMM.replace("2020-07-12T01:19:07.402656", epoch))
            .map(|sets| sets[0].epoch)
    };
    assert_eq!(at("2020-194T01:19:07.402656").unwrap(), at("2020-07-12T01:19:07.402656").unwrap());
    assert_eq!(format_utc_shortest(at("2016-12-31T23:59:60.5").unwrap()), "2016-12-31T23:59:60.5Z");
}

/// SGP4-XP's elements are for another theory, in two lines as well.
#[test]
fn elements_of_another_theory_are_refused() {
    let xp = "1 25544U 98067A   08264.51782528 -.00002182  00000-0 -11606-4 4  2921\n2 25544  51.6416 247.4627 0006703 130.5360 325.0288 15.72125391563537\n";
    let error = elements::parse("xp", xp).unwrap_err().to_string();
    assert!(error.contains("SGP4-XP"), "{error}");
}

/// Truth: a shift of the epoch by 10 s, which moves the place along the track by 10 s of it.
#[test]
fn sets_of_one_object_are_held_beside_each_other() {
    let later = OMM.replace("01:19:07.402656", "01:19:17.402656");
    let mut sets = elements::parse("a", OMM).unwrap();
    sets.extend(elements::parse("b", &later).unwrap());
    let at = sets[1].epoch + 1.0 * Unit::Day;
    let held = elements::held(&sets, at);
    assert_eq!((held.len(), held[0].sets), (1, 2));
    assert!((held[0].age_days - 1.0).abs() < 1e-9);
    assert_eq!(held[0].nearest.epoch, sets[1].epoch);
    let apart = held[0].furthest.unwrap();
    // Drag shortens the revolution by some parts in 10⁵ a day; the Earth's pull turns the orbit by 0.7 km in 10 s.
    assert!((apart.along_s - 10.0).abs() < 0.05, "{apart:?}");
    assert!(apart.across_m < 2000.0, "{apart:?}");
}

/// Truth: astropy's GCRS and its own table of the Earth's rotation; the tables differ by less than 0.1 ms of UT1 (5 cm) and the models of
/// precession and nutation by less than 1 mas (4 cm): 0.3 m.
#[test]
fn ephemerides_of_others_are_turned_into_the_gcrs() {
    let Some(folder) = written_by_others("ephemerides_of_others_are_turned_into_the_gcrs") else {
        return;
    };
    let truth = json(&folder.path().join("gcrs.json"));
    let mut read = 0;
    for frame in ["GCRF", "EME2000", "TEME", "ITRF2014", "cbers2"] {
        for ending in ["oem", "xml", "cpf"] {
            let path = folder.path().join(format!("{frame}.{ending}"));
            if !path.exists() {
                continue;
            }
            read += 1;
            let Orbit::Ephemeris(table) = Orbit::read(&path, None, None).unwrap() else {
                panic!("{frame}.{ending} is no table")
            };
            assert_eq!(table.rows(), 31);
            assert_eq!(table.name(), if ending == "cpf" { "cbers2" } else { "CBERS 2" });
            for row in truth.as_array().unwrap() {
                let state = table.state(parse_utc(row[0].as_str().unwrap()).unwrap()).unwrap();
                let off = (state.position_m - numbers(row, 1)).length();
                let slow = (state.velocity_m_s - numbers(row, 4)).length();
                assert!(off < 0.3 && slow < 2e-3, "{frame}.{ending}: {off} m, {slow} m/s");
            }
        }
    }
    assert_eq!(read, 9);
}

#[test]
fn a_bad_ephemeris_is_refused_with_its_line() {
    let oem = "CCSDS_OEM_VERS = 2.0\nMETA_START\nOBJECT_NAME = A\nCENTER_NAME = EARTH\nREF_FRAME = GCRF\nTIME_SYSTEM = UTC\nMETA_STOP\n\
               2022-03-20T20:00:00 7000 0 0 0 7.5 0\n2022-03-20T20:01:00 6985 450 0 -0.5 7.48 0\n";
    assert!(Ephemeris::parse("a.oem", oem).is_ok());
    let cpf = "H1 CPF 2 TST 2022 03 20 19 0790 01 x\nH2 0304901 9999 28057 2022 03 20 20 00 00 2022 03 20 20 30 00 60 1 1 0 0 0 1\n\
               10 0 59658 72000.0 0 7000000 0 0\n20 0 0 7000 0\n10 0 59658 72060.0 0 6985000 450000 0\n20 0 -500 7000 0\n";
    assert!(Ephemeris::parse("a.cpf", cpf).is_ok());
    for (text, from, to, expected) in [
        (
            oem,
            "GCRF",
            "TOD",
            "x:5: REF_FRAME: found `TOD`, expected GCRF, ICRF, EME2000, TEME or an ITRF",
        ),
        (oem, "EARTH", "MOON", "x:4: CENTER_NAME: found `MOON`, expected EARTH"),
        (
            oem,
            "TIME_SYSTEM = UTC",
            "TIME_SYSTEM = TCB",
            "x:6: TIME_SYSTEM: found `TCB`, expected UTC, UT1, TAI, TT, TDB or GPS",
        ),
        (oem, "REF_FRAME = GCRF\n", "", "x:7: REF_FRAME: found no such key"),
        (oem, "7000 0 0", "7000 0 nan", "x:8: found `nan`, expected a finite number"),
        (oem, "7000 0 0 0", "7000 0 0", "x:8: found 5 numbers"),
        (oem, "20:01:00 6985", "19:01:00 6985", "x:9: time_utc"),
        (oem, "7000 0 0 0", "70 0 0 0", "x:8: x_km"),
        (
            oem,
            "2022-03-20T20:01",
            "META_START\nMETA_STOP\n2022-03-20T20:01",
            "x:9: found a second segment, expected one segment",
        ),
        (cpf, "60 1 1 0 0", "60 1 1 1 0", "x:2: reference frame (H2): found `1`"),
        (cpf, "10 0 59658 72060", "10 1 59658 72060", "x:5: direction flag: found `1`"),
        (cpf, "72060.0 0 6985000", "99999.0 0 6985000", "x:5: MJD and seconds of day"),
        (cpf, "6985000 450000", "6985000 far", "x:5: y: found `far`"),
        (cpf, "H2 0304901", "H4 0304901", "found no H2"),
    ] {
        assert!(text.contains(from), "{from}");
        let error = Ephemeris::parse("x", &text.replacen(from, to, 1)).unwrap_err().to_string();
        assert!(error.contains(expected), "{error}\nshould have: {expected}");
    }
}

/// Truth: astropy 8.0.2 (`Time(text, scale=…).utc`, UT1 by its table IERS B), and of GPS its constant 19 s to TAI. TDB is good to the 10 µs of its series, UT1 to the
/// 1.1 ms of the embedded table, which follows UT1 through a leap second.
#[test]
fn an_ephemeris_may_be_in_any_scale_of_time() {
    let first = |scale: &str, at: &str, next: &str| {
        let text = format!(
            "CCSDS_OEM_VERS = 2.0\nMETA_START\nOBJECT_NAME = A\nCENTER_NAME = EARTH\nREF_FRAME = GCRF\nTIME_SYSTEM = {scale}\nMETA_STOP\n\
             {at} 7000 0 0 0 7.5 0\n{next} 6985 450 0 -0.5 7.48 0\n"
        );
        Ephemeris::parse("a.oem", &text).map(|read| read.range().0).map_err(|e| e.to_string())
    };
    for (scale, at, utc, within_s) in [
        ("UTC", "2022-03-20T20:00:00", "2022-03-20T20:00:00Z", 0.0),
        ("UTC", "2022-079T20:00:00", "2022-03-20T20:00:00Z", 0.0),
        ("TAI", "2022-03-20T20:00:00", "2022-03-20T19:59:23Z", 0.0),
        ("TT", "2022-03-20T20:00:00.5", "2022-03-20T19:58:51.316Z", 0.0),
        ("TT", "2022-079T20:00:00.5Z", "2022-03-20T19:58:51.316Z", 0.0),
        ("GPS", "2022-03-20T20:00:00", "2022-03-20T19:59:42Z", 0.0),
        ("TDB", "2022-03-20T20:00:00", "2022-03-20T19:58:50.814393674Z", 10e-6),
        ("TDB", "2020-10-03T12:00:00", "2020-10-03T11:58:50.817688705Z", 10e-6),
        ("UT1", "2022-03-20T20:00:00", "2022-03-20T20:00:00.100485567Z", 1.1e-3),
        ("UT1", "2020-10-03T12:00:00", "2020-10-03T12:00:00.173030550Z", 1.1e-3),
        ("UT1", "2016-12-31T23:59:50", "2016-12-31T23:59:50.408712884Z", 1.1e-3),
        ("UT1", "2017-01-01T00:00:00", "2016-12-31T23:59:60.408712994Z", 1.1e-3),
        ("tai", "2017-01-01T00:00:36", "2016-12-31T23:59:60Z", 0.0),
    ] {
        // A later row: the first is what is asked for.
        let read = first(scale, at, "2022-03-20T20:01:00");
        let read = read.unwrap_or_else(|error| panic!("{scale} {at}: {error}"));
        let apart = (read - parse_utc(utc).unwrap()).to_seconds();
        assert!(apart.abs() <= within_s, "{scale} {at}: {apart} s");
    }
    for (scale, at, expected) in [
        (
            "MRT",
            "2022-03-20T20:00:00",
            "a.oem:6: TIME_SYSTEM: found `MRT`, expected UTC, UT1, TAI, TT, TDB or GPS",
        ),
        (
            "UT1",
            "2095-03-20T20:00:00",
            "a.oem:8: EPOCH: found `2095-03-20T20:00:00`, expected a time in UTC: UT1 is not known then",
        ),
        (
            "TT",
            "2016-12-31T23:59:60",
            "a.oem:8: EPOCH: found `2016-12-31T23:59:60`, expected a second from 0 to 59",
        ),
        (
            "TT",
            "2022-02-29T23:59:00",
            "a.oem:8: EPOCH: found `2022-02-29T23:59:00`, expected a day of the calendar",
        ),
        (
            "TT",
            "2022-366T23:59:00",
            "a.oem:8: EPOCH: found `2022-366T23:59:00`, expected a day of the year",
        ),
        ("GPS", "2022-03-20T20:00:00+01:00", "a.oem:8: EPOCH: found"),
        (
            "TAI",
            "1971-03-20T20:00:00",
            "a.oem:8: EPOCH: found `1971-03-20T20:00:00`, expected a year from 1972",
        ),
    ] {
        let error = first(scale, at, "2022-03-20T20:01:00").unwrap_err();
        assert!(error.contains(expected), "{error}\nshould have: {expected}");
    }
}

#[test]
fn a_file_gives_one_orbit() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("two.json");
    let inner = OMM.trim().trim_start_matches('[').trim_end_matches(']').trim();
    let other = inner.replace("25544", "123456789").replace("ISS (ZARYA)", "NEW");
    std::fs::write(&path, format!("[{inner},{other}]")).unwrap();
    assert_eq!(Orbit::read(&path, Some("123456789"), None).unwrap().name(), "NEW (123456789)");
    assert!(matches!(Orbit::read(&path, None, None), Err(ReadError::Choice { .. })));
    assert!(matches!(Orbit::read(folder.path().join("none"), None, None), Err(ReadError::File(_))));
}

/// A server on the loopback that gives out one text, and counts how often it was asked.
struct Server {
    address: String,
    asked: std::sync::Arc<std::sync::atomic::AtomicUsize>,
}

impl Server {
    fn start(status: &'static str, body: String) -> Self {
        use std::io::{Read as _, Write as _};
        let listener = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
        let address =
            format!("http://{}/gp.php?GROUP=active&FORMAT=JSON", listener.local_addr().unwrap());
        let asked = std::sync::Arc::new(std::sync::atomic::AtomicUsize::new(0));
        let count = asked.clone();
        std::thread::spawn(move || {
            for stream in listener.incoming() {
                let Ok(mut stream) = stream else { return };
                count.fetch_add(1, std::sync::atomic::Ordering::SeqCst);
                let mut head = Vec::new();
                let mut piece = [0; 1024];
                while !head.windows(4).any(|w| w == b"\r\n\r\n") {
                    match stream.read(&mut piece) {
                        Ok(n) if n > 0 => head.extend_from_slice(&piece[..n]),
                        _ => break,
                    }
                }
                let answer = format!(
                    "HTTP/1.1 {status}\r\nContent-Length: {}\r\nConnection: close\r\n\r\n{body}",
                    body.len()
                );
                let _ = stream.write_all(answer.as_bytes());
            }
        });
        Self { address, asked }
    }

    fn asked(&self) -> usize {
        self.asked.load(std::sync::atomic::Ordering::SeqCst)
    }
}

#[test]
fn a_server_is_asked_no_more_than_once_in_two_hours() {
    use sunglint_ephemeris::orbit::update::update;
    if std::process::Command::new("curl").arg("--version").output().is_err() {
        sunglint_testkit::skip("a_server_is_asked_no_more_than_once_in_two_hours", "no curl");
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let now = parse_utc("2026-11-24T12:00:00").unwrap();
    let good = Server::start("200 OK", OMM.to_owned());
    let first = update(&good.address, folder.path(), now).unwrap();
    assert_eq!((first.text.as_str(), first.sets, first.kept_since), (OMM, 1, None));
    for seconds in [0.0, 10.0, 7199.0] {
        let again = update(&good.address, folder.path(), now + seconds * Unit::Second).unwrap();
        assert_eq!((again.text.as_str(), again.kept_since), (OMM, Some(now)));
    }
    assert_eq!(good.asked(), 1);
    update(&good.address, folder.path(), now + 7201.0 * Unit::Second).unwrap();
    assert_eq!(good.asked(), 2);
    // A stamp of the future (a clock that was wrong) locks nothing up.
    update(&good.address, folder.path(), now - 90_000.0 * Unit::Second).unwrap();
    assert_eq!(good.asked(), 3);
    // Refusals and web pages count as well, and are not asked again.
    for (status, body, expected) in [
        ("403 Forbidden", "no", "403"),
        ("200 OK", "<!DOCTYPE html><html>Invalid query</html>", "has no elements"),
    ] {
        let server = Server::start(status, body.to_owned());
        let error = update(&server.address, folder.path(), now).unwrap_err().to_string();
        assert!(error.contains(expected), "{error}");
        let later = now + 600.0 * Unit::Second;
        let error = update(&server.address, folder.path(), later).unwrap_err().to_string();
        assert!(error.contains("is not asked again before 2026-11-24T14:00:00Z"), "{error}");
        assert_eq!(server.asked(), 1);
    }
    let error = update("--output=x", folder.path(), now).unwrap_err().to_string();
    assert!(error.contains("expected http://"), "{error}");
}
