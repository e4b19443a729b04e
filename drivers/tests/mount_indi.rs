//! INDI mounts as drivers make them: rates that are refused, sides that are made up, places once a second. The driver is synthetic: it does what the names of its tests say.
#![allow(clippy::unwrap_used, reason = "helper functions of tests")]

use crate::common::indi::within;
use std::io::{Read as _, Write as _};
use std::net::{TcpListener, TcpStream};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};
use sunglint_drivers::clock::utc_now;
use sunglint_drivers::device::{DeviceError, Mount as _, MountAxes, MountClock, MountKnown};
use sunglint_drivers::indi::{Mount, MountSettings, open_mount};
use sunglint_drivers::transport::tcp::Tcp;

/// Slowest rate that EQMOD takes, arcsec/s: 0.05 of that of the stars.
const SLOWEST: f64 = 0.75;
/// Rate at which it changes gear, arcsec/s.
const GEAR: f64 = 1900.0;

/// A driver's makings.
#[derive(Clone, Copy)]
struct Makings {
    /// Time between two reports of its place.
    report: Duration,
    /// Whether the declination runs against its rate.
    turned: bool,
    makes_sides_up: bool,
    /// Sidereal time less the true one of Greenwich, s; it stands still where there is none.
    sidereal_off_s: Option<f64>,
    /// The UTC that it says it was told.
    utc: Option<&'static str>,
}

const PLAIN: Makings = Makings {
    report: Duration::from_millis(50),
    turned: false,
    makes_sides_up: false,
    sidereal_off_s: None,
    utc: None,
};

struct Driver {
    makings: Makings,
    rates: [f64; 2],
    is_on: bool,
    dec_deg: f64,
    since: Instant,
    /// Rates that it was sent, and whether it took them.
    sent: Vec<([f64; 2], bool)>,
}

impl Driver {
    fn go_on(&mut self) {
        let s = self.since.elapsed().as_secs_f64();
        self.since = Instant::now();
        let rate = if self.makings.turned { -self.rates[1] } else { self.rates[1] };
        self.dec_deg += if self.is_on { rate * s / 3600.0 } else { 0.0 };
    }

    fn place(&mut self) -> String {
        self.go_on();
        let body = format!(
            "<oneNumber name=\"RA\">6.0</oneNumber><oneNumber name=\"DEC\">{}</oneNumber>",
            self.dec_deg
        );
        format!(
            "<setNumberVector device=\"T\" name=\"EQUATORIAL_EOD_COORD\" state=\"Ok\">{body}</setNumberVector>"
        )
    }

