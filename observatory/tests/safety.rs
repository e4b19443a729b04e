//! The Sun's cone, on every way.
#![allow(clippy::unwrap_used, reason = "helper functions of tests")]

use glam::DVec3;
use hifitime::Unit;
use rayon::prelude::*;
use sunglint_drivers::device::{MountAbilities, MountAxes, MountRates, MountSite};
use sunglint_ephemeris::motion::{AxisMotion, equatorial_axes, horizontal_axes};
use sunglint_formats::time::parse_utc;
use sunglint_observatory::telescope::{Certainty, Danger, Guard, SunCone, angles, direction, sun};
use sunglint_radiometry::sky::{EarthOrientation, Geodetic, Observer, Site};
use sunglint_testkit::Campaign;

fn site(latitude_deg: f64, longitude_deg: f64) -> Site {
    Site::new(Geodetic { latitude_deg, longitude_deg, height_m: 400.0 }).unwrap()
}

struct Dice(u64);

impl Dice {
    fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 11) as f64 / (1_u64 << 53) as f64
    }

    fn place(&mut self) -> DVec3 {
        let z = self.next();
        let turn = self.next() * std::f64::consts::TAU;
        let flat = (1.0 - z * z).sqrt();
        DVec3::new(flat * turn.cos(), flat * turn.sin(), z)
    }
}

fn angle_deg(a: DVec3, b: DVec3) -> f64 {
    a.cross(b).length().atan2(a.dot(b)).to_degrees()
}

/// Truth: the Sun by SOFA's `epv00` with the whole chain of frames (radiometry, held against astropy elsewhere), at sites and times all over. The Almanac promises 0.01°; aberration, UT1
/// and parallax stand beside it.
#[test]
fn the_guards_sun_is_the_sun() {
    let mut dice = Dice(5);
    let from = parse_utc("2020-01-01T00:00:00Z").unwrap();
    let mut worst = 0.0_f64;
    for _ in 0..300 {
        let epoch = from + dice.next() * 3650.0 * Unit::Day;
        let (latitude, longitude) = (dice.next() * 160.0 - 80.0, dice.next() * 360.0 - 180.0);
        let observer =
            Observer::at(epoch, &site(latitude, longitude), EarthOrientation::embedded()).unwrap();
        let truth = observer.sun().horizontal.east_north_up();
        worst = worst.max(angle_deg(truth, sun(epoch, latitude, longitude).enu));
    }
    println!("worst {worst:.4}°");
    assert!(worst < 0.03, "{worst}");
}

/// The ways that mounts take between two directions, at random speeds of the axes, over the flip, round either way; and the great circle.
fn ways(
    from: DVec3,
    to: DVec3,
    (axes, turns_over): (MountAxes, bool),
    latitude_deg: f64,
    dice: &mut Dice,
) -> Vec<DVec3> {
    let base = |enu: DVec3| match axes {
        MountAxes::Equatorial => equatorial_axes(enu, latitude_deg),
        MountAxes::Horizontal => enu,
    };
    let [a, b] = [from, to].map(|enu| AxisMotion::of(base(enu), DVec3::ZERO).angle_deg);
    let wrapped = (b[0] - a[0] + 180.0).rem_euclid(360.0) - 180.0;
    let mut turns = vec![[wrapped, b[1] - a[1]]];
    if axes == MountAxes::Horizontal {
        turns.push([wrapped - 360.0 * wrapped.signum(), b[1] - a[1]]);
    }
    if turns_over {
        for side in [-180.0, 180.0] {
            // A German mount turns over the pole above the horizon: there the first axis ends in the sky.
            let pole_deg = if latitude_deg < 0.0 { -90.0 } else { 90.0 };
            turns.push([wrapped + side, 2.0 * pole_deg - b[1] - a[1]]);
        }
    }
    let turn = turns[(dice.next() * turns.len() as f64) as usize % turns.len()];
    // Each axis at its own speed and after its own delay.
    let speeds = [0.3 + dice.next(), 0.3 + dice.next()];
    let waits = [
        dice.next() * 60.0 * f64::from(dice.next() < 0.5),
        dice.next() * 60.0 * f64::from(dice.next() < 0.5),
    ];
    let mut all = Vec::new();
    for i in 0..=600 {
        let t = f64::from(i);
        let done = |axis: usize| {
            let went = (speeds[axis] * (t - waits[axis])).max(0.0);
            turn[axis].signum() * went.min(turn[axis].abs())
        };
        let angle = [a[0] + done(0), a[1] + done(1)];
        let x = direction(angle);
        all.push(match axes {
            MountAxes::Equatorial => horizontal_axes(x, latitude_deg),
            MountAxes::Horizontal => x,
        });
    }
    for i in 0..=200 {
        let part = f64::from(i) / 200.0;
        all.extend((from * (1.0 - part) + to * part).try_normalize());
    }
    all
}

