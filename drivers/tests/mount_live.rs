//! The mount against `indi_simulator_telescope` (1.9.9 in Debian 12), live.
#![allow(clippy::unwrap_used, reason = "helper functions of tests")]

use crate::common::indi::{Server, live, within};
use std::time::Duration;
use sunglint_drivers::clock::utc_now;
use sunglint_drivers::device::{
    Device as _, DeviceError, Mount as _, MountAxes, MountMotion, MountPlace, MountReading,
    MountSite, PierSide,
};
use sunglint_drivers::indi::{Mount, MountSettings, open_mount};
use sunglint_drivers::transport::tcp::Tcp;

const TELESCOPE: &str = "Telescope Simulator";
/// Stuttgart, as an example.
const SITE: MountSite = MountSite { latitude_deg: 48.78, longitude_deg: 9.18, height_m: 400.0 };

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

/// Goes to an hour angle and declination.
fn go(mount: &mut Mount<Tcp>, hour_angle_deg: f64, dec_deg: f64) -> MountReading {
    let ra_deg = (sidereal_deg() - hour_angle_deg).rem_euclid(360.0);
    mount.begin_goto(MountPlace::Equatorial { ra_deg, dec_deg }, &within(5.0)).unwrap();
    let there = wait(mount);
    let [ra, dec] = place(&there);
    // The simulator goes to the hour angle that the place had when it began: 15″ for each second of the way.
    let off = (ra - ra_deg + 180.0).rem_euclid(360.0) - 180.0;
    assert!(off.abs() < 0.15 && (dec - dec_deg).abs() < 0.01, "{ra} {dec}, not {ra_deg} {dec_deg}");
    there
}

/// How fast it moves, arcsec/s of hour angle and declination: a line through what it says in 1.5 s.
fn measured(mount: &mut Mount<Tcp>) -> [f64; 2] {
    mount.reading(&within(5.0)).unwrap();
    let readings: Vec<_> = (0..30).map(|_| mount.reading(&within(5.0)).unwrap()).collect();
    let zero = readings[0].utc;
    let t: Vec<f64> = readings.iter().map(|r| (r.utc - zero).to_seconds()).collect();
    let mean = |x: &[f64]| x.iter().sum::<f64>() / x.len() as f64;
    let slope = |y: Vec<f64>| {
        let (mt, my) = (mean(&t), mean(&y));
        let top: f64 = t.iter().zip(&y).map(|(t, y)| (t - mt) * (y - my)).sum();
        top / t.iter().map(|t| (t - mt).powi(2)).sum::<f64>()
    };
    let first = place(&readings[0]);
    let ra = slope(
        readings
            .iter()
            .map(|r| ((place(r)[0] - first[0] + 180.0).rem_euclid(360.0) - 180.0) * 3600.0)
            .collect(),
    );
    // Sidereal time runs by 15.041″ a second.
    [15.041 - ra, slope(readings.iter().map(|r| (place(r)[1] - first[1]) * 3600.0).collect())]
}

