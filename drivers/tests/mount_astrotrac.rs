//! The mount against a second INDI driver, `indi_astrotrac_telescope` (1.9.9 in Debian 12), over a stand-in for the mount itself, live.
//!
//! The stand-in answers the protocol of an AstroTrac 360 (text between `<` and `>` over TCP) as that driver speaks it, and turns its axes as it is told. Where a simulator makes rates up, this driver sends them to motors.
#![allow(clippy::unwrap_used, reason = "helper functions of tests")]

use crate::common::indi::{Server, within};
use std::io::{Read as _, Write as _};
use std::net::{TcpListener, TcpStream};
use std::process::{Command, Stdio};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};
use sunglint_drivers::clock::utc_now;
use sunglint_drivers::device::{Mount as _, MountMotion, MountPlace, MountReading, MountSite};
use sunglint_drivers::indi::{Mount, MountSettings, open_mount};
use sunglint_drivers::transport::tcp::Tcp;

const NAME: &str = "AstroTrac";
/// Stuttgart, as an example.
const SITE: MountSite = MountSite { latitude_deg: 48.78, longitude_deg: 9.18, height_m: 400.0 };
/// Speed of its slews, deg/s.
const SLEW_DEG_S: f64 = 20.0;

/// An axis: encoder, deg, rate, arcsec/s, and where it slews to, deg.
#[derive(Debug, Clone, Copy, Default)]
struct Axis {
    at_deg: f64,
    arcsec_s: f64,
    goal_deg: Option<f64>,
}

/// The mount: both axes, and since when they are as they are.
#[derive(Debug)]
struct Motors {
    axes: [Axis; 2],
    since: Instant,
}

impl Motors {
    fn go_on(&mut self) {
        let now = Instant::now();
        let s = (now - self.since).as_secs_f64();
        self.since = now;
        for axis in &mut self.axes {
            let Some(goal) = axis.goal_deg else {
                axis.at_deg += axis.arcsec_s / 3600.0 * s;
                continue;
            };
            let left = goal - axis.at_deg;
            axis.at_deg += left.clamp(-SLEW_DEG_S * s, SLEW_DEG_S * s);
            if (goal - axis.at_deg).abs() < 1e-9 {
                axis.goal_deg = None;
            }
        }
    }

    /// Answer to what stands between the brackets.
    fn answer(&mut self, command: &str) -> String {
        self.go_on();
        let (number, rest) = command.split_at(1);
        let axis = &mut self.axes[usize::from(number == "2")];
        let value = |from: usize| rest[from..].parse::<f64>().unwrap();
        match rest {
            "zv?" => format!("<{number}zvstand-in>"),
            "p?" => format!("<{number}p{:.6}>", axis.at_deg),
            "v?" => format!("<{number}v{:.6}>", axis.arcsec_s),
            "a?" => format!("<{number}a3600>"),
            "t?" => format!("<{number}t{}#>", u8::from(axis.goal_deg.is_some())),
            "x" => {
                (axis.arcsec_s, axis.goal_deg) = (0.0, None);
                format!("<{number}x#>")
            }
            _ if rest.starts_with("ve") => {
                (axis.arcsec_s, axis.goal_deg) = (value(2), None);
                format!("<{number}ve#>")
            }
            _ if rest.starts_with('p') => {
                axis.goal_deg = Some(value(1));
                format!("<{number}p#>")
            }
            _ if rest.starts_with('y') => {
                axis.at_deg = value(1);
                format!("<{number}y#>")
            }
            _ => format!("<{}#>", &command[..2]),
        }
    }
}

/// Serves the mount; its port.
fn served(motors: &Arc<Mutex<Motors>>) -> u16 {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let (port, motors) = (listener.local_addr().unwrap().port(), motors.clone());
    std::thread::spawn(move || {
        for stream in listener.incoming().map_while(Result::ok) {
            let motors = motors.clone();
            std::thread::spawn(move || talk(stream, &motors));
        }
    });
    port
}