    /// The definitions; of one name, or of all.
    fn definitions(&mut self, only: Option<&str>) -> String {
        self.go_on();
        let vector = |kind: &str, name: &str, members: &[(&str, String)]| {
            if only.is_some_and(|only| only != name) {
                return String::new();
            }
            let rule = if kind == "Switch" { " rule=\"OneOfMany\"" } else { "" };
            let range = match (kind, name) {
                ("Number", "TELESCOPE_TRACK_RATE") => {
                    " format=\"%g\" min=\"-16384\" max=\"16384\" step=\"0\""
                }
                ("Number", _) => " format=\"%g\" min=\"-360\" max=\"360\" step=\"0\"",
                _ => "",
            };
            let body: String = members
                .iter()
                .map(|(member, value)| {
                    format!("<def{kind} name=\"{member}\" label=\"x\"{range}>{value}</def{kind}>")
                })
                .collect();
            format!(
                "<def{kind}Vector device=\"T\" name=\"{name}\" label=\"x\" group=\"x\" state=\"Ok\" perm=\"rw\"{rule}>{body}</def{kind}Vector>"
            )
        };
        let on = |is_on: bool| if is_on { "On" } else { "Off" }.to_owned();
        let m = self.makings;
        let mut all =
            vector("Switch", "CONNECTION", &[("CONNECT", on(true)), ("DISCONNECT", on(false))]);
        all += &vector("Text", "DRIVER_INFO", &[("DRIVER_INTERFACE", "1".into())]);
        all += &vector("Switch", "TELESCOPE_ABORT_MOTION", &[("ABORT", on(false))]);
        let modes = [("TRACK_SIDEREAL", on(false)), ("TRACK_CUSTOM", on(true))];
        all += &vector("Switch", "TELESCOPE_TRACK_MODE", &modes);
        let states = [("TRACK_ON", on(self.is_on)), ("TRACK_OFF", on(!self.is_on))];
        all += &vector("Switch", "TELESCOPE_TRACK_STATE", &states);
        let rates = [
            ("TRACK_RATE_RA", self.rates[0].to_string()),
            ("TRACK_RATE_DE", self.rates[1].to_string()),
        ];
        all += &vector("Number", "TELESCOPE_TRACK_RATE", &rates);
        let sides = [("PIER_WEST", on(false)), ("PIER_EAST", on(true))];
        all += &vector("Switch", "TELESCOPE_PIER_SIDE", &sides);
        let made = [("SIMULATE_YES", on(m.makes_sides_up)), ("SIMULATE_NO", on(!m.makes_sides_up))];
        all += &vector("Switch", "SIMULATE_PIER_SIDE", &made);
        let hours = m.sidereal_off_s.map_or(3.0, |off_s| {
            let days = utc_now().to_mjd_utc_days() - 51_544.5;
            let deg = 280.4606 + 360.985_647_3 * days + off_s * 15.041 / 3600.0;
            deg.rem_euclid(360.0) / 15.0
        });
        all += &vector("Number", "TIME_LST", &[("LST", hours.to_string())]);
        if let Some(utc) = m.utc {
            all += &vector("Text", "TIME_UTC", &[("UTC", utc.into()), ("OFFSET", "0".into())]);
        }
        let place = [("RA", "6.0".to_owned()), ("DEC", self.dec_deg.to_string())];
        all + &vector("Number", "EQUATORIAL_EOD_COORD", &place)
    }

    /// Takes rates, as EQMOD does: none that are too slow, and no change of gear while an axis turns.
    fn take(&mut self, rates: [f64; 2]) -> String {
        self.go_on();
        let slow = rates.iter().any(|rate| *rate != 0.0 && rate.abs() < SLOWEST);
        let geared = [0, 1].into_iter().any(|i| {
            let (old, new) = (self.rates[i].abs(), rates[i].abs());
            old > 0.0 && new > 0.0 && (old > GEAR) != (new > GEAR)
        });
        let takes = !slow && !geared;
        self.sent.push((rates, takes));
        let (state, said) = match takes {
            true => {
                self.rates = rates;
                ("Ok", "")
            }
            false => ("Alert", "<message device=\"T\" message=\"Speed rate out of limits\"/>"),
        };
        let [ra, de] = self.rates;
        format!(
            "{said}<setNumberVector device=\"T\" name=\"TELESCOPE_TRACK_RATE\" state=\"{state}\"><oneNumber name=\"TRACK_RATE_RA\">{ra}</oneNumber><oneNumber name=\"TRACK_RATE_DE\">{de}</oneNumber></setNumberVector>"
        )
    }

