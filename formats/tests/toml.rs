//! TOML into structs. Truth: the messages that a person should read, written out whole.

use serde::Deserialize;
use std::path::PathBuf;
use sunglint_formats::time::{Utc, format_utc};
use sunglint_formats::toml::{
    Document, Finite, Fraction, LatitudeDeg, NonNegative, Positive, Within,
};

#[derive(Debug, Deserialize, PartialEq)]
#[serde(deny_unknown_fields)]
struct Station {
    name: String,
    latitude_deg: LatitudeDeg,
    #[serde(default)]
    made: Option<Utc>,
    telescope: Telescope,
    channel: Vec<Channel>,
}

#[derive(Debug, Deserialize, PartialEq)]
#[serde(deny_unknown_fields)]
struct Telescope {
    aperture_mm: Positive,
    obstruction_mm: Option<NonNegative>,
    offset_mm: Option<[Finite; 2]>,
}

#[derive(Debug, Deserialize, PartialEq)]
#[serde(deny_unknown_fields)]
struct Channel {
    name: String,
    dead_time_ns: NonNegative,
    transmission: Option<Fraction>,
    mode: Option<Mode>,
    slots: Option<u8>,
    curve: Option<PathBuf>,
    tilt_rad: Option<f64>,
}

#[derive(Debug, Deserialize, PartialEq)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
enum Mode {
    Photon,
    Analog { gain: Positive },
}

const GOOD: &str = r#"name = "hill"
latitude_deg = 45.5
made = 2016-12-31T23:59:60.5Z

[telescope]
aperture_mm = 400
obstruction_mm = 120.0
offset_mm = [1, -2.5]

[[channel]]
name = "g"
dead_time_ns = 22
transmission = 0.9
mode = "photon"

[[channel]]
name = "r"
dead_time_ns = 0
mode = { analog = { gain = 2 } }
slots = 7
curve = "curves/r.csv"
"#;

#[test]
fn a_document_becomes_a_struct() {
    let document = Document::new("sites/hill.toml", GOOD).unwrap();
    let station: Station = document.parse().unwrap();
    assert_eq!(station.latitude_deg.get(), 45.5);
    assert_eq!(format_utc(station.made.unwrap().0, 1), "2016-12-31T23:59:60.5Z");
    assert_eq!(station.telescope.aperture_mm.get(), 400.0);
    assert_eq!(station.channel[1].mode, Some(Mode::Analog { gain: Positive::new(2.0).unwrap() }));
    let curve = station.channel[1].curve.as_ref().unwrap();
    assert_eq!(document.resolve(curve), PathBuf::from("sites/curves/r.csv"));
    assert_eq!(document.resolve("/etc/x"), PathBuf::from("/etc/x"));
}

#[track_caller]
fn refused(from: &str, to: &str, message: &str) {
    assert!(GOOD.contains(from), "the text has no `{from}`");
    let document = Document::new("hill.toml", GOOD.replacen(from, to, 1));
    let error = match document {
        Ok(document) => document.parse::<Station>().expect_err("it is wrong"),
        Err(error) => error,
    };
    assert_eq!(error.to_string(), message);
}

#[test]
fn keys_that_are_wrong() {
    refused(
        "aperture_mm",
        "apertur_mm",
        "hill.toml:6: telescope.apertur_mm: found an unknown key, expected `aperture_mm`, `obstruction_mm` or `offset_mm` \
         (did you mean `aperture_mm`?)",
    );
    refused(
        "dead_time_ns = 22",
        "dead_time_us = 0.022",
        "hill.toml:12: channel[0].dead_time_us: found an unknown key, expected `dead_time_ns` (did you mean `dead_time_ns`? \
         1 us is 1000 ns: multiply the value by 1000)",
    );
    refused(
        "obstruction_mm = 120.0",
        "obstruction_m = 0.12",
        "hill.toml:7: telescope.obstruction_m: found an unknown key, expected `obstruction_mm` (did you mean \
         `obstruction_mm`? 1 m is 1000 mm: multiply the value by 1000)",
    );
    refused(
        "slots = 7",
        "tilt_deg = 7",
        "hill.toml:20: channel[1].tilt_deg: found an unknown key, expected `tilt_rad` (did you mean `tilt_rad`? convert the \
         value from deg to rad)",
    );
    refused(
        "aperture_mm = 400\n",
        "",
        "hill.toml:5: telescope.aperture_mm: found no such key, expected one: it is required",
    );
    refused(
        "name = \"hill\"",
        "",
        "hill.toml:1: name: found no such key, expected one: it is required",
    );
    refused(
        "dead_time_ns = 0\n",
        "",
        "hill.toml:16: channel[1].dead_time_ns: found no such key, expected one: it is required",
    );
}

