//! A mount of a few rates behind an Alpaca server: the tracker, the driver and HTTP together, in real time.
#![allow(clippy::unwrap_used, reason = "helper functions of tests")]

#[path = "../../drivers/tests/common/alpaca.rs"]
mod alpaca;

use alpaca::{Scripted, connect, error, place, value, within};
use hifitime::{Epoch, Unit};
use std::ops::ControlFlow;
use std::sync::{Arc, Mutex};
use std::time::Instant;
use sunglint_drivers::alpaca::{Mount, MountSettings};
use sunglint_drivers::clock::{Cancel, DeviceClock, utc_now};
use sunglint_drivers::device::{Mount as _, MountAxes, MountRates};
use sunglint_ephemeris::geometry::Geometry;
use sunglint_ephemeris::orbit::{Orbit, TleOrbit, tle};
use sunglint_observatory::telescope::{
    Guard, SunCone, TargetPath, TrackError, TrackOptions, TrackState, Tracker,
};
use sunglint_radiometry::sky::{EarthOrientation, Geodetic, Observer, Site};

/// Steps of its rates, deg/s, and how many there are.
const STEPS: (f64, u32) = (0.05, 60);

/// A telescope of azimuth and altitude that turns as it is told, at once.
struct Turns {
    rates: [f64; 2],
    angle: [f64; 2],
    since: Instant,
}

impl Turns {
    fn now(&mut self) -> [f64; 2] {
        let s = self.since.elapsed().as_secs_f64();
        self.since = Instant::now();
        for (angle, rate) in self.angle.iter_mut().zip(self.rates) {
            *angle += rate * s;
        }
        self.angle
    }
}

