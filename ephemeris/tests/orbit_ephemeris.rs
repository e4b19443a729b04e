//! Tables of positions: interpolation against closed-form orbits, and what files may not say.

#![allow(clippy::unwrap_used, reason = "in helpers too, a failure should stop the run")]

use glam::DVec3;
use hifitime::{Duration, Epoch};
use sunglint_ephemeris::orbit::{Ephemeris, EphemerisRow, Orbit, OrbitError, State};
use sunglint_formats::time::{format_utc, parse_utc};

const MU: f64 = 3.986_004_418e14;

fn start() -> Epoch {
    parse_utc("2026-03-14T04:20:30Z").unwrap()
}

fn after(seconds: f64) -> Epoch {
    start() + Duration::from_total_nanoseconds((seconds * 1e9).round() as i128)
}

/// A Kepler ellipse, by Newton's solution of Kepler's equation.
fn kepler(semi_major_m: f64, eccentricity: f64, seconds: f64) -> State {
    let n = (MU / semi_major_m.powi(3)).sqrt();
    let mean = n * seconds + 0.7;
    let mut e = mean;
    for _ in 0..30 {
        e -= (e - eccentricity * e.sin() - mean) / (1.0 - eccentricity * e.cos());
    }
    let minor = semi_major_m * (1.0 - eccentricity * eccentricity).sqrt();
    let rate = n / (1.0 - eccentricity * e.cos());
    let (p, q) = (DVec3::new(0.6, 0.0, 0.8), DVec3::new(-0.48, 0.8, 0.36));
    State {
        position_m: p * semi_major_m * (e.cos() - eccentricity) + q * minor * e.sin(),
        velocity_m_s: (-p * semi_major_m * e.sin() + q * minor * e.cos()) * rate,
    }
}

fn rows(
    semi_major_m: f64,
    e: f64,
    step_s: f64,
    count: usize,
    velocities: bool,
) -> Vec<EphemerisRow> {
    (0..count)
        .map(|i| {
            let state = kepler(semi_major_m, e, step_s * i as f64);
            EphemerisRow {
                epoch: after(step_s * i as f64),
                position_m: state.position_m,
                velocity_m_s: velocities.then_some(state.velocity_m_s),
            }
        })
        .collect()
}

/// The largest error in m and m/s over a part of the table.
fn errors(ephemeris: &Ephemeris, a: f64, e: f64, from_s: f64, to_s: f64) -> (f64, f64) {
    let (mut position, mut velocity) = (0.0_f64, 0.0_f64);
    for i in 0..=2000 {
        let seconds = from_s + (to_s - from_s) * f64::from(i) / 2000.0;
        let (ours, truth) = (ephemeris.state(after(seconds)).unwrap(), kepler(a, e, seconds));
        position = position.max((ours.position_m - truth.position_m).length());
        velocity = velocity.max((ours.velocity_m_s - truth.velocity_m_s).length());
    }
    (position, velocity)
}

/// Truth: the ellipse in closed form. The limits are what the type's page says of low orbits; the table's own estimate must
/// not be below the error, nor above it by more than the factor that one order less costs.
#[test]
fn interpolation_keeps_what_it_says() {
    for (a, e, step_s, velocities, middle_m, ends_m, m_s) in [
        (7.0e6, 0.001, 60.0, true, 2e-7, 5e-7, 1e-8),
        (7.0e6, 0.001, 300.0, true, 0.02, 0.05, 3e-4),
        (7.0e6, 0.001, 60.0, false, 2e-7, 1e-6, 1e-8),
        (7.0e6, 0.001, 300.0, false, 0.1, 3.0, 1e-3),
        (26.6e6, 0.7, 60.0, true, 2e-7, 2e-7, 1e-8),
        (42.2e6, 0.0, 900.0, false, 5e-7, 5e-6, 1e-8),
    ] {
        let ephemeris = Ephemeris::new("kepler", &rows(a, e, step_s, 60, velocities)).unwrap();
        let end_s = step_s * 59.0;
        let (middle, middle_m_s) = errors(&ephemeris, a, e, 5.0 * step_s, end_s - 5.0 * step_s);
        let (whole, _) = errors(&ephemeris, a, e, 0.0, end_s);
        let estimate = ephemeris.interpolation_error_m();
        println!(
            "{a:e} m, {step_s} s, velocities {velocities}: {middle:.1e} m, {middle_m_s:.1e} m/s; with the \
             ends {whole:.1e} m; estimated {estimate:.1e} m"
        );
        assert!(middle < middle_m && whole < ends_m && middle_m_s < m_s);
        // Below a micrometre only rounding is left on both sides.
        assert!(whole < 1.2 * estimate + 2e-6, "{whole} {estimate}");
        assert!(estimate < 1e5 * whole.max(1e-7), "{whole} {estimate}");
        // At the rows it is the row.
        let state = ephemeris.state(after(10.0 * step_s)).unwrap();
        assert!((state.position_m - kepler(a, e, 10.0 * step_s).position_m).length() < 1e-6);
    }
}