    fn answer(&mut self, element: &str) -> String {
        let after = |key: &str| {
            let from = element.find(key)? + key.len();
            Some(&element[from..from + element[from..].find(['"', '<'])?])
        };
        if element.starts_with("<getProperties") {
            return self.definitions(after(" name=\""));
        }
        match after(" name=\"") {
            Some("TELESCOPE_TRACK_RATE") => {
                let rate =
                    |name: &str| after(&format!("\"{name}\">")).unwrap().trim().parse().unwrap();
                self.take([rate("TRACK_RATE_RA"), rate("TRACK_RATE_DE")])
            }
            Some("TELESCOPE_TRACK_STATE") => {
                self.go_on();
                self.is_on = element.contains("TRACK_ON");
                let (on, off) = if self.is_on { ("On", "Off") } else { ("Off", "On") };
                format!(
                    "<setSwitchVector device=\"T\" name=\"TELESCOPE_TRACK_STATE\" state=\"Ok\"><oneSwitch name=\"TRACK_ON\">{on}</oneSwitch><oneSwitch name=\"TRACK_OFF\">{off}</oneSwitch></setSwitchVector>"
                )
            }
            Some("TELESCOPE_ABORT_MOTION") => {
                self.go_on();
                self.rates = [0.0; 2];
                "<setSwitchVector device=\"T\" name=\"TELESCOPE_ABORT_MOTION\" state=\"Ok\"><oneSwitch name=\"ABORT\">Off</oneSwitch></setSwitchVector>".to_owned()
            }
            _ => String::new(),
        }
    }
}

/// The first whole element of what came, and the rest.
fn element(text: &str) -> Option<(String, String)> {
    let from = text.find('<')?;
    let name: String = text[from + 1..].chars().take_while(|c| c.is_alphanumeric()).collect();
    let head = from + text[from..].find('>')?;
    let end = match text[..head].ends_with('/') {
        true => head + 1,
        false => {
            let close = format!("</{name}>");
            text.find(&close)? + close.len()
        }
    };
    Some((text[from..end].to_owned(), text[end..].to_owned()))
}

fn serve(mut stream: TcpStream, driver: &Mutex<Driver>) {
    let report = driver.lock().unwrap().makings.report;
    stream.set_read_timeout(Some(Duration::from_millis(5))).unwrap();
    let (mut text, mut told) = (String::new(), Instant::now());
    loop {
        let mut buffer = [0; 4096];
        match stream.read(&mut buffer) {
            Ok(0) => return,
            Ok(count) => text.push_str(std::str::from_utf8(&buffer[..count]).unwrap()),
            Err(_) => {}
        }
        let mut said = String::new();
        while let Some((first, rest)) = element(&text) {
            said += &driver.lock().unwrap().answer(&first);
            text = rest;
        }
        if told.elapsed() >= report {
            told = Instant::now();
            said += &driver.lock().unwrap().place();
        }
        if stream.write_all(said.as_bytes()).is_err() {
            return;
        }
    }
}

fn mount(makings: Makings) -> (Mount<Tcp>, Arc<Mutex<Driver>>) {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let port = listener.local_addr().unwrap().port();
    let driver = Driver {
        makings,
        rates: [0.0; 2],
        is_on: false,
        dec_deg: 20.0,
        since: Instant::now(),
        sent: Vec::new(),
    };
    let driver = Arc::new(Mutex::new(driver));
    let served = driver.clone();
    std::thread::spawn(move || {
        let (stream, _) = listener.accept().unwrap();
        serve(stream, &served);
    });
    let line = Tcp::connect(&format!("127.0.0.1:{port}"), &within(10.0)).unwrap();
    (open_mount(line, "T", MountSettings::default(), &within(20.0)).unwrap(), driver)
}

