//! Alpaca devices against `alpaca-simulators` 1.3.2 (PyPI), live over HTTP.
#![allow(clippy::unwrap_used, reason = "helper functions of tests")]

use crate::common::alpaca::{Simulators, connect, place, within};
use std::time::Duration;
use sunglint_drivers::alpaca::{
    Camera, Focuser, Mount, MountSettings, Rotator, SessionSettings, Wheel,
};
use sunglint_drivers::catalogue::alpaca_listed;
use sunglint_drivers::clock::utc_now;
use sunglint_drivers::device::{
    Camera as _, Device as _, DeviceError, FilterWheel as _, Focuser as _, Mount as _, MountAxes,
    MountMotion, MountPlace, MountReading, MountSite, PierSide, RotationStage as _, Window,
};
use sunglint_drivers::transport::tcp::Tcp;

const SITE: MountSite = MountSite { latitude_deg: 48.78, longitude_deg: 9.18, height_m: 400.0 };

fn both(reading: &MountReading) -> [f64; 2] {
    match reading.place {
        MountPlace::Equatorial { ra_deg, dec_deg } => [ra_deg, dec_deg],
        MountPlace::Horizontal { .. } => panic!("it is equatorial"),
    }
}

fn wait(mount: &mut Mount<Tcp>) -> MountReading {
    for _ in 0..400 {
        let reading = mount.reading(&within(5.0)).unwrap();
        if reading.motion != MountMotion::Slewing {
            return reading;
        }
        std::thread::sleep(Duration::from_millis(50));
    }
    panic!("it slews for ever")
}

/// How fast it moves, deg/s of hour angle and declination: by what it says over two seconds.
fn measured(mount: &mut Mount<Tcp>) -> [f64; 2] {
    let a = mount.reading(&within(5.0)).unwrap();
    std::thread::sleep(Duration::from_secs(2));
    let b = mount.reading(&within(5.0)).unwrap();
    let seconds = (b.utc - a.utc).to_seconds();
    let ([ra, dec], [ra2, dec2]) = (both(&a), both(&b));
    let turned = (ra2 - ra + 180.0).rem_euclid(360.0) - 180.0;
    [15.041 / 3600.0 - turned / seconds, (dec2 - dec) / seconds]
}

/// Truth: what was asked for, against what the simulator says of its place: 0.02° for a slew, 3 % and 10″/s for rates (its clock advances in steps of 0.1 s).
/// The simulator's right ascension grows with a positive rate of its axis; the driver's hour angle grows where it is told to.
#[test]
fn a_visit_slews_syncs_follows_rates_stops_and_parks() {
    let Some(server) = Simulators::start("a_visit_slews_syncs_follows_rates_stops_and_parks", 300)
    else {
        return;
    };
    let settings = MountSettings::default();
    let mut mount =
        Mount::open(connect(server.port), &place(server.port), settings, &within(20.0)).unwrap();
    let who = mount.identity(&within(5.0)).unwrap();
    assert_eq!(who.vendor, "ASCOM Alpaca");
    let abilities = mount.abilities().clone();
    assert_eq!(abilities.axes, MountAxes::Equatorial);
    assert_eq!(abilities.continuous_deg_s(), Some([10.0, 10.0].into()));
    assert!(abilities.parks && abilities.syncs && !abilities.tells_pier_side);
    assert!(!abilities.may_turn_over());
    // It starts parked, and refuses to go.
    assert_eq!(mount.reading(&within(5.0)).unwrap().motion, MountMotion::Parked);
    let goal = MountPlace::Equatorial { ra_deg: 120.0, dec_deg: 30.0 };
    let refused = mount.begin_goto(goal, &within(5.0)).unwrap_err().to_string();
    assert!(refused.contains("parked"), "{refused}");
    mount.set_parked(false, &within(5.0)).unwrap();
    mount.set_site(SITE, utc_now(), &within(5.0)).unwrap();
    assert_eq!(mount.site(&within(5.0)).unwrap(), Some(SITE));
    mount.begin_goto(goal, &within(5.0)).unwrap();
    let there = wait(&mut mount);
    let [ra, dec] = both(&there);
    assert!((ra - 120.0).abs() < 0.02 && (dec - 30.0).abs() < 0.02, "{ra} {dec}");
    assert_eq!(there.motion, MountMotion::Tracking);
    mount.sync(MountPlace::Equatorial { ra_deg: 120.1, dec_deg: 30.05 }, &within(5.0)).unwrap();
    let [ra, dec] = both(&mount.reading(&within(5.0)).unwrap());
    assert!((ra - 120.1).abs() < 0.01 && (dec - 30.05).abs() < 0.01, "{ra} {dec}");
    // No rates before the senses are known.
    let early = mount.set_rates([0.1, 0.1], &within(5.0)).unwrap_err();
    assert!(matches!(early, DeviceError::NotReady { .. }), "{early}");
    mount.learn_senses(&|| (), &within(20.0)).unwrap();
    for asked in [[0.5, 0.2], [-0.3, -0.7], [0.0, 0.0]] {
        mount.set_rates(asked, &within(5.0)).unwrap();
        let got = measured(&mut mount);
        for (asked, got) in asked.iter().zip(got) {
            assert!((asked - got).abs() < 0.03 * asked.abs() + 0.003, "{asked} {got}");
        }
    }
    let fast = mount.set_rates([11.0, 0.0], &within(5.0)).unwrap_err();
    assert!(matches!(fast, DeviceError::OutOfRange { .. }), "{fast}");
    // Its AbortSlew does not stop the axes: both are told one by one.
    mount.set_rates([0.5, 0.5], &within(5.0)).unwrap();
    mount.stop(&within(5.0)).unwrap();
    let [first, second] = measured(&mut mount);
    assert!(first.abs() < 1e-3 && second.abs() < 1e-3, "{first} {second}");
    assert_eq!(mount.reading(&within(5.0)).unwrap().motion, MountMotion::Still);
    mount.set_parked(true, &within(5.0)).unwrap();
    assert_eq!(wait(&mut mount).motion, MountMotion::Parked);
    // Stopped while parked: nothing to do, no error.
    mount.stop(&within(5.0)).unwrap();
    // A device that is not there.
    let mut other = place(server.port);
    other.number = 7;
    let missing = Mount::open(connect(server.port), &other, settings, &within(5.0)).unwrap_err();
    assert!(missing.to_string().contains("telescope 7"), "{missing}");
}