#[test]
fn values_that_are_wrong() {
    refused(
        "dead_time_ns = 22",
        "dead_time_ns = -22",
        "hill.toml:12: channel[0].dead_time_ns: found -22, expected a number of 0 or above",
    );
    refused(
        "dead_time_ns = 22",
        "dead_time_ns = inf",
        "hill.toml:12: channel[0].dead_time_ns: found inf, expected a number of 0 or above",
    );
    refused(
        "dead_time_ns = 22",
        "dead_time_ns = \"22 ns\"",
        "hill.toml:12: channel[0].dead_time_ns: found \"22 ns\", expected a number of 0 or above",
    );
    refused(
        "transmission = 0.9",
        "transmission = 90",
        "hill.toml:13: channel[0].transmission: found 90, expected a fraction from 0 to 1",
    );
    refused(
        "latitude_deg = 45.5",
        "latitude_deg = nan",
        "hill.toml:2: latitude_deg: found nan, expected a number from -90 to 90",
    );
    refused(
        "offset_mm = [1, -2.5]",
        "offset_mm = [1,\n -inf]",
        "hill.toml:9: telescope.offset_mm[1]: found -inf, expected a finite number",
    );
    refused(
        "offset_mm = [1, -2.5]",
        "offset_mm = [1]",
        "hill.toml:8: telescope.offset_mm: found an array of 1, expected an array of 2",
    );
    refused(
        "slots = 7",
        "tilt_rad = 1e999",
        "hill.toml:20: channel[1].tilt_rad: found 1e999, expected a number",
    );
    refused(
        "slots = 7",
        "slots = 700",
        "hill.toml:20: channel[1].slots: found 700, expected a whole number from 0 to 255",
    );
    refused(
        "slots = 7",
        "slots = 99999999999999999999",
        "hill.toml:20: channel[1].slots: found 99999999999999999999, expected a whole number from 0 to 255",
    );
    refused(
        "mode = \"photon\"",
        "mode = \"foton\"",
        "hill.toml:14: channel[0].mode: found \"foton\", expected \"photon\" or \"analog\" (did you mean `photon`?)",
    );
    refused(
        "gain = 2",
        "gain = 0",
        "hill.toml:19: channel[1].mode.analog.gain: found 0, expected a number above 0",
    );
    refused("name = \"hill\"", "name = 3", "hill.toml:1: name: found 3, expected text in quotes");
    refused(
        "[telescope]",
        "[[telescope]]",
        "hill.toml:5: telescope: found an array of 1, expected a table",
    );
    refused(
        "2016-12-31T23:59:60.5Z",
        "2016-12-30T23:59:60.5Z",
        "hill.toml:3: made: found 2016-12-30T23:59:60.5Z, expected a second from 0 to 59",
    );
}

#[test]
fn checks_of_other_types_keep_the_place() {
    #[derive(Debug, Deserialize)]
    #[serde(try_from = "i64")]
    struct Even;
    impl TryFrom<i64> for Even {
        type Error = String;
        fn try_from(number: i64) -> Result<Self, String> {
            if number % 2 == 0 { Ok(Self) } else { Err(format!("{number} is odd")) }
        }
    }
    #[derive(Debug, Deserialize)]
    #[serde(untagged)]
    #[expect(dead_code, reason = "only read")]
    enum Either {
        Number(f64),
        Text(String),
    }
    #[derive(Debug, Deserialize)]
    #[expect(dead_code, reason = "only read")]
    struct Plan {
        steps: Option<Vec<Even>>,
        either: Option<Either>,
    }
    let error = |source: &str| {
        Document::new("plan.toml", source).unwrap().parse::<Plan>().unwrap_err().to_string()
    };
    assert_eq!(
        error("steps = [\n  2,\n  3,\n]\n"),
        "plan.toml:3: steps[1]: found 3, expected a valid value (3 is odd)"
    );
    assert_eq!(
        error("\neither = true\n"),
        "plan.toml:2: either: found true, expected a valid value (data did not match any variant of untagged enum Either)"
    );
}

#[test]
fn syntax_that_is_wrong() {
    refused(
        "latitude_deg = 45.5",
        "latitude_deg = = 45.5",
        "hill.toml:2: found `latitude_deg = = 45.5`, expected TOML (extra `=`, expected nothing)",
    );
    refused(
        "latitude_deg = 45.5",
        "name = \"again\"",
        "hill.toml:2: found `name = \"again\"`, expected TOML (duplicate key)",
    );
}

#[test]
fn errors_made_later_have_the_place() {
    let document = Document::new("hill.toml", GOOD).unwrap();
    let error = document
        .error_at("telescope.obstruction_mm", "less than aperture_mm")
        .with_hint("the obstruction lies inside the aperture");
    assert_eq!(
        error.to_string(),
        "hill.toml:7: telescope.obstruction_mm: found 120.0, expected less than aperture_mm (the obstruction lies inside \
         the aperture)"
    );
    assert_eq!(document.line_of("channel[1].mode.analog.gain"), Some(19));
    assert_eq!(document.line_of("channel[2].name"), None);
    assert_eq!(
        document.error_at("telescope.focal_length_mm", "a value for it").to_string(),
        "hill.toml:5: telescope.focal_length_mm: found no such key, expected a value for it"
    );
}

#[test]
fn numbers_can_be_made_in_programs_too() {
    assert!(Positive::new(0.0).is_none() && Positive::new(f64::INFINITY).is_none());
    assert_eq!(NonNegative::new(0.0).map(f64::from), Some(0.0));
    assert_eq!(Within::<0, 5>::new(5.0).map(f64::from), Some(5.0));
    assert!(Within::<0, 5>::new(5.1).is_none());
}