fn talk(mut stream: TcpStream, motors: &Mutex<Motors>) {
    let mut heard = String::new();
    let mut piece = [0; 256];
    while let Ok(count @ 1..) = stream.read(&mut piece) {
        heard.push_str(std::str::from_utf8(&piece[..count]).unwrap());
        while let Some((command, rest)) = heard.split_once('>') {
            let command = command.trim_start().trim_start_matches('<').to_owned();
            heard = rest.to_owned();
            let answer = motors.lock().unwrap().answer(&command);
            if stream.write_all(answer.as_bytes()).is_err() {
                return;
            }
        }
    }
}

/// Sets a property as another client, as soon as it is there.
fn set(server: &Server, property: &str) {
    let deadline = within(120.0);
    loop {
        let mut command = Command::new("indi_setprop");
        command.args(["-p", &server.port.to_string(), &format!("{NAME}.{property}")]);
        if command.stderr(Stdio::null()).status().unwrap().success() {
            return;
        }
        deadline.sleep(Duration::from_millis(200)).unwrap();
    }
}

fn place(reading: &MountReading) -> [f64; 2] {
    match reading.place {
        MountPlace::Equatorial { ra_deg, dec_deg } => [ra_deg, dec_deg],
        MountPlace::Horizontal { .. } => panic!("it is equatorial"),
    }
}

/// Sidereal time at the test's site, deg, to 0.1°: Astronomical Almanac, GMST = 280.4606° + 360.9856473° d from J2000.
fn sidereal_deg() -> f64 {
    let days = utc_now().to_mjd_utc_days() - 51_544.5;
    (280.4606 + 360.985_647_3 * days + SITE.longitude_deg).rem_euclid(360.0)
}

fn turned(deg: f64) -> f64 {
    (deg + 180.0).rem_euclid(360.0) - 180.0
}

fn wait(mount: &mut Mount<Tcp>) -> MountReading {
    loop {
        let reading = mount.reading(&within(30.0)).unwrap();
        if reading.motion != MountMotion::Slewing {
            return reading;
        }
    }
}

/// Goes there twice, as an observer does. The driver aims at where the star will be when a mount of 3°/s has come there (60° in 23 s, 120° in 43 s: up to 0.18°); the stand-in is there in a few seconds, so that only the second, short way ends on the place.
fn go(mount: &mut Mount<Tcp>, ra_deg: f64, dec_deg: f64) -> MountReading {
    let goal = MountPlace::Equatorial { ra_deg, dec_deg };
    for most_off_deg in [0.25, 0.02] {
        mount.begin_goto(goal, &within(30.0)).unwrap();
        let there = wait(mount);
        let [ra, dec] = place(&there);
        assert!(
            turned(ra - ra_deg).abs() < most_off_deg && (dec - dec_deg).abs() < 1e-3,
            "{ra} {dec}, not {ra_deg} {dec_deg}"
        );
    }
    let there = mount.reading(&within(30.0)).unwrap();
    assert_eq!(there.motion, MountMotion::Tracking);
    there
}