/// Truth: the rule in words, and sides that another client tells the simulator: no side is the last side; on the other one only rates of zero are taken, until the senses are learnt there.
#[test]
fn senses_hold_on_one_side_of_the_pier() {
    let test = "senses_hold_on_one_side_of_the_pier";
    let Some(server) = Simulators::aligned(test, 300, &["2"]) else { return };
    let hang = |side: i32| {
        use std::io::{Read as _, Write as _};
        let form = format!("SideOfPier={side}&ClientID=1&ClientTransactionID=1");
        let mut line = std::net::TcpStream::connect(("127.0.0.1", server.port)).unwrap();
        write!(
            line,
            "PUT /api/v1/telescope/0/sideofpier HTTP/1.1\r\nHost: x\r\nConnection: close\r\nContent-Type: application/x-www-form-urlencoded\r\nContent-Length: {}\r\n\r\n{form}",
            form.len()
        )
        .unwrap();
        let mut answer = String::new();
        line.read_to_string(&mut answer).unwrap();
        assert!(answer.starts_with("HTTP/1.1 200"), "{answer}");
    };
    hang(0);
    let settings = MountSettings::default();
    let mut mount =
        Mount::open(connect(server.port), &place(server.port), settings, &within(20.0)).unwrap();
    let abilities = mount.abilities();
    assert!(abilities.tells_pier_side && abilities.may_turn_over() && abilities.tells_tracking);
    mount.set_parked(false, &within(5.0)).unwrap();
    mount.set_rates([0.0; 2], &within(5.0)).unwrap();
    mount.learn_senses(&|| (), &within(20.0)).unwrap();
    mount.set_rates([0.1, 0.0], &within(5.0)).unwrap();
    hang(-1);
    assert_eq!(mount.reading(&within(5.0)).unwrap().pier, Some(PierSide::East));
    mount.set_rates([0.1, 0.0], &within(5.0)).unwrap();
    hang(1);
    assert_eq!(mount.reading(&within(5.0)).unwrap().pier, Some(PierSide::West));
    let other = mount.set_rates([0.1, 0.0], &within(5.0)).unwrap_err();
    assert!(matches!(other, DeviceError::NotReady { .. }), "{other}");
    mount.set_rates([0.0; 2], &within(5.0)).unwrap();
    mount.learn_senses(&|| (), &within(20.0)).unwrap();
    mount.set_rates([0.1, 0.0], &within(5.0)).unwrap();
    mount.stop(&within(5.0)).unwrap();
}