/// Truth: a polynomial of the degree that the rows determine is met exactly, with rows at uneven times.
#[test]
fn polynomials_are_met_exactly() {
    let place =
        |t: f64| DVec3::new(7e6 + 3e3 * t - 0.5 * t * t, 1e6 - 7e3 * t, 2e6 + 1e-4 * t.powi(3));
    let speed = |t: f64| DVec3::new(3e3 - t, -7e3, 3e-4 * t * t);
    let times = [0.0, 11.0, 13.5, 40.0];
    for velocities in [false, true] {
        let rows: Vec<EphemerisRow> = times
            .iter()
            .map(|&t| EphemerisRow {
                epoch: after(t),
                position_m: place(t),
                velocity_m_s: velocities.then(|| speed(t)),
            })
            .collect();
        let few = if velocities { &rows[..2] } else { &rows[..] };
        let ephemeris = Ephemeris::new("cubic", few).unwrap();
        for t in [0.0, 3.3, 10.9] {
            let state = ephemeris.state(after(t)).unwrap();
            assert!((state.position_m - place(t)).length() < 1e-6);
            assert!((state.velocity_m_s - speed(t)).length() < 1e-6);
        }
    }
}

#[test]
fn the_table_is_not_extrapolated() {
    let orbit = Orbit::from(Ephemeris::new("sat", &rows(7e6, 0.0, 60.0, 20, true)).unwrap());
    let Orbit::Ephemeris(ephemeris) = &orbit else { panic!() };
    let (first, last) = ephemeris.range();
    assert!(ephemeris.state(first).is_ok() && ephemeris.state(last).is_ok());
    let nanosecond = Duration::from_total_nanoseconds(1);
    assert!(ephemeris.state(first - nanosecond).is_err());
    let error = ephemeris.state(last + nanosecond * 1_000_000).unwrap_err();
    assert_eq!(
        error.to_string(),
        "sat: 2026-03-14T04:39:30.001Z is outside the table of positions, which holds 2026-03-14T04:20:30.000Z to \
         2026-03-14T04:39:30.000Z and is not extrapolated"
    );
    assert!(orbit.warnings(first, last).is_empty());
    let coarse = Ephemeris::new("sat", &rows(7e6, 0.0, 900.0, 20, false)).unwrap();
    let [warning] = &coarse.warnings()[..] else { panic!("{:?}", coarse.warnings()) };
    assert!(warning.contains("give rows closer together, or velocities"), "{warning}");
}

fn csv(velocities: bool, change: impl Fn(usize, String) -> String) -> String {
    let mut text = String::from("# synthetic\ntime_utc,x_km,y_km,z_km");
    text.push_str(if velocities { ",vx_km_s,vy_km_s,vz_km_s\n\n" } else { "\n\n" });
    for (i, row) in rows(7e6, 0.0, 60.0, 6, true).iter().enumerate() {
        let (p, v) = (row.position_m / 1e3, row.velocity_m_s.unwrap() / 1e3);
        let mut line = format!("{},{},{},{}", format_utc(row.epoch, 3), p.x, p.y, p.z);
        if velocities {
            line.push_str(&format!(",{},{},{}", v.x, v.y, v.z));
        }
        text.push_str(&change(i, line));
        text.push('\n');
    }
    text
}

#[test]
fn csv_and_ecsv_are_one_table() {
    let text = csv(true, |_, line| line);
    let by_csv = Ephemeris::parse("folder/bird.csv", &text).unwrap();
    assert_eq!((by_csv.name(), by_csv.rows()), ("bird", 6));
    let names = ["x_km", "y_km", "z_km", "vx_km_s", "vy_km_s", "vz_km_s"];
    let mut ecsv =
        String::from("# %ECSV 1.0\n# ---\n# datatype:\n# - {name: time_utc, datatype: string}\n");
    for (i, name) in names.iter().enumerate() {
        let unit = if i < 3 { "km" } else { "km / s" };
        ecsv.push_str(&format!("# - {{name: {name}, unit: {unit}, datatype: float64}}\n"));
    }
    ecsv.push_str("# delimiter: ','\n# meta: !!omap\n# - {name: bird}\n# - {frame: GCRS}\n");
    ecsv.push_str(&text["# synthetic\n".len()..]);
    assert_eq!(Ephemeris::parse("other.ecsv", &ecsv).unwrap(), by_csv);
    let error = Ephemeris::parse("e.ecsv", &ecsv.replace("GCRS", "ITRF")).unwrap_err();
    assert_eq!(error.to_string(), "e.ecsv: frame: found `ITRF`, expected GCRS, or nothing");
    let error = Ephemeris::parse("e.ecsv", &ecsv.replace("unit: km,", "unit: m,")).unwrap_err();
    assert!(error.to_string().contains("x_km"), "{error}");
    let bad = ecsv.replace("2026-03-14T04:22:30.000Z", "2026-03-14T04:21:30.000Z");
    let error = Ephemeris::parse("e.ecsv", &bad).unwrap_err();
    assert_eq!(
        error.line,
        Some(bad.lines().position(|l| l.starts_with("2026-03-14T04:21:30")).unwrap() as u64 + 2)
    );
    assert_eq!(error.field.as_deref(), Some("time_utc"));
}

