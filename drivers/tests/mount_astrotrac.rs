//! The mount against a second INDI driver, `indi_astrotrac_telescope` (1.9.9 in Debian 12), over a stand-in for the mount itself, live.
//!
//! The stand-in answers the protocol of an AstroTrac 360 (text between `<` and `>` over TCP) as that driver speaks it, and turns its axes as it is told. Where a simulator makes rates up, this driver sends them to motors.
#![allow(clippy::unwrap_used, reason = "helper functions of tests")]

use crate::common::indi::{Server, live, within};
use std::io::{Read as _, Write as _};
use std::net::{TcpListener, TcpStream};
use std::process::{Command, Stdio};
use std::sync::{Arc, Mutex};
use std::time::Instant;
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
        let s = self.since.elapsed().as_secs_f64();
        self.since = Instant::now();
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
    let deadline = within(30.0);
    loop {
        let mut command = Command::new("indi_setprop");
        command.args(["-p", &server.port.to_string(), &format!("{NAME}.{property}")]);
        if command.stderr(Stdio::null()).status().unwrap().success() {
            return;
        }
        deadline.sleep(std::time::Duration::from_millis(200)).unwrap();
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

fn wait(mount: &mut Mount<Tcp>) -> MountReading {
    for _ in 0..600 {
        let reading = mount.reading(&within(5.0)).unwrap();
        if reading.motion != MountMotion::Slewing {
            return reading;
        }
    }
    panic!("it slews for ever")
}

/// Truth: what the motors of the stand-in are told, and by how much they turn in two seconds: rates of hour angle and declination as they were asked for, 2 % and 2″/s for clocks and a busy machine; on both sides of the meridian
/// the declination grows where it is told to grow. A stop stands both motors still.
#[test]
fn a_second_driver_turns_the_motors_as_it_is_told() {
    const TEST: &str = "a_second_driver_turns_the_motors_as_it_is_told";
    live(TEST, || {
        let motors =
            Arc::new(Mutex::new(Motors { axes: [Axis::default(); 2], since: Instant::now() }));
        let port = served(&motors);
        let server = Server::start_of(&["indi_astrotrac_telescope"]);
        drop(server.connect());
        set(&server, &format!("DEVICE_ADDRESS.ADDRESS=127.0.0.1;PORT={port}"));
        set(&server, "CONNECTION.CONNECT=On");
        let settings = MountSettings::default();
        let mut mount = open_mount(server.connect(), NAME, settings, &within(20.0)).unwrap();
        assert!(mount.abilities().continuous_deg_s().is_some(), "{:?}", mount.abilities());
        mount.set_parked(false, &within(5.0)).unwrap();
        mount.set_site(SITE, utc_now(), &within(5.0)).unwrap();
        for hour_angle_deg in [30.0, -30.0] {
            let ra_deg = (sidereal_deg() - hour_angle_deg).rem_euclid(360.0);
            let goal = MountPlace::Equatorial { ra_deg, dec_deg: 40.0 };
            mount.begin_goto(goal, &within(5.0)).unwrap();
            let there = wait(&mut mount);
            let [ra, dec] = place(&there);
            let off = (ra - ra_deg + 180.0).rem_euclid(360.0) - 180.0;
            assert!(off.abs() < 0.15 && (dec - 40.0).abs() < 0.05, "{ra} {dec}, not {ra_deg} 40");
            mount.learn_senses(&|| (), &within(30.0)).unwrap();
            for asked in [[500.0, 100.0], [-300.0, -700.0]] {
                mount.set_rates(asked.map(|rate| rate / 3600.0), &within(5.0)).unwrap();
                std::thread::sleep(std::time::Duration::from_millis(500));
                let now = || {
                    let mut motors = motors.lock().unwrap();
                    motors.go_on();
                    (motors.since, motors.axes.map(|axis| axis.at_deg))
                };
                let (since, before) = now();
                let first = place(&mount.reading(&within(5.0)).unwrap());
                std::thread::sleep(std::time::Duration::from_secs(2));
                let (until, after) = now();
                let last = place(&mount.reading(&within(5.0)).unwrap());
                let s = (until - since).as_secs_f64();
                for axis in 0..2 {
                    let turned = (after[axis] - before[axis]) * 3600.0 / s;
                    assert!(
                        (turned.abs() - asked[axis].abs()).abs() < 0.02 * asked[axis].abs() + 2.0,
                        "{hour_angle_deg}: axis {axis} turned at {turned}″/s, asked {asked:?}"
                    );
                }
                // The signs are those of the sky: right ascension falls while the hour angle grows.
                let ra = (last[0] - first[0] + 180.0).rem_euclid(360.0) - 180.0;
                assert!(ra * asked[0] < 0.0, "{hour_angle_deg} {asked:?}: {first:?} {last:?}");
                let dec = last[1] - first[1];
                assert!(dec * asked[1] > 0.0, "{hour_angle_deg} {asked:?}: {first:?} {last:?}");
            }
            mount.stop(&within(5.0)).unwrap();
            std::thread::sleep(std::time::Duration::from_millis(500));
            let rates = motors.lock().unwrap().axes.map(|axis| axis.arcsec_s);
            assert_eq!(rates, [0.0; 2]);
        }
    });
}