/// Truth: the driver's own: rates below 0.75″/s are refused, and a gear is not changed while an axis turns. By way of zero the fast rate is taken; a slow one is sent as the nearer of none and
/// the slowest that a person knows, and refused where nobody knows it.
#[test]
fn rates_that_are_refused_are_tried_by_way_of_zero() {
    let (mut mount, driver) = mount(PLAIN);
    let beats = std::cell::Cell::new(0);
    mount.learn_senses(&|| beats.set(beats.get() + 1), &within(30.0)).unwrap();
    assert!(beats.get() >= 5, "{}", beats.get());
    let send = |arcsec_s: [f64; 2], mount: &mut Mount<Tcp>| {
        driver.lock().unwrap().sent.clear();
        let told = mount.set_rates(arcsec_s.map(|rate| rate / 3600.0), &within(10.0));
        let sent = driver.lock().unwrap().sent.clone();
        let rounded = |rates: [f64; 2]| rates.map(|rate| (rate * 1e3).round() / 1e3);
        let sent: Vec<_> = sent.into_iter().map(|(rates, takes)| (rounded(rates), takes)).collect();
        (told, sent)
    };
    let (told, sent) = send([700.0, 15.0], &mut mount);
    told.unwrap();
    assert_eq!(sent, [([700.0, 15.0], true)]);
    let (told, sent) = send([3600.0, 15.0], &mut mount);
    told.unwrap();
    let road = [([3600.0, 15.0], false), ([0.0, 15.0], true), ([3600.0, 15.0], true)];
    assert_eq!(sent, road);
    let (told, _) = send([3600.0, 0.5], &mut mount);
    let refused = told.unwrap_err();
    assert!(matches!(refused, DeviceError::Declined { .. }), "{refused}");
    assert!(refused.to_string().contains("out of limits"), "{refused}");
    let known = MountKnown { least_deg_s: Some(0.76 / 3600.0), ..MountKnown::default() };
    mount.know(&known);
    for (asked, taken) in [(0.5, 0.76), (0.2, 0.0), (-0.7, -0.76), (-20.0, -20.0)] {
        let (told, sent) = send([3600.0, asked], &mut mount);
        told.unwrap();
        assert_eq!(sent.last(), Some(&([3600.0, taken], true)), "{asked}");
    }
}

/// Truth: the driver's own rate: its sense is found also where it says its place once a second, at the moment of its report, and where the declination runs against the rate.
#[test]
fn senses_are_found_from_places_once_a_second() {
    for turned in [false, true] {
        let makings = Makings { report: Duration::from_secs(1), turned, ..PLAIN };
        let (mut mount, driver) = mount(makings);
        mount.learn_senses(&|| (), &within(30.0)).unwrap();
        mount.set_rates([0.0, 300.0 / 3600.0], &within(10.0)).unwrap();
        let sent = driver.lock().unwrap().sent.last().copied().unwrap();
        assert!((sent.0[1] - if turned { -300.0 } else { 300.0 }).abs() < 1e-6, "{sent:?}");
    }
}

/// Truth: the rule in words: a side that a driver makes up is none, and about which axes such a mount turns is not known; a real one is that of an equatorial mount.
#[test]
fn sides_that_are_made_up_are_none() {
    for made in [false, true] {
        let (mut mount, _) = mount(Makings { makes_sides_up: made, ..PLAIN });
        let abilities = mount.abilities().clone();
        assert_eq!(abilities.tells_pier_side, !made);
        assert_eq!(abilities.turns_about, (!made).then_some(MountAxes::Equatorial));
        assert_eq!(mount.reading(&within(10.0)).unwrap().pier.is_some(), !made);
    }
}

/// Truth: the driver's own clock, against Greenwich's sidereal time by the Almanac; one that stands still is none, and then what it was told as UTC counts.
#[test]
fn a_mounts_clock_is_read_where_it_runs() {
    let (mut running, _) = mount(Makings { sidereal_off_s: Some(3600.0), ..PLAIN });
    let time = running.time(&within(10.0)).unwrap().unwrap();
    let MountClock::SiderealDeg(said) = time.clock else { panic!("{time:?}") };
    let days = time.utc.to_mjd_utc_days() - 51_544.5;
    let off = (said - 280.4606 - 360.985_647_3 * days + 180.0).rem_euclid(360.0) - 180.0;
    assert!((off - 15.041).abs() < 0.02, "{off}");
    assert_eq!(mount(PLAIN).0.time(&within(10.0)).unwrap(), None);
    let (mut told, _) = mount(Makings { utc: Some("2026-01-02T03:04:05"), ..PLAIN });
    let time = told.time(&within(10.0)).unwrap().unwrap();
    let MountClock::SetTo(utc) = time.clock else { panic!("{time:?}") };
    assert_eq!(sunglint_formats::time::format_utc(utc, 0), "2026-01-02T03:04:05Z");
}
