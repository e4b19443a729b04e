//! Two-line elements: what is read, what is refused, what is warned of.

#![allow(clippy::unwrap_used, reason = "in helpers too, a failure should stop the run")]

use hifitime::{Duration, Epoch};
use proptest::prelude::*;
use sunglint_ephemeris::orbit::tle::{ChoiceError, choose, parse, parse_lenient};
use sunglint_ephemeris::orbit::{DecayCause, Orbit, OrbitError, Tle};
use sunglint_formats::time::{format_utc, format_utc_shortest, parse_utc};
use sunglint_radiometry::sky::{EarthOrientation, SkyFrame};

/// The example of the format's description (NASA, CelesTrak).
const LINE_1: &str = "1 25544U 98067A   08264.51782528 -.00002182  00000-0 -11606-4 0  2927";
const LINE_2: &str = "2 25544  51.6416 247.4627 0006703 130.5360 325.0288 15.72125391563537";
const OTHER_1: &str = "1 28057U 03049A   06177.78615833  .00000060  00000-0  35940-4 0  1836";
const OTHER_2: &str = "2 28057  98.4283 247.6961 0000884  88.1964 271.9322 14.35478080140550";

fn with_checksum(line: &str) -> String {
    let body: String = line.chars().take(68).collect();
    let sum: u32 =
        body.chars().map(|c| if c == '-' { 1 } else { c.to_digit(10).unwrap_or(0) }).sum();
    format!("{body}{}", sum % 10)
}

/// A line with other columns (from 0) and the checksum that they ask for.
fn changed(line: &str, column: usize, text: &str) -> String {
    with_checksum(&format!("{}{text}{}", &line[..column], &line[column + text.len()..]))
}

fn one(line1: &str, line2: &str) -> Tle {
    parse("t.tle", &format!("{line1}\n{line2}\n")).unwrap().remove(0)
}

/// Truth: the description of the format, which explains this very set.
#[test]
fn the_example_of_the_format() {
    let tle = &parse("iss.tle", &format!("ISS (ZARYA)\n{LINE_1}\n{LINE_2}\n")).unwrap()[0];
    assert_eq!(tle.name.as_deref(), Some("ISS (ZARYA)"));
    assert_eq!((tle.norad_id, tle.international_designator.as_deref()), (25544, Some("1998-067A")));
    // Day 264.51782528 of 2008: 20 September and 44740.104192 s, to the nanosecond.
    assert_eq!(format_utc_shortest(tle.epoch), "2008-09-20T12:25:40.104192Z");
    assert_eq!((tle.inclination_deg, tle.eccentricity), (51.6416, 0.000_670_3));
    assert_eq!(tle.mean_motion_rev_day, 15.721_253_91);
    assert!((tle.bstar - -0.116_06e-4).abs() < 1e-18);
    assert_eq!((tle.line1.as_str(), tle.line2.as_str()), (LINE_1, LINE_2));
    assert_eq!(tle.label(), "ISS (ZARYA) (25544)");
    assert!((tle.period_s() - 5495.7).abs() < 0.1);
}

#[test]
fn the_shapes_that_files_have() {
    let plain =
        parse("t", &format!("ISS\n{LINE_1}\n{LINE_2}\nCBERS 2\n{OTHER_1}\n{OTHER_2}\n")).unwrap();
    assert_eq!(plain.len(), 2);
    for text in [
        format!("0 ISS\r\n{LINE_1}\r\n{LINE_2}\r\n0 CBERS 2\r\n{OTHER_1}\r\n{OTHER_2}\r\n"),
        format!(
            "# from somewhere\n\nISS   \n{LINE_1}  \n\n# between\n{LINE_2}\n\n\nCBERS 2\n{OTHER_1}\n{OTHER_2}"
        ),
    ] {
        assert_eq!(parse("t", &text).unwrap(), plain, "{text}");
    }
    let bare = parse("t", &format!("{LINE_1}\n{LINE_2}\nCBERS 2\n{OTHER_1}\n{OTHER_2}")).unwrap();
    assert_eq!((bare[0].name.as_deref(), bare[1].name.as_deref()), (None, Some("CBERS 2")));
    assert_eq!(bare[0].label(), "object 25544");
    // Names that look like lines of elements.
    for name in ["1 KUNS-PF", "2 OF 3", "1998-067A DEB"] {
        let named = parse("t", &format!("{name}\n{LINE_1}\n{LINE_2}\n")).unwrap();
        assert_eq!(named[0].name.as_deref(), Some(name));
    }
}