#[test]
fn what_a_file_may_not_say() {
    let error = |velocities, change: &dyn Fn(usize, String) -> String| {
        Ephemeris::parse("e.csv", &csv(velocities, change)).unwrap_err().to_string()
    };
    // Rows begin on line 4.
    let on_third = |with: &str| {
        let with = with.to_owned();
        move |i: usize, line: String| if i == 2 { with.clone() } else { line }
    };
    let starts = |text: String, start: &str| assert!(text.starts_with(start), "{text}");
    starts(
        error(false, &on_third("2026-03-14T04:21:30Z,7000,0,0")),
        "e.csv:6: time_utc: found 2026-03-14T04:21:30Z, expected a time after that of the row before",
    );
    starts(
        error(false, &on_third("2026-03-14T04:22:30Z,7000,x,0")),
        "e.csv:6: y_km: found `x`, expected a finite number",
    );
    starts(
        error(false, &on_third("2026-03-14T04:22:30Z,7000,NaN,0")),
        "e.csv:6: y_km: found NaN, expected a finite number",
    );
    starts(
        error(false, &on_third("2026-03-14T04:22:30Z,6300,0,0")),
        "e.csv:6: x_km: found a place 6300.000 km from the Earth's centre, expected a place above the Earth's surface",
    );
    starts(
        error(false, &on_third("2026-03-14T04:22:30Z,7e6,0,0")),
        "e.csv:6: x_km: found a place 7000000.000 km from the Earth's centre, expected at most 5 million km",
    );
    starts(
        error(true, &on_third("2026-03-14T04:22:30Z,7000,0,0,7500,0,0")),
        "e.csv:6: vx_km_s: found 7500 km/s, expected at most 100 km/s",
    );
    starts(
        error(false, &on_third("2026-03-14T04:22:30+01:00,7000,0,0")),
        "e.csv:6: time_utc: found ",
    );
    starts(
        error(false, &on_third("2026-03-14T04:22:30Z,7000,0")),
        "e.csv:6: found 3 fields, expected 4 fields",
    );
    let parse = |text: &str| Ephemeris::parse("e.csv", text).unwrap_err().to_string();
    starts(
        parse("time_utc,x_m,y_km,z_km\n"),
        "e.csv:1: x_m: found an unknown column, expected one of time_utc, x_km",
    );
    starts(parse("time_utc,x_km,y_km\n"), "e.csv:1: z_km: found no such column");
    starts(parse("time_utc,x_km,y_km,z_km,vx_km_s\n"), "e.csv:1: vy_km_s: found no such column");
    starts(parse("time_utc,x_km,y_km,z_km,x_km\n"), "e.csv:1: x_km: found the column twice");
    starts(parse("# nothing\n"), "e.csv: found no line, expected column names");
    starts(
        parse("time_utc,x_km,y_km,z_km\n2026-03-14T04:22:30Z,7000,0,0\n"),
        "e.csv: found 1 rows, expected at least 4 (2 with velocities, 4 without)",
    );
    let mut some = rows(7e6, 0.0, 60.0, 6, true);
    some[3].velocity_m_s = None;
    assert!(matches!(
        Ephemeris::new("s", &some),
        Err(OrbitError::Row { row: 3, quantity: "vx_km_s", .. })
    ));
    assert!(matches!(Ephemeris::new("s", &[]), Err(OrbitError::TooFewRows { rows: 0, .. })));
}

/// A row twice, 1 ns apart in a table of decades: its differences would be 0/0, and the places not numbers.
#[test]
fn rows_that_are_one_row_twice_are_refused() {
    let mut text = "time_utc,x_km,y_km,z_km\n".to_owned();
    for year in 2000..2009 {
        text += &format!("{year}-01-01T00:00:00Z,{year},42000,0\n");
    }
    assert!(Ephemeris::parse("e.csv", &text).is_ok());
    let twice = text.replace(
        "2004-01-01T00:00:00Z,2004,42000,0\n",
        "2004-01-01T00:00:00Z,2004,42000,0\n2004-01-01T00:00:00.000000001Z,2004,42000,0\n",
    );
    let error = Ephemeris::parse("e.csv", &twice).unwrap_err().to_string();
    assert!(error.contains("1 ms or more") && error.contains(":7"), "{error}");
}