/// Truth: the Sun by SOFA, and ways of mounts that this test makes up. Random places, times and mounts: what the guard lets through never comes within 30° of the Sun while the Sun is up.
#[test]
fn campaign_sun_cone() {
    let mut campaign = Campaign::start("sun_cone", 100_000);
    let rows = random_commands(campaign.seeds(), [48.78, 9.18], None);
    let refused: u64 = rows.iter().map(|row| row.0).sum();
    let allowed: u64 = rows.iter().map(|row| row.1).sum();
    let least = rows.iter().map(|row| row.2).fold(180.0, f64::min);
    println!("{allowed} commands allowed, {refused} refused, least distance {least:.2}°");
    assert!(least >= 30.0, "{least}");
    assert!(allowed > refused, "{allowed} {refused}");
    campaign.largest("inside", rows.iter().filter(|row| row.2 < 30.0).count() as f64);
    campaign.finish();
}

/// Truth: as of the campaign, for German mounts in the south, which turn over the southern pole; and for mounts of which nobody says about which axes they turn: they go their ways about either.
#[test]
fn southern_and_unknown_mounts_keep_off_the_sun() {
    for (latitude_deg, kind) in [
        (-29.26, Kind::German),
        (-70.0, Kind::German),
        (-29.26, Kind::Unknown),
        (48.78, Kind::Unknown),
    ] {
        let rows = random_commands(0..700, [latitude_deg, -70.73], Some(kind));
        let allowed: u64 = rows.iter().map(|row| row.1).sum();
        let least = rows.iter().map(|row| row.2).fold(180.0, f64::min);
        println!("{latitude_deg} {kind:?}: {allowed} allowed, least distance {least:.2}°");
        assert!(least >= 30.0, "{latitude_deg} {kind:?}: {least}");
        assert!(allowed > 500, "{latitude_deg} {kind:?}: {allowed}");
    }
}

/// Kind of a mount.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Kind {
    German,
    /// Takes right ascension and declination; about which axes it turns, the guard is not told.
    Unknown,
}

/// Three random commands for each seed: refused, allowed, and least distance of the Sun while it is up, deg. Mounts of every kind by dice, or of one.
fn random_commands(
    seeds: std::ops::Range<u64>,
    [latitude_deg, longitude_deg]: [f64; 2],
    kind: Option<Kind>,
) -> Vec<(u64, u64, f64)> {
    let from = parse_utc("2026-01-01T00:00:00Z").unwrap();
    seeds
        .into_par_iter()
        .map(|seed| {
            let mut dice = Dice(seed * 104_729 + 17);
            let epoch = from + dice.next() * 365.0 * Unit::Day;
            let axes =
                if dice.next() < 0.5 { MountAxes::Equatorial } else { MountAxes::Horizontal };
            let axes = if kind == Some(Kind::German) { MountAxes::Equatorial } else { axes };
            let turns_over =
                axes == MountAxes::Equatorial && (kind == Some(Kind::German) || dice.next() < 0.5);
            let site = site(latitude_deg, longitude_deg);
            let cone = SunCone::default().with_pointing_deg(0.5);
            let guard = match kind {
                Some(Kind::Unknown) => {
                    let mut abilities =
                        MountAbilities::new(MountAxes::Equatorial, MountRates::Absent);
                    abilities.turns_about = None;
                    Guard::of(&site, &abilities, cone)
                }
                _ => Guard::new(&site, axes, turns_over, cone),
            };
            let observer = Observer::at(epoch, &site, EarthOrientation::embedded()).unwrap();
            let sighting = observer.sun().horizontal;
            let truth = sighting.east_north_up();
            // Where it stands now may be anything that is allowed.
            let mut here = dice.place();
            while guard.check_place(here, epoch).is_err() {
                here = dice.place();
            }
            let (mut refused, mut allowed, mut least) = (0, 0, 180.0_f64);
            // Three commands, each of which may fail half-way (an abort, a lost command of a detour): the mount stands there, and the next command
            // begins from there.
            for _ in 0..3 {
                let to = dice.place();
                let Ok(way) = guard.way(here, to, epoch, 60.0) else {
                    refused += 1;
                    continue;
                };
                allowed += 1;
                let fails = (dice.next() < 0.5).then(|| (dice.next() * way.len() as f64) as usize);
                for (leg, to) in way.into_iter().enumerate() {
                    let on_the_way = ways(here, to, (axes, turns_over), latitude_deg, &mut dice);
                    // The disc's upper limb is above the horizon: 16′ of radius, 34′ of refraction.
                    if sighting.altitude_deg() > -0.833 {
                        for x in &on_the_way {
                            least = least.min(angle_deg(*x, truth));
                        }
                    }
                    here = to;
                    if fails == Some(leg) && !on_the_way.is_empty() {
                        let last = on_the_way.len() - 1;
                        here = on_the_way[(dice.next() * last as f64) as usize];
                        break;
                    }
                }
            }
            (refused, allowed, least)
        })
        .collect()
}