/// Truth: Space-Track's table of alpha-5 examples.
#[test]
fn alpha_5_numbers() {
    for (columns, number) in [
        ("A0000", 100_000),
        ("E8493", 148_493),
        ("H9999", 179_999),
        ("J2931", 182_931),
        ("N0000", 220_000),
        ("P4018", 234_018),
        ("W1928", 301_928),
        ("Z9999", 339_999),
        ("    5", 5),
        ("00005", 5),
    ] {
        let tle = one(&changed(LINE_1, 2, columns), &changed(LINE_2, 2, columns));
        assert_eq!(tle.norad_id, number);
        tle.orbit().unwrap().teme(tle.epoch).unwrap();
    }
    for columns in ["I0000", "O0000", "a0000", "AA000", "A 000", "1 234", "+1234", "     "] {
        let (line1, line2) = (changed(LINE_1, 2, columns), changed(LINE_2, 2, columns));
        let error = parse("t.tle", &format!("{line1}\n{line2}\n")).unwrap_err().to_string();
        assert_eq!(
            error,
            format!(
                "t.tle:1: catalogue number (columns 3-7): found `{columns}`, expected five digits, or a letter other than I and O \
                 and four digits"
            )
        );
    }
}

#[track_caller]
fn refused(text: &str, message: &str) {
    assert_eq!(parse("t.tle", text).unwrap_err().to_string(), message);
}

#[test]
fn what_is_wrong_is_named_with_its_line_and_columns() {
    let bad = LINE_1.replace("0  2927", "0  2926");
    refused(
        &format!("ISS\n{bad}\n{LINE_2}\n"),
        "t.tle:2: checksum (column 69): found `6`, expected 7, the checksum of the columns before (a character was changed or lost: \
         fetch the elements anew)",
    );
    let lines = |line1: &str, line2: &str| format!("{line1}\n{line2}\n");
    refused(
        &lines(&LINE_1[..68], LINE_2),
        "t.tle:1: found 68 columns, expected 69 columns (the last column, the checksum, is missing)",
    );
    refused(
        &lines(LINE_1, &format!("{LINE_2}0.0 1440.0")),
        "t.tle:2: found 79 columns, expected 69 columns (nothing may follow the checksum in column 69)",
    );
    refused(
        &lines(&LINE_1.replace("U 98067A  ", "U 98067A "), LINE_2),
        "t.tle:1: found 68 columns, expected 69 columns (the last column, the checksum, is missing)",
    );
    refused(
        &lines(LINE_1, &changed(LINE_2, 7, "9")),
        "t.tle:2: column 8: found `9`, expected a blank",
    );
    refused(
        &lines(LINE_1, &changed(LINE_2, 2, "25545")),
        "t.tle:2: catalogue number (columns 3-7): found `25545`, expected `25544` as in line 1",
    );
    refused(
        &lines(LINE_1, &changed(LINE_2, 8, "     NaN")),
        "t.tle:2: inclination (columns 9-16): found `     NaN`, expected a number with a point",
    );
    refused(
        &lines(LINE_1, &changed(LINE_2, 8, "181.6416")),
        "t.tle:2: inclination (columns 9-16): found `181.6416`, expected 0 to 180 degrees",
    );
    refused(
        &lines(LINE_1, &changed(LINE_2, 26, " 006703")),
        "t.tle:2: eccentricity (columns 27-33): found ` 006703`, expected seven digits",
    );
    refused(
        &lines(&changed(LINE_1, 53, " 11606 4"), LINE_2),
        "t.tle:1: B* (columns 54-61): found ` 11606 4`, expected a number such as ` 28098-4` or `-11606-4`",
    );
    refused(
        &lines(LINE_1, &changed(LINE_2, 52, " 0.00000000")),
        "t.tle:2: mean motion (columns 53-63): found ` 0.00000000`, expected more than 0 revolutions a day",
    );
    for day in ["000.50000000", "366.00000000", "367.00000000"] {
        // 2009 has 365 days.
        refused(
            &lines(&changed(LINE_1, 18, &format!("09{day}")), LINE_2),
            &format!(
                "t.tle:1: epoch (columns 19-32): found `09{day}`, expected a year (57 to 99 are 1957 to 1999) and a day in it, since \
                 1972, where UTC begins"
            ),
        );
    }
    assert!(parse("t", &lines(&changed(LINE_1, 18, "71365.99999999"), LINE_2)).is_err());
    assert!(parse("t", &lines(&LINE_1.replace("98067A", "98067Ä"), LINE_2)).is_err());
}