/// Truth: the rates that were asked for, against what the simulator says of its place; 1 % for its clock and ours. On both sides of the pier the
/// declination grows where it is told to grow, though the simulator's own rate turns round with the pier.
#[test]
fn a_mount_goes_turns_stops_and_parks() {
    live("a_mount_goes_turns_stops_and_parks", || {
        let server = Server::start(&["telescope"]);
        let mut mount =
            open_mount(server.connect(), TELESCOPE, MountSettings::default(), &within(20.0))
                .unwrap();
        assert_eq!(mount.identity(&within(1.0)).unwrap().model, "Telescope Simulator");
        let abilities = mount.abilities().clone();
        assert_eq!(abilities.axes, MountAxes::Equatorial);
        let most = abilities.continuous_deg_s().unwrap();
        assert!((4.5..4.6).contains(&most[0]), "{most:?}");
        mount.set_parked(false, &within(5.0)).unwrap();
        mount.set_site(SITE, utc_now(), &within(5.0)).unwrap();
        let site = mount.site(&within(5.0)).unwrap().unwrap();
        assert!(
            (site.longitude_deg - 9.18).abs() < 1e-3 && (site.latitude_deg - 48.78).abs() < 1e-3
        );
        // No rates before the sense is known.
        let early = mount.set_rates([0.1, 0.1], &within(5.0)).unwrap_err();
        assert!(matches!(early, DeviceError::NotReady { .. }), "{early}");

        for (hour_angle_deg, side) in [(30.0, PierSide::East), (-30.0, PierSide::West)] {
            let there = go(&mut mount, hour_angle_deg, 40.0);
            assert_eq!(there.pier, Some(side));
            assert_eq!(there.motion, MountMotion::Tracking);
            // On the other side only rates of zero are taken before the senses are learnt again.
            let other = mount.set_rates([0.1, 0.1], &within(5.0)).unwrap_err();
            assert!(matches!(other, DeviceError::NotReady { .. }), "{other}");
            mount.set_rates([0.0; 2], &within(5.0)).unwrap();
            mount.learn_senses(&|| (), &within(20.0)).unwrap();
            for asked in [[500.0, 100.0], [-300.0, -700.0], [0.0, 0.0]] {
                mount.set_rates(asked.map(|rate| rate / 3600.0), &within(5.0)).unwrap();
                let got = measured(&mut mount);
                for (asked, got) in asked.iter().zip(got) {
                    assert!(
                        (asked - got).abs() < 0.01 * asked.abs() + 1.0,
                        "{side:?} {asked} {got}"
                    );
                }
            }
        }
        // A rate that it does not take is refused before it is sent: the old one would go on.
        let fast = mount.set_rates([5.0, 0.0], &within(5.0)).unwrap_err();
        assert!(matches!(fast, DeviceError::OutOfRange { .. }), "{fast}");
        mount.set_rates([0.5, 0.0], &within(5.0)).unwrap();
        mount.stop(&within(5.0)).unwrap();
        let stopped = mount.reading(&within(5.0)).unwrap();
        assert_eq!(stopped.motion, MountMotion::Still);
        let [rate, dec] = measured(&mut mount);
        // One that went on would move by 1,800″/s, one that followed the stars by 15″/s; what times of readings are off by on a busy machine is 0.2″/s.
        assert!(rate.abs() < 1.5 && dec.abs() < 1.5, "{rate} {dec}");

        // A mount that follows the stars says nothing for seconds: that is no lost link.
        mount.set_tracking(true, &within(5.0)).unwrap();
        std::thread::sleep(Duration::from_secs(2));
        let quiet = mount.reading(&within(5.0)).unwrap();
        assert_eq!(quiet.motion, MountMotion::Tracking);
        assert!((utc_now() - quiet.utc).to_seconds() < 1.0);

        mount.set_parked(true, &within(5.0)).unwrap();
        assert_eq!(wait(&mut mount).motion, MountMotion::Parked);
        let parked = MountPlace::Equatorial { ra_deg: 10.0, dec_deg: 20.0 };
        let refused = mount.begin_goto(parked, &within(5.0)).unwrap_err();
        assert!(refused.to_string().contains("parked"), "{refused}");
    });
}

/// Truth: a server that is killed; the calls end within their own time limit.
#[test]
fn a_mount_that_is_lost_is_told() {
    live("a_mount_that_is_lost_is_told", || {
        let mut server = Server::start(&["telescope"]);
        let mut mount =
            open_mount(server.connect(), TELESCOPE, MountSettings::default(), &within(20.0))
                .unwrap();
        mount.set_parked(false, &within(5.0)).unwrap();
        mount.reading(&within(5.0)).unwrap();
        server.kill();
        let lost = mount.reading(&within(5.0)).unwrap_err();
        assert!(matches!(lost, DeviceError::Transport { .. } | DeviceError::Lost { .. }), "{lost}");
    });
}