/// Truth: the virtual telescope's own tube, and the Sun by SOFA: a German mount in the south that is sent to random places by day, by the ways that the guard allows, turns over as its motors do and never
/// looks within 30° of the Sun.
#[test]
fn a_southern_german_mount_never_looks_at_the_sun() {
    use std::sync::Arc;
    use std::time::Duration;
    use sunglint_drivers::clock::{Clock as _, Deadline, DeviceClock, VirtualClock};
    use sunglint_drivers::device::{Mount as _, MountMotion, PierSide};
    use sunglint_observatory::telescope::TargetPath;
    use sunglint_virtual::telescope::{Telescope, TelescopeOptions};

    let site = site(-29.26, -70.73);
    let earth = EarthOrientation::embedded();
    let soon = || Deadline::within(Duration::from_secs(1));
    // In summer the Sun stands on the pole's side of the sky, where the mount turns over; in winter ways are free.
    for (night, least_ways) in [("2026-12-21T04:00:00Z", 0), ("2026-06-21T05:00:00Z", 60)] {
        let start = parse_utc(night).unwrap();
        let hand = VirtualClock::new();
        let clock = DeviceClock { clock: Arc::new(hand.clone()), zero_utc: Some(start) };
        let options = TelescopeOptions::default().with(|o| {
            (o.axes, o.past_meridian_deg) = (MountAxes::Equatorial, Some(10.0));
            (o.site_deg, o.fastest_deg_s, o.frame_s) = ([-29.26, -70.73], 4.0, 1e9);
        });
        let telescope = Telescope::new(options, clock.clone(), Arc::new(|_| None)).with_history();
        let mut mount = telescope.mount();
        let cone = SunCone::default().with_pointing_deg(1.0);
        let guard = Guard::of(&site, mount.abilities(), cone);
        let path = || {
            let span = (clock.utc(), 10.0);
            TargetPath::fixed([0.0, 45.0].into(), &site, earth, span, MountAxes::Equatorial)
                .unwrap()
        };
        // By night to where the Sun does not come, and then it is day.
        let dec_deg = if least_ways > 0 { -60.0 } else { 40.0 };
        mount.begin_goto(path().place_of([-20.0, dec_deg], 0.0), &soon()).unwrap();
        hand.sleep(Duration::from_secs(120));
        mount.stop(&soon()).unwrap();
        hand.sleep(Duration::from_secs(8 * 3600));
        let mut dice = Dice(11);
        let (mut went, mut least, mut sides) = (0, 180.0_f64, [0, 0]);
        for _ in 0..400 {
            let (now, path) = (clock.utc(), path());
            let reading = mount.reading(&soon()).unwrap();
            let here = path.frame().to_enu(direction(path.angles_of(&reading)));
            let Ok(way) = guard.way(here, dice.place(), now, 200.0) else { continue };
            for leg in way {
                let angle = angles(path.frame().of_enu(leg));
                let now_s = path.time_s(clock.utc());
                mount.begin_goto(path.place_of(angle, now_s), &soon()).unwrap();
                for second in 0..200 {
                    hand.sleep(Duration::from_secs(1));
                    let reading = mount.reading(&soon()).unwrap();
                    let observer = Observer::at(clock.utc(), &site, earth).unwrap();
                    let sun = observer.sun().horizontal;
                    let time_s = (clock.utc() - start).to_seconds();
                    let looks = telescope.axes_at(time_s).unwrap().z_axis;
                    if sun.altitude_deg() > -0.833 {
                        least = least.min(angle_deg(looks, sun.east_north_up()));
                    }
                    if reading.motion != MountMotion::Slewing && second > 2 {
                        let off = angle_deg(looks, leg);
                        assert!(off < 1.5, "it looks {off}° beside its goal");
                        sides[usize::from(reading.pier == Some(PierSide::West))] += 1;
                        break;
                    }
                }
                // It stands there: stars that are followed for hours would lead it elsewhere.
                mount.stop(&soon()).unwrap();
            }
            went += 1;
        }
        println!("{night}: {went} ways, least distance {least:.2}°, {sides:?}");
        assert!(went >= least_ways, "{went}");
        assert!(least_ways == 0 || sides.iter().all(|side| *side > 20), "{sides:?}");
        assert!(least > 30.0, "{least}");
    }
}