#[test]
fn lines_without_their_partners() {
    let line1 = format!("`{}…`", &LINE_1[..40]);
    let line2 = format!("`{}…`", &LINE_2[..40]);
    refused(
        &format!("{LINE_1}\n"),
        &format!("t.tle:1: found {line1}, expected a line 2 after this line 1"),
    );
    refused(
        &format!("{LINE_2}\n"),
        &format!("t.tle:1: found {line2}, expected a line 1 before this line 2"),
    );
    refused(
        &format!("{LINE_1}\n{LINE_1}\n{LINE_2}\n"),
        &format!("t.tle:1: found {line1}, expected a line 2 after this line 1"),
    );
    refused(
        "No GP data found\n",
        "t.tle:1: found `No GP data found`, expected a line 1 of 69 columns, or a name before one",
    );
    refused(
        "# nothing\n\n",
        "t.tle: found no elements, expected two-line elements: a line 1 and a line 2 of 69 columns",
    );
}

/// One bad set of a catalogue does not hide the others, wherever it stands.
#[test]
fn a_catalogue_is_read_past_its_errors() {
    let bad = LINE_1.replace("0  2927", "0  2926");
    let text = format!(
        "BAD\n{bad}\n{LINE_2}\nGOOD\n{OTHER_1}\n{OTHER_2}\nLONE\n{LINE_1}\nISS\n{LINE_1}\n{LINE_2}\nNAME WITHOUT\n"
    );
    let (good, bad) = parse_lenient("many.tle", &text);
    let names: Vec<&str> = good.iter().filter_map(|t| t.name.as_deref()).collect();
    assert_eq!(names, ["GOOD", "ISS"]);
    assert_eq!(bad.iter().map(|e| e.line).collect::<Vec<_>>(), [Some(2), Some(8), Some(12)]);
    assert_eq!(parse("many.tle", &text).unwrap_err(), bad[0]);
    let (good, bad) = parse_lenient("empty.tle", "");
    assert_eq!((good.len(), bad.len()), (0, 1));
}

#[test]
fn one_set_is_chosen_by_number_name_or_part_of_it() {
    let later = changed(LINE_1, 18, "08274.51782528");
    let text = format!(
        "ISS (ZARYA)\n{LINE_1}\n{LINE_2}\nISS (ZARYA)\n{later}\n{LINE_2}\nCBERS 2\n{OTHER_1}\n{OTHER_2}\n"
    );
    let all = parse("t", &text).unwrap();
    let near = Some(parse_utc("2008-09-30").unwrap());
    for which in ["28057", "cbers 2", "CBERS", " cbers"] {
        assert_eq!(choose(&all, Some(which), None).unwrap().norad_id, 28057, "{which}");
    }
    // Of two sets of one object, the nearer.
    assert_eq!(choose(&all, Some("25544"), near).unwrap().line1, later);
    let early = Some(parse_utc("2008-09-01").unwrap());
    assert_eq!(choose(&all, Some("iss"), early).unwrap().line1, LINE_1);
    assert!(matches!(
        choose(&all, Some("iss"), None),
        Err(ChoiceError::Ambiguous { count: 2, .. })
    ));
    assert_eq!(
        choose(&all, None, near).unwrap_err().to_string(),
        "there are 3 sets of elements: name one by its number or name: ISS (ZARYA) (25544) of 2008-09-20T12:25:40Z, ISS (ZARYA) \
         (25544) of 2008-09-30T12:25:40Z, CBERS 2 (28057) of 2006-06-26T18:52:04Z"
    );
    let error = choose(&all, Some("cbres 2"), near).unwrap_err();
    assert_eq!(
        error.to_string(),
        "`cbres 2` is not among the 3 sets of elements; did you mean `CBERS 2`?"
    );
    assert_eq!(choose(&all[2..], None, None).unwrap().norad_id, 28057);
}