/// Truth: what the stand-in's motors are told and where they stand, by its own clock: the rates of hour angle and declination that were asked for, to the six digits of the protocol. An axis of declination that goes up moves the telescope down on one side of the
/// meridian (the driver sends rates to the motors as they are), and on both the declination grows where it is told to grow. A stop stands both motors still; the place that is said then is that of the encoders (declination 90° less the encoder's amount, the hour
/// angle 90° beside the first one).
#[test]
fn a_second_driver_turns_the_motors_as_it_is_told() {
    const TEST: &str = "a_second_driver_turns_the_motors_as_it_is_told";
    sunglint_testkit::live(
        TEST,
        &["indiserver", "indi_setprop", "indi_astrotrac_telescope"],
        || {
            let motors =
                Arc::new(Mutex::new(Motors { axes: [Axis::default(); 2], since: Instant::now() }));
            let port = served(&motors);
            let server = Server::start_of(&["indi_astrotrac_telescope"]);
            drop(server.connect());
            set(&server, &format!("DEVICE_ADDRESS.ADDRESS=127.0.0.1;PORT={port}"));
            set(&server, "CONNECTION.CONNECT=On");
            let settings = MountSettings::default();
            let mut mount = open_mount(server.connect(), NAME, settings, &within(30.0)).unwrap();
            assert!(mount.abilities().continuous_deg_s().is_some(), "{:?}", mount.abilities());
            mount.set_parked(false, &within(30.0)).unwrap();
            mount.set_site(SITE, utc_now(), &within(30.0)).unwrap();
            let now = || {
                let mut motors = motors.lock().unwrap();
                motors.go_on();
                (motors.since, motors.axes)
            };
            let mut sides = Vec::new();
            for (hour_angle_deg, up) in [(30.0, 1.0), (-30.0, -1.0)] {
                let ra_deg = (sidereal_deg() - hour_angle_deg).rem_euclid(360.0);
                sides.push(go(&mut mount, ra_deg, 40.0).pier);
                mount.learn_senses(&|| (), &within(60.0)).unwrap();
                for asked in [[500.0, 100.0], [-300.0, -700.0]] {
                    mount.set_rates(asked.map(|rate| rate / 3600.0), &within(30.0)).unwrap();
                    let (since, before) = now();
                    let first = place(&mount.reading(&within(30.0)).unwrap());
                    std::thread::sleep(Duration::from_secs(1));
                    let last = place(&mount.reading(&within(30.0)).unwrap());
                    let (until, after) = now();
                    let s = (until - since).as_secs_f64();
                    for (axis, asked) in [asked[0], up * asked[1]].into_iter().enumerate() {
                        let rate = (after[axis].at_deg - before[axis].at_deg) * 3600.0 / s;
                        assert!(
                            (rate - asked).abs() < 1e-3,
                            "axis {axis} turned at {rate}″/s, {asked}"
                        );
                    }
                    // The signs are those of the sky: right ascension falls while the hour angle grows.
                    let (ra, dec) = (turned(last[0] - first[0]), last[1] - first[1]);
                    assert!(
                        ra * asked[0] < 0.0 && dec * asked[1] > 0.0,
                        "{asked:?}: {first:?} {last:?}"
                    );
                }
                mount.stop(&within(30.0)).unwrap();
                let (_, stopped) = now();
                assert_eq!(stopped.map(|axis| axis.arcsec_s), [0.0; 2]);
                let [ra, dec] = place(&mount.reading(&within(30.0)).unwrap());
                let [first, second] = stopped.map(|axis| axis.at_deg);
                assert!((dec - (90.0 - second.abs())).abs() < 1e-5, "{dec} {second}");
                let hour_angle = first + 90.0 * up;
                assert!(turned(sidereal_deg() - ra - hour_angle).abs() < 0.1, "{ra} {first}");
            }
            assert!(sides[0].is_some() && sides[1].is_some() && sides[0] != sides[1], "{sides:?}");

            // A slew that is stopped stands where it was.
            let goal = MountPlace::Equatorial { ra_deg: sidereal_deg(), dec_deg: 0.0 };
            mount.begin_goto(goal, &within(30.0)).unwrap();
            mount.stop(&within(30.0)).unwrap();
            let (_, stopped) = now();
            assert!(stopped.iter().all(|axis| axis.goal_deg.is_none() && axis.arcsec_s == 0.0));
            // It parks on its encoders' zero.
            mount.set_parked(true, &within(30.0)).unwrap();
            assert_eq!(wait(&mut mount).motion, MountMotion::Parked);
            assert!(now().1.iter().all(|axis| axis.at_deg.abs() < 1e-6));
        },
    );
}