/// A server of such a telescope with these rates, in the standard's words; a rate that is not on its list is refused.
fn served(turns: &Arc<Mutex<Turns>>, steps: Vec<f64>) -> Scripted {
    let of = turns.clone();
    let list: Vec<String> =
        steps.iter().map(|rate| format!(r#"{{"Minimum":{rate},"Maximum":{rate}}}"#)).collect();
    let list = format!("[{}]", list.join(","));
    Scripted::start(Arc::new(move |request, form, stream| {
        let mut turns = of.lock().unwrap();
        let [azimuth, altitude] = turns.now();
        let number = |key: &str| -> f64 {
            let found = form.split('&').find_map(|part| part.strip_prefix(key));
            found.unwrap().parse().unwrap()
        };
        match request {
            "GET telescope/0/alignmentmode" => value(stream, "0"),
            "GET telescope/0/azimuth" => value(stream, &azimuth.rem_euclid(360.0).to_string()),
            "GET telescope/0/altitude" => value(stream, &altitude.to_string()),
            "GET telescope/0/slewing" => {
                value(stream, if turns.rates == [0.0; 2] { "false" } else { "true" })
            }
            "GET telescope/0/tracking" | "GET telescope/0/atpark" => value(stream, "false"),
            "GET telescope/0/axisrates" => value(stream, &list),
            "PUT telescope/0/slewtoaltazasync" => {
                turns.angle = [number("Azimuth="), number("Altitude=")];
                value(stream, "null")
            }
            "PUT telescope/0/moveaxis" => {
                let rate = number("Rate=");
                if rate != 0.0 && steps.iter().all(|step| (step - rate.abs()).abs() > 1e-9) {
                    return error(stream, 0x401, "no such rate");
                }
                turns.rates[number("Axis=") as usize] = rate;
                value(stream, "null")
            }
            get if get.starts_with("GET telescope/0/can") || get.ends_with("/connected") => {
                value(stream, "true")
            }
            put if put.starts_with("PUT ") => value(stream, "null"),
            _ => error(stream, 0x400, "not implemented"),
        }
    }))
}

fn site() -> Site {
    Site::new(Geodetic { latitude_deg: 48.78, longitude_deg: 9.18, height_m: 400.0 }).unwrap()
}

fn with_sum(line: &str) -> String {
    let of = |b: u8| if b == b'-' { 1 } else { u32::from(b.wrapping_sub(b'0')) };
    let sum: u32 = line.bytes().filter(|b| b.is_ascii_digit() || *b == b'-').map(of).sum();
    format!("{line}{}", sum % 10)
}

fn place_of(orbit: &Orbit, at: Epoch) -> [f64; 2] {
    let observer = Observer::at(at, &site(), EarthOrientation::embedded()).unwrap();
    let at = Geometry::at(orbit, &observer).unwrap().horizontal;
    [at.azimuth_deg(), at.altitude_deg()]
}

/// A synthetic orbit, 900 km high, whose satellite is up at a time and half a minute later, between 30° and 65°.
fn orbit_of(now: Epoch) -> Orbit {
    let (year, day) = (now.year() % 100, now.day_of_year());
    let mut found = None;
    for i in 0..4000_u32 {
        let one = with_sum(&format!(
            "1 99999U 26001A   {year:02}{day:012.8}  .00000000  00000-0  00000-0 0  999"
        ));
        let (node, anomaly) = (f64::from(i % 63) * 5.7, f64::from(i / 63) * 5.7);
        let two = with_sum(&format!(
            "2 99999  60.0000 {node:8.4} 0001000   0.0000 {anomaly:8.4} 13.98000000    1"
        ));
        let set = tle::parse("synthetic", &format!("{one}\n{two}\n")).unwrap().remove(0);
        let orbit = Orbit::from(TleOrbit::new(set).unwrap());
        let [now, later] = [0.0, 40.0].map(|s| place_of(&orbit, now + s * Unit::Second));
        let up = |place: [f64; 2]| (30.0..65.0).contains(&place[1]);
        // Not over north, where azimuth begins anew.
        let away = (90.0..270.0).contains(&now[0]) && (90.0..270.0).contains(&later[0]);
        if up(now) && up(later) && away {
            found = Some(orbit);
            break;
        }
    }
    found.expect("a satellite is up")
}

fn distance_arcsec(a: [f64; 2], b: [f64; 2]) -> f64 {
    let first = (a[0] - b[0] + 540.0).rem_euclid(360.0) - 180.0;
    3600.0 * (first * b[1].to_radians().cos()).hypot(a[1] - b[1])
}

/// Truth: the stand-in's own angles at the moment at which they are taken, and where SGP4 has the satellite then; the server refuses every rate that is not on its list. Arithmetic: between rates 0.05 °/s apart, switched each
/// 0.1 s, a mount stays within 9″ on each axis. Tolerance: 60″, for a clock that is read 10 ms late on a busy machine is 10″ at 0.3 °/s; the nearest rate alone would be off by up to 900″ after 10 s.
#[test]
fn an_alpaca_mount_of_a_few_rates_is_followed_with() {
    let steps: Vec<f64> = (1..=STEPS.1).map(|i| f64::from(i) * STEPS.0).collect();
    let turns = Arc::new(Mutex::new(Turns {
        rates: [0.0; 2],
        angle: [180.0, 45.0],
        since: Instant::now(),
    }));
    let server = served(&turns, steps.clone());
    let mut mount = Mount::open(
        connect(server.port),
        &place(server.port),
        MountSettings::default(),
        &within(20.0),
    )
    .unwrap();
    let MountRates::Discrete { deg_s } = &mount.abilities().rates else {
        panic!("{:?}", mount.abilities().rates)
    };
    // Numbers of JSON may be off by their last bit.
    assert!(deg_s.len() == steps.len());
    assert!(deg_s.iter().zip(&steps).all(|(a, b)| (a - b).abs() < 1e-12), "{deg_s:?}");
    let from = utc_now() + 6.0 * Unit::Second;
    let orbit = orbit_of(from);
    let earth = EarthOrientation::embedded();
    let path = TargetPath::new(&orbit, &site(), earth, (from, 13.0), MountAxes::Horizontal, false);
    let path = path.unwrap();
    let cone = SunCone::default().with_limit_deg(0.0).with_pointing_deg(0.0);
    let guard = Guard::new(&site(), MountAxes::Horizontal, false, cone);
    let mut options = TrackOptions::default();
    options.latency_s = 0.01;
    options.lead_s = 2.0;
    let clock = DeviceClock::live();
    let mut tracker = Tracker::new(&path, &guard, &mut mount, None, clock, options);
    let mut seen = Vec::new();
    let summary = tracker
        .run(&Cancel::new(), &mut |step| {
            if step.state == TrackState::Predicted && step.time_s > 3.0 {
                let mut turns = turns.lock().unwrap();
                let (before, angle, after) = (utc_now(), turns.now(), utc_now());
                seen.push((before + 0.5 * (after - before), angle));
            }
            ControlFlow::Continue(())
        })
        .unwrap();
    drop(tracker);
    let off: Vec<f64> =
        seen.iter().map(|(at, angle)| distance_arcsec(*angle, place_of(&orbit, *at))).collect();
    let rms = (off.iter().map(|off| off * off).sum::<f64>() / off.len() as f64).sqrt();
    println!("{} commands, {} places, rms {rms:.1}″", summary.steps, off.len());
    assert!(off.len() > 25, "{}", off.len());
    assert!(rms < 60.0, "{rms}");
    // It was stopped in the end, and another rate than those of the list never asked for.
    assert_eq!(turns.lock().unwrap().rates, [0.0; 2]);
    let mut rates: Vec<String> = server
        .requests()
        .iter()
        .filter(|request| request.contains("moveaxis"))
        .filter_map(|request| request.split('&').find_map(|part| part.strip_prefix("Rate=")))
        .map(str::to_owned)
        .collect();
    rates.sort();
    rates.dedup();
    assert!(rates.len() > 3, "{rates:?}");
}

/// Truth: in words: a mount that takes no rates follows nothing, and that is said before it moves.
#[test]
fn a_mount_without_rates_is_refused_before_it_moves() {
    let turns = Arc::new(Mutex::new(Turns {
        rates: [0.0; 2],
        angle: [180.0, 45.0],
        since: Instant::now(),
    }));
    let server = served(&turns, Vec::new());
    let mut mount = Mount::open(
        connect(server.port),
        &place(server.port),
        MountSettings::default(),
        &within(20.0),
    )
    .unwrap();
    let from = utc_now() + 5.0 * Unit::Second;
    let earth = EarthOrientation::embedded();
    let orbit = orbit_of(from);
    let path = TargetPath::new(&orbit, &site(), earth, (from, 25.0), MountAxes::Horizontal, false);
    let path = path.unwrap();
    let cone = SunCone::default().with_limit_deg(0.0).with_pointing_deg(0.0);
    let guard = Guard::new(&site(), MountAxes::Horizontal, false, cone);
    let (clock, options) = (DeviceClock::live(), TrackOptions::default());
    let mut tracker = Tracker::new(&path, &guard, &mut mount, None, clock, options);
    let ended = tracker.run(&Cancel::new(), &mut |_| ControlFlow::Continue(()));
    assert!(matches!(ended, Err(TrackError::NoRates)), "{ended:?}");
    let moved = server.requests().into_iter().find(|request| request.contains("slewto"));
    assert_eq!(moved, None);
}