/// Truth: elapsed time. Elements of 2016-12-31T12:00:00 are 720 min and 1 s old at midnight, because of the leap second, and
/// the object moves on through second 60 as through any other: 7.5 km in each second.
#[test]
fn a_leap_second_is_a_second_of_flight() {
    let tle = one(&changed(LINE_1, 18, "16366.50000000"), LINE_2);
    assert_eq!(format_utc_shortest(tle.epoch), "2016-12-31T12:00:00Z");
    let orbit = tle.orbit().unwrap();
    let at = |text: &str| orbit.teme(parse_utc(text).unwrap()).unwrap();
    let midnight = at("2017-01-01T00:00:00Z");
    let truth = orbit.teme_after(720.0 + 1.0 / 60.0).unwrap();
    assert!((midnight.position_m - truth.position_m).length() < 1e-5);
    let seconds = ["2016-12-31T23:59:59.5Z", "2016-12-31T23:59:60.5Z", "2017-01-01T00:00:00.5Z"];
    let states = seconds.map(at);
    for pair in states.windows(2) {
        let way = (pair[1].position_m - pair[0].position_m).length();
        let speed = pair[0].velocity_m_s.length();
        assert!((way / speed - 1.0).abs() < 1e-3, "{way} m in a second of {speed} m/s");
    }
    // A day with 86,401 s, whose fraction counts 86,400 s: its last instant is one second before the next day.
    let late = one(&changed(LINE_1, 18, "16366.99999999"), LINE_2);
    assert_eq!(format_utc_shortest(late.epoch), "2016-12-31T23:59:59.999136Z");
}

/// TEME to GCRS hangs on the frame's epoch by precession alone, and on UT1 and the pole not at all.
#[test]
fn the_frame_of_the_arrival_serves_the_emission() {
    let tle = one(OTHER_1, OTHER_2);
    let orbit = Orbit::from(tle.orbit().unwrap());
    let epoch = parse_utc("2006-06-27T05:00:00Z").unwrap();
    let frame = |seconds: f64, earth: &EarthOrientation| {
        SkyFrame::new(epoch + Duration::from_seconds(seconds), earth).unwrap()
    };
    let zero = EarthOrientation::zero();
    let state = orbit.state(epoch, &frame(0.0, &zero)).unwrap();
    let other = orbit.state(epoch, &frame(1.0, &zero)).unwrap();
    assert!((state.position_m - other.position_m).length() < 1e-3);
    let turned = EarthOrientation::constant(0.5, 0.3, -0.2).unwrap();
    let other = orbit.state(epoch, &frame(0.0, &turned)).unwrap();
    assert!((state.position_m - other.position_m).length() < 1e-3);
}

#[test]
fn old_elements_are_warned_of_with_their_age() {
    let tle = one(OTHER_1, OTHER_2);
    let orbit = Orbit::from(tle.orbit().unwrap());
    let days = |days: f64| tle.epoch + Duration::from_seconds(86_400.0 * days);
    let warnings = |from: f64, to: f64| orbit.warnings(days(from), days(to));
    assert!(warnings(-2.9, 2.9).is_empty());
    let [week] = &warnings(6.9, 7.0)[..] else { panic!() };
    assert_eq!(
        week,
        "object 28057: the elements of 2006-06-26T18:52:04Z are 7.0 days old: expect an error of the order of 1 to 3 km a day along \
         the track in low orbit; take elements of that day"
    );
    let [before] = &warnings(-4.0, 1.0)[..] else { panic!() };
    assert!(before.contains("are 4.0 days ahead of their epoch"), "{before}");
    let [year] = &warnings(365.0, 365.2)[..] else { panic!() };
    assert!(year.contains("365.2 days old") && year.contains("SGP4 is no prediction"), "{year}");
    // It is a warning: the state is there.
    let frame = SkyFrame::new(days(365.0), &EarthOrientation::zero()).unwrap();
    assert!(orbit.state(days(365.0), &frame).is_ok());
}