/// Truth: the server's own pixels: the first five of row 0 count up from 1000, so that columns are columns; sizes, slots, angles and positions as they were asked for.
/// Idle connections are closed after a second here: the next request makes a new one.
#[test]
fn camera_wheel_rotator_and_focuser_do_what_they_are_told() {
    let test = "camera_wheel_rotator_and_focuser_do_what_they_are_told";
    let Some(server) = Simulators::start(test, 1) else { return };
    let (line, at) = (|| connect(server.port), place(server.port));
    let settings = SessionSettings::default();
    let mut camera = Camera::open(line(), &at, settings, &within(20.0)).unwrap();
    assert_eq!(camera.sensor_px(), [1024, 1024]);
    let window = Window { origin_px: [0, 0], size_px: [300, 200], binning: [1, 1] };
    assert_eq!(camera.set_window(window, &within(10.0)).unwrap(), window);
    let asked = utc_now();
    let frame = camera.expose(0.2, &within(30.0)).unwrap();
    assert_eq!(frame.pixels.dim(), (200, 300));
    let first: Vec<u16> = (0..5).map(|column| frame.pixels[(0, column)]).collect();
    assert_eq!(first, [1000, 1001, 1002, 1003, 1004]);
    assert!((frame.start - asked).to_seconds().abs() < 2.0 && frame.exposure_s == 0.2);
    assert_eq!(frame.header.text("HOSTDATE").map(|text| text.len() > 18), Some(true));
    let wide = Window { size_px: [2000, 10], ..window };
    assert!(matches!(camera.set_window(wide, &within(5.0)), Err(DeviceError::OutOfRange { .. })));
    let short = camera.expose(30.0, &within(0.5)).unwrap_err();
    assert!(matches!(short, DeviceError::TooSlow { .. }), "{short}");

    let mut wheel = Wheel::open(line(), &at, settings, &within(20.0)).unwrap();
    assert_eq!(wheel.names(), ["Red", "Green", "Blue", "Clear", "Luminance"]);
    assert_eq!(wheel.select(4, &within(20.0)).unwrap(), 4);
    assert_eq!(wheel.slot(&within(5.0)).unwrap(), 4);
    assert!(wheel.select(6, &within(5.0)).is_err());

    let mut rotator = Rotator::open(line(), &at, settings, &within(20.0)).unwrap();
    let turned = rotator.move_to(33.5, &within(60.0)).unwrap();
    assert!((turned - 33.5).abs() < 0.1, "{turned}");

    let mut focuser = Focuser::open(line(), &at, settings, &within(20.0)).unwrap();
    assert_eq!(focuser.range(), [0, 100_000]);
    assert_eq!(focuser.move_to(12_345, &within(20.0)).unwrap(), 12_345);
    assert_eq!(focuser.temperature_c(&within(5.0)).unwrap(), Some(20.0));
    std::thread::sleep(Duration::from_millis(1800));
    assert_eq!(focuser.move_to(10_000, &within(20.0)).unwrap(), 10_000);
    assert!(matches!(
        *focuser.move_to(-1, &within(5.0)).unwrap_err().error,
        DeviceError::OutOfRange { .. }
    ));
    // It has no list of its devices: each kind is asked for.
    let listed = alpaca_listed(&at.server, &within(10.0)).unwrap();
    let addresses: Vec<String> = listed.into_iter().flat_map(|one| one.addresses).collect();
    for driver in ["telescope", "camera", "wheel", "rotator", "focuser"] {
        let address = format!("alpaca-{driver}:{}/0", at.server);
        assert!(addresses.contains(&address), "{addresses:?}");
    }
}

/// Truth: a server that is killed; the calls end within their own time limit, and the stop says that it failed.
#[test]
fn a_lost_server_is_told() {
    let Some(mut server) = Simulators::start("a_lost_server_is_told", 300) else { return };
    let settings = MountSettings::default();
    let mut mount =
        Mount::open(connect(server.port), &place(server.port), settings, &within(20.0)).unwrap();
    mount.reading(&within(5.0)).unwrap();
    server.kill();
    let lost = mount.reading(&within(5.0)).unwrap_err();
    assert!(matches!(lost, DeviceError::Transport { .. }), "{lost}");
    assert!(mount.stop(&within(1.0)).is_err());
}