/// Truth: the virtual telescope's own clock: one that is an hour off is refused, one within two minutes is not; silence is no doubt. Its site may be 0.1° off, which is 24 s of sidereal time. At 0 h UT on 1987 April 10 the mean sidereal time of Greenwich is 197.693 195° (Meeus, Astronomical Algorithms, example 12.a), further east it is later. A UTC that
/// was told long ago is no fault; one that lies ahead is.
#[test]
fn a_mounts_time_is_held_against_ours() {
    use std::sync::Arc;
    use std::time::Duration;
    use sunglint_drivers::clock::{Deadline, DeviceClock, VirtualClock};
    use sunglint_drivers::device::{MountClock, MountTime};
    use sunglint_virtual::telescope::{Telescope, TelescopeOptions};
    let start = parse_utc("2026-11-23T20:00:00Z").unwrap();
    let guard = Guard::new(&site(48.78, 9.18), MountAxes::Equatorial, true, SunCone::default());
    let doubt = |off_s: f64, longitude_deg: f64| {
        let clock = DeviceClock { clock: Arc::new(VirtualClock::new()), zero_utc: Some(start) };
        let options = TelescopeOptions::default().with(|o| {
            (o.axes, o.site_deg) = (MountAxes::Equatorial, [48.78, longitude_deg]);
            o.clock_off_s = off_s;
        });
        let telescope = Telescope::new(options, clock, Arc::new(|_| None));
        guard.doubt(&mut telescope.mount(), &Deadline::within(Duration::from_secs(1))).unwrap()
    };
    assert_eq!(doubt(0.0, 9.18), None);
    assert_eq!(doubt(-100.0, 9.18), None);
    assert_eq!(doubt(0.0, 9.28), None);
    for off_s in [3600.0, -3600.0, 150.0] {
        let Some(Danger::Time { off_s: found_s }) = doubt(off_s, 9.18) else { panic!("{off_s}") };
        assert!((found_s - off_s).abs() < 2.0 + 0.003 * off_s.abs(), "{found_s}");
    }
    let told = |off_s: f64| {
        let clock = MountClock::SetTo(start + off_s * Unit::Second);
        guard.check_time(Some(MountTime { utc: start, clock }), None)
    };
    assert!(told(-7200.0).is_ok() && told(5.0).is_ok());
    assert!(matches!(told(3600.0), Err(Danger::Time { .. })));
    assert!(guard.check_time(None, None).is_ok());
    let utc = parse_utc("1987-04-10T00:00:00Z").unwrap();
    let at = |deg: f64| {
        guard.check_time(Some(MountTime { utc, clock: MountClock::SiderealDeg(deg) }), None)
    };
    assert!(at(197.693_195 + 9.18).is_ok() && at(197.693_195 + 9.18 + 0.4).is_ok());
    for off_deg in [0.6, -0.6, -9.18, -18.36] {
        assert!(at(197.693_195 + 9.18 + off_deg).is_err(), "{off_deg}");
    }
}

/// Truth: with the Sun at −2° to −18° no place is refused for it (the figure).
#[test]
fn the_cone_is_off_in_the_night() {
    let site = site(48.78, 9.18);
    let guard = Guard::new(&site, MountAxes::Equatorial, true, SunCone::default());
    let from = parse_utc("2026-11-23T00:00:00Z").unwrap();
    let (mut seen, mut dice) = (0, Dice(9));
    for minute in 0..2000 {
        let epoch = from + f64::from(minute) * Unit::Minute;
        let now = guard.sun(epoch);
        if (-18.0..-2.0).contains(&now.altitude_deg) {
            seen += 1;
            guard.check_place(dice.place(), epoch).unwrap();
            guard.way(dice.place(), dice.place(), epoch, 10.0).unwrap();
        }
    }
    assert!(seen > 200, "{seen}");
}