#[test]
fn what_decays_says_when_and_why() {
    let tle = one(
        "1 22312U 93002D   06094.46235912  .99999999  81888-5  49949-3 0  3953",
        "2 22312  62.1486  77.4698 0308723 267.9229  88.7392 15.95744531 98783",
    );
    let orbit = Orbit::from(tle.orbit().unwrap());
    let epoch = tle.epoch + Duration::from_seconds(10.0 * 3600.0);
    let frame = SkyFrame::new(epoch, &EarthOrientation::zero()).unwrap();
    let error = orbit.state(epoch, &frame).unwrap_err();
    let OrbitError::Decayed { hours_after_epoch, cause, .. } = &error else { panic!("{error}") };
    assert_eq!(*hours_after_epoch, 10.0);
    assert!(matches!(cause, DecayCause::MeanEccentricity(e) if *e < 0.0));
    let text = error.to_string();
    let start = "object 22312: decayed or out of SGP4's reach +10.00 h from the epoch of its elements \
                 (2006-04-04T11:05:48Z): the mean eccentricity is -0.00";
    assert!(text.starts_with(start), "{text}");
    // A year later, and before 1972: errors, no panic.
    for years in [1.0, 90.0, -30.0] {
        assert!(
            orbit.state(tle.epoch + Duration::from_seconds(years * 3.15576e7), &frame).is_err()
        );
    }
    for minutes in [f64::NAN, f64::INFINITY, -1e300] {
        assert_eq!(tle.orbit().unwrap().teme_after(minutes).unwrap_err(), DecayCause::NotFinite);
    }
}

/// An all but parabolic orbit in a low one's period is inside the Earth from the start: an error at the epoch itself.
#[test]
fn elements_that_are_no_orbit_have_no_state() {
    for (eccentricity, mean_motion) in [("9999999", "15.72125391"), ("0006703", "99.72125391")] {
        let tle = one(LINE_1, &changed(&changed(LINE_2, 26, eccentricity), 52, mean_motion));
        let error = tle.orbit().unwrap().teme(tle.epoch).unwrap_err();
        assert!(matches!(error, OrbitError::Decayed { hours_after_epoch: 0.0, .. }), "{error}");
    }
}

proptest! {
    /// Whatever stands in the columns, there is an answer or an error, and never a panic.
    #[test]
    fn damaged_lines_never_panic(
        changes in proptest::collection::vec((0_usize..2, 0_usize..69, 32_u8..127), 1..4),
        minutes in -1e5_f64..1e5,
    ) {
        let mut lines = [LINE_1.as_bytes().to_vec(), OTHER_2.as_bytes().to_vec()];
        lines[1][2..7].copy_from_slice(b"25544");
        for (line, column, byte) in changes {
            lines[line][column] = byte;
        }
        let text: Vec<String> =
            lines.iter().map(|l| with_checksum(std::str::from_utf8(l).unwrap())).collect();
        if let Ok(sets) = parse("damaged", &text.join("\n")) {
            let (from, tle): (Epoch, &Tle) = (sets[0].epoch, &sets[0]);
            let _ = format_utc(from, 0);
            if let Ok(orbit) = tle.orbit() && let Ok(state) = orbit.teme_after(minutes) {
                prop_assert!(state.position_m.is_finite() && state.velocity_m_s.is_finite());
            }
        }
    }

    #[test]
    fn no_text_panics(text in "\\PC{0,200}") {
        let _ = parse_lenient("random", &text);
    }
}

/// Truth: by hand. A number that no object has is not looked for within names.
#[test]
fn a_number_is_never_a_part_of_a_name() {
    let text = format!("STARLINK-1500 OF 25\n{LINE_1}\n{LINE_2}\n");
    let tles = parse("t.tle", &text).unwrap();
    for which in ["5", "0", "1500", "25"] {
        assert!(
            matches!(choose(&tles, Some(which), None), Err(ChoiceError::Unknown { .. })),
            "{which}"
        );
    }
    assert_eq!(choose(&tles, Some("starlink"), None).unwrap().norad_id, tles[0].norad_id);
}

/// The file of Vallado et al. (2006) has times behind its lines 2. Truth: the same lines cut to 69 columns by hand.
#[test]
fn remarks_behind_the_checksum_are_passed_over() {
    let plain = parse("t.tle", &format!("{LINE_1}\n{LINE_2}\n")).unwrap();
    let remarked = format!("{LINE_1} a\n{LINE_2}      0.0      4320.0        360.00\r\n");
    let [a, b] = [plain, parse("t.tle", &remarked).unwrap()];
    assert_eq!(a.len(), 1);
    assert_eq!(format!("{a:?}"), format!("{b:?}"));
}