/// Truth: the rules in words.
#[test]
fn doubts_keep_a_mount_where_it_is() {
    let site = site(48.78, 9.18);
    let guard = Guard::new(&site, MountAxes::Equatorial, true, SunCone::default());
    let near = MountSite { latitude_deg: 48.8, longitude_deg: 9.1, height_m: 0.0 };
    guard.check_site(Some(near)).unwrap();
    guard.check_site(None).unwrap();
    let far = MountSite { latitude_deg: 48.8, longitude_deg: -9.18, height_m: 0.0 };
    assert!(matches!(guard.check_site(Some(far)), Err(Danger::Site { .. })));
    for (synchronised, error_s, good) in [
        (Some(true), Some(0.001), true),
        (Some(true), None, true),
        (Some(true), Some(3.0), false),
        (Some(false), None, false),
        (None, None, false),
    ] {
        assert_eq!(Certainty { synchronised, error_s }.check().is_ok(), good);
    }
    let noon = parse_utc("2026-06-21T11:25:00Z").unwrap();
    let sun = guard.sun(noon);
    assert!((64.0..65.5).contains(&sun.altitude_deg), "{}", sun.altitude_deg);
    assert!(matches!(guard.check_place(sun.enu, noon), Err(Danger::Sun { .. })));
    assert!(matches!(guard.check_place(DVec3::NAN, noon), Err(Danger::NotFinite)));
    assert!(matches!(guard.check_place(-DVec3::Z, noon), Err(Danger::Low { .. })));
}

/// Truth: the promise in words: a mount that turns at 1 °/s stands within a second after the last heartbeat, though the tracker's end of the channel is still there; and a person's stop holds against
/// a tracker that goes on.
#[test]
fn a_watchdog_stops_a_mount() {
    use std::sync::{Arc, mpsc};
    use std::time::{Duration, Instant};
    use sunglint_drivers::clock::{Clock as _, Deadline, DeviceClock, VirtualClock};
    use sunglint_drivers::device::{Mount as _, MountMotion};
    use sunglint_observatory::telescope::watchdog::{Beat, Watched, watch};
    use sunglint_virtual::telescope::{Telescope, TelescopeOptions};

    let ticking = VirtualClock::new();
    let zero = parse_utc("2026-11-23T00:00:00Z").unwrap();
    let clock = DeviceClock { clock: Arc::new(ticking.clone()), zero_utc: Some(zero) };
    let telescope = Telescope::new(TelescopeOptions::default(), clock, Arc::new(|_| None));
    let mut mount = telescope.mount();
    let soon = || Deadline::within(Duration::from_secs(1));
    let standing = |ticking: &VirtualClock| {
        ticking.sleep(Duration::from_secs(2));
        telescope.mount().reading(&soon()).unwrap().motion
    };
    mount.set_rates([1.0, 0.0], &soon()).unwrap();
    assert_eq!(standing(&ticking), MountMotion::Tracking);
    let (beats, received) = mpsc::channel();
    let tracker = std::thread::spawn(move || {
        for _ in 0..10 {
            beats.send(Beat::Alive).unwrap();
            std::thread::sleep(Duration::from_millis(100));
        }
        let last = Instant::now();
        // It hangs.
        std::thread::sleep(Duration::from_secs(2));
        last
    });
    assert_eq!(watch(&mut mount, &received).unwrap(), Watched::Silent);
    let stopped = Instant::now();
    assert_eq!(standing(&ticking), MountMotion::Still);
    let after = stopped.saturating_duration_since(tracker.join().unwrap());
    assert!(after < Duration::from_secs(1), "{after:?}");

    let (beats, received) = mpsc::channel();
    mount.set_rates([1.0, 0.0], &soon()).unwrap();
    for beat in [Beat::Stop, Beat::Alive, Beat::Done] {
        beats.send(beat).unwrap();
    }
    assert_eq!(watch(&mut mount, &received).unwrap(), Watched::Stopped);
    assert_eq!(standing(&ticking), MountMotion::Still);
}
