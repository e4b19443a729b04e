//! Passes followed by the virtual telescope.
#![allow(clippy::unwrap_used, reason = "helper functions of tests")]

use glam::DVec3;
use hifitime::{Epoch, Unit};
use rayon::prelude::*;
use std::ops::ControlFlow;
use std::sync::{Arc, Mutex};
use sunglint_drivers::clock::{Cancel, Deadline, DeviceClock, VirtualClock};
use sunglint_drivers::device::{DeviceError, Finder, FinderFrame, Mount as _, MountAxes, PierSide};
use sunglint_ephemeris::geometry::Geometry;
use sunglint_ephemeris::orbit::{Orbit, TleOrbit, tle};
use sunglint_ephemeris::passes::{Conditions, Search};
use sunglint_formats::time::parse_utc;
use sunglint_observatory::telescope::{
    Danger, Guard, Keyhole, Order, Orders, SunCone, TargetPath, TrackError, TrackOptions,
    TrackState, TrackStep, Tracker, angles,
};
use sunglint_radiometry::sky::{EarthOrientation, Geodetic, Observer, Site, SkyFrames};
use sunglint_radiometry::station::Horizon;
use sunglint_testkit::Campaign;
use sunglint_virtual::telescope::{Telescope, TelescopeOptions, TruthRow};

fn site() -> Site {
    Site::new(Geodetic { latitude_deg: 48.78, longitude_deg: 9.18, height_m: 400.0 }).unwrap()
}

/// Numbers in [0, 1): splitmix64.
struct Dice(u64);

impl Dice {
    fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 11) as f64 / (1_u64 << 53) as f64
    }

    fn between(&mut self, a: f64, b: f64) -> f64 {
        a + (b - a) * self.next()
    }
}

fn with_sum(line: &str) -> String {
    let sum: u32 = line
        .bytes()
        .map(|b| match b {
            b'0'..=b'9' => u32::from(b - b'0'),
            b'-' => 1,
            _ => 0,
        })
        .sum();
    format!("{line}{}", sum % 10)
}

/// A synthetic circular orbit of this height, km, and inclination; the rest by dice.
fn orbit(height_km: f64, inclination: f64, dice: &mut Dice) -> Orbit {
    let a = 6378.135 + height_km;
    let per_day = 86_400.0 / (std::f64::consts::TAU * (a.powi(3) / 398_600.8).sqrt());
    let line1 = with_sum("1 99999U 26001A   26300.00000000  .00000000  00000-0  00000-0 0  999");
    let line2 = with_sum(&format!(
        "2 99999 {inclination:8.4} {:8.4} 0001000 {:8.4} {:8.4} {per_day:11.8}    1",
        dice.between(0.0, 360.0),
        dice.between(0.0, 360.0),
        dice.between(0.0, 360.0),
    ));
    let set = tle::parse("synthetic", &format!("{line1}\n{line2}\n")).unwrap().remove(0);
    Orbit::from(TleOrbit::new(set).unwrap())
}

/// A pass: its orbit, and when it is above 15°.
struct Pass {
    orbit: Orbit,
    from: Epoch,
    seconds: f64,
}

/// A pass that culminates between two altitudes, by dice.
fn pass(heights_km: [f64; 2], culmination: [f64; 2], dice: &mut Dice) -> Pass {
    let from = parse_utc("2026-10-27T00:00:00Z").unwrap();
    loop {
        let orbit =
            orbit(dice.between(heights_km[0], heights_km[1]), dice.between(50.0, 100.0), dice);
        let conditions = Conditions { min_altitude_deg: 15.0, sun_below_deg: 90.0 };
        let window = (from, from + 1.0 * Unit::Day);
        let search = Search::new(
            &site(),
            &Horizon::Flat(0.0),
            window,
            conditions,
            EarthOrientation::embedded(),
        );
        let search = search.unwrap();
        let found = search.passes(&orbit).passes;
        let good = found.iter().find(|p| (culmination[0]..culmination[1]).contains(&p.highest_deg));
        if let Some(good) = good {
            return Pass { orbit, from: good.span.from, seconds: good.span.seconds() };
        }
    }
}

/// How a pass went.
#[derive(Debug, Clone)]
struct Went {
    /// Time from the begin of following until the target is locked and within 10″ of the telescope's axis, s.
    acquired_s: Option<f64>,
    /// Root mean square of the target's distance from the telescope's axis, arcsec, from 3 s after the lock (or the begin) on, without the stretch near the pole of the axes in which the first axis cannot
    /// follow, and 3 s after it.
    rms_arcsec: f64,
    steps: Vec<TrackStep>,
    truth: Vec<TruthRow>,
    /// Whether a German mount ran into an end of its first axis.
    hit_end: bool,
    /// That stretch, s of the path.
    keyhole: Option<Keyhole>,
}

impl Went {
    fn rms(&self, from_s: f64, to_s: f64) -> f64 {
        let rows = self.truth.iter().filter(|row| (from_s..to_s).contains(&row.time_s));
        let squares: Vec<f64> = rows.map(|row| row.off_arcsec.powi(2)).collect();
        (squares.iter().sum::<f64>() / squares.len() as f64).sqrt()
    }
}

/// A finder whose last frame somebody looks at, too.
struct Watched<F> {
    finder: F,
    /// Side of the pier for which its axes hold, in a plan.
    side: Option<PierSide>,
    last: Arc<Mutex<Option<FinderFrame>>>,
}

impl<F: Finder> Finder for Watched<F> {
    fn half_width_deg(&self) -> f64 {
        self.finder.half_width_deg()
    }

    fn side(&self) -> Option<PierSide> {
        self.side.or(self.finder.side())
    }

    fn frame(&mut self, deadline: &Deadline) -> Result<Option<FinderFrame>, DeviceError> {
        let frame = self.finder.frame(deadline)?;
        if let Some(frame) = &frame {
            *self.last.lock().unwrap() = Some(frame.clone());
        }
        Ok(frame)
    }
}

/// Follows a pass whose target is late by `along_s` and `across_arcsec` off its track.
fn follow(pass: &Pass, off: [f64; 2], telescope: TelescopeOptions, options: TrackOptions) -> Went {
    follow_by_hand(pass, off, telescope, options, &mut |_, _, _| {})
}

/// The same, with a person who sees the steps and the finder's last frame.
fn follow_by_hand(
    pass: &Pass,
    off: [f64; 2],
    telescope: TelescopeOptions,
    options: TrackOptions,
    hand: &mut dyn FnMut(&TrackStep, Option<&FinderFrame>, &Orders),
) -> Went {
    try_to_follow(pass, off, (telescope, None), options, hand).unwrap()
}

/// The same, with the side of the pier for which a plan says that the finder's axes hold; it may fail.
fn try_to_follow(
    pass: &Pass,
    [along_s, across_arcsec]: [f64; 2],
    (telescope, side): (TelescopeOptions, Option<PierSide>),
    options: TrackOptions,
    hand: &mut dyn FnMut(&TrackStep, Option<&FinderFrame>, &Orders),
) -> Result<Went, TrackError> {
    let earth = EarthOrientation::embedded();
    let (axes, fastest_deg_s) = (telescope.axes, 0.98 * telescope.fastest_deg_s);
    let span = (pass.from, pass.seconds);
    let path = TargetPath::new(&pass.orbit, &site(), earth, span, axes, false).unwrap();
    // The clock begins a minute before the pass.
    let start = pass.from - 60.0 * Unit::Second;
    let clock = DeviceClock { clock: Arc::new(VirtualClock::new()), zero_utc: Some(start) };
    let frames =
        SkyFrames::over(start - 1.0 * Unit::Hour, pass.from + 1.0 * Unit::Hour, earth).unwrap();
    let orbit = pass.orbit.near(start, pass.from + 1.0 * Unit::Hour);
    let sky = move |epoch: Epoch| -> Option<DVec3> {
        let at = |epoch: Epoch| {
            let observer = Observer::new(frames.at(epoch).ok()?, &site());
            Some(Geometry::at(&orbit, &observer).ok()?.horizontal.east_north_up())
        };
        let late = epoch - along_s * Unit::Second;
        let (here, soon) = (at(late)?, at(late + 0.1 * Unit::Second)?);
        let across = here.cross(soon).normalize();
        Some((here + across * (across_arcsec / 206_264.8)).normalize())
    };
    let telescope = Telescope::new(telescope, clock.clone(), Arc::new(sky));
    let guard = Guard::new(
        &site(),
        axes,
        telescope.mount().abilities().tells_pier_side,
        SunCone::default().with_limit_deg(0.0).with_pointing_deg(0.0),
    );
    let (mut mount, last) = (telescope.mount(), Arc::new(Mutex::new(None)));
    let mut finder = Watched { finder: telescope.finder(), side, last: last.clone() };
    let mut options = options;
    options.watch_clock = false;
    let orders = Orders::default();
    let tracker = Tracker::new(&path, &guard, &mut mount, Some(&mut finder), clock, options);
    let mut steps = Vec::new();
    let summary = tracker.steered_by(&orders).run(&Cancel::new(), &mut |step| {
        steps.push(*step);
        hand(step, last.lock().unwrap().as_ref(), &orders);
        ControlFlow::Continue(())
    })?;
    let truth = telescope.truth();
    let mut went = Went {
        acquired_s: summary.locked_s.and_then(|locked| {
            let near = |row: &&TruthRow| row.time_s >= 60.0 + locked && row.off_arcsec < 10.0;
            let first = truth.iter().find(near)?;
            Some(first.time_s - 60.0 - summary.began_s)
        }),
        rms_arcsec: f64::NAN,
        steps,
        truth,
        hit_end: telescope.hit_end(),
        keyhole: Keyhole::of(&path, fastest_deg_s),
    };
    let from_s = summary.locked_s.unwrap_or(summary.began_s) + 3.0 + 60.0;
    let lost_s = went.keyhole.map_or([f64::INFINITY; 2], |key| [key.from_s, key.to_s + 3.0]);
    let is_lost = |row: &TruthRow| (lost_s[0]..lost_s[1]).contains(&(row.time_s - 60.0));
    went.rms_arcsec = {
        let rows =
            went.truth.iter().filter(|row| (from_s..60.0 + pass.seconds).contains(&row.time_s));
        let squares: Vec<f64> =
            rows.filter(|row| !is_lost(row)).map(|row| row.off_arcsec.powi(2)).collect();
        (squares.iter().sum::<f64>() / squares.len() as f64).sqrt()
    };
    Ok(went)
}

/// Passes that cross the meridian above the pole, not near their ends: seed, pass, and when, s.
fn over_the_meridian(seeds: std::ops::Range<u64>, most: usize) -> Vec<(u64, Pass, f64)> {
    let of = |seed: u64| {
        let pass = pass([800.0, 1500.0], [35.0, 65.0], &mut Dice(seed));
        let (span, earth) = ((pass.from, pass.seconds), EarthOrientation::embedded());
        let axes = MountAxes::Equatorial;
        let path = TargetPath::new(&pass.orbit, &site(), earth, span, axes, false).unwrap();
        let hour_angle = |s: f64| angles(path.at(s).direction)[0];
        let crosses = (0..pass.seconds as usize).map(|i| i as f64).find(|s| {
            let (a, b) = (hour_angle(*s), hour_angle(s + 1.0));
            a * b <= 0.0 && (a - b).abs() < 90.0
        })?;
        (crosses > 60.0 && crosses < pass.seconds - 130.0).then_some((seed, pass, crosses))
    };
    seeds.filter_map(of).take(most).collect()
}

/// A German mount whose first axis ends 10° past the meridian.
fn german(seed: u64) -> TelescopeOptions {
    TelescopeOptions::default().with(|o| {
        (o.axes, o.seed, o.fastest_deg_s) = (MountAxes::Equatorial, seed, 6.0);
        o.past_meridian_deg = Some(10.0);
    })
}

fn past(past_deg: f64) -> TrackOptions {
    let mut options = TrackOptions::default();
    options.past_meridian_deg = past_deg;
    options
}

/// Truth: the virtual telescope's own: a German mount turns over by itself 10° past the meridian, and a rate ends that half-way. Whether it says meanwhile that it slews, or that it follows, it is
/// left alone until it hangs on the other side, and the target is followed on from there.
#[test]
fn a_mount_that_turns_over_by_itself_is_left_to_it() {
    let passes = over_the_meridian(40..70, 4);
    assert!(passes.len() >= 3);
    for (seed, pass, crosses) in passes {
        for hides_turn in [false, true] {
            let made = german(seed).with(|o| (o.turns_itself, o.hides_turn) = (true, hides_turn));
            let went = follow(&pass, [0.5, 10.0], made, past(60.0));
            let late: Vec<_> = went.steps.iter().filter(|s| s.time_s > crosses - 30.0).collect();
            let turned: Vec<f64> = late
                .windows(2)
                .filter(|two| two[0].pier != two[1].pier)
                .map(|two| two[1].time_s)
                .collect();
            let [turned_s] = turned[..] else { panic!("{seed} {hides_turn}: {turned:?}") };
            let after = went.rms(60.0 + turned_s + 50.0, 60.0 + pass.seconds);
            println!(
                "{seed} {hides_turn}: turned at {turned_s:.0} s of {:.0} s, rms {after:.2}″",
                pass.seconds
            );
            assert!(after < 5.0 || turned_s + 60.0 > pass.seconds, "{seed} {hides_turn}: {after}");
        }
    }
}

/// Truth: the virtual telescope's own: its switches stop it 10° past the meridian, where the tracker would follow farther. One that tells its side is turned over once, and its target is followed from
/// there; of one that is taken for a fork the message names the limit.
#[test]
fn a_mount_that_stops_at_its_limit_says_so() {
    let (seed, pass, _) = over_the_meridian(40..70, 1).remove(0);
    let went = follow(&pass, [0.5, 10.0], german(seed), past(60.0));
    assert!(went.hit_end);
    let after = went.rms(60.0 + pass.seconds - 20.0, 60.0 + pass.seconds);
    assert!(after < 5.0, "{after}");
    let mut options = past(0.0);
    options.german = false;
    let made = (german(seed), None);
    let ended = try_to_follow(&pass, [0.5, 10.0], made, options, &mut |_, _, _| {}).err();
    let Some(TrackError::MeridianLimit { past_deg }) = ended else { panic!("{ended:?}") };
    assert!((past_deg - 10.0).abs() < 1.0, "{past_deg}");
}

/// Truth: in words: names do not matter to where a mount has to turn over. One that names its sides the other way round turns over once, before its switches, and its target is followed.
#[test]
fn sides_by_other_names_are_turned_over_all_the_same() {
    for (seed, pass, crosses) in over_the_meridian(40..70, 3) {
        let made = german(seed).with(|o| o.swaps_names = true);
        let went = follow(&pass, [0.5, 10.0], made, past(0.0));
        assert!(!went.hit_end, "{seed}");
        let late: Vec<_> = went.steps.iter().filter(|s| s.time_s > crosses - 30.0).collect();
        let turns = late.windows(2).filter(|two| two[0].pier != two[1].pier).count();
        assert_eq!(turns, 1, "{seed}");
        let after = went.rms(60.0 + crosses + 70.0, 60.0 + pass.seconds);
        assert!(after < 5.0, "{seed}: {after}");
    }
}

/// Truth: in words: a camera that is upside down on one side of the pier says nothing where the mount does not say on which it hangs; on a fork that is known as one it says what it sees.
#[test]
fn frames_count_only_where_the_side_is_known() {
    let (seed, pass, _) = over_the_meridian(40..70, 1).remove(0);
    let fork = german(seed).with(|o| o.past_meridian_deg = None);
    for german in [true, false] {
        let mut options = TrackOptions::default();
        options.german = german;
        let made = (fork.clone(), Some(PierSide::West));
        let (mut refused, mut given) = (Vec::new(), false);
        let went = try_to_follow(&pass, [0.5, 10.0], made, options, &mut |step, _, orders| {
            if !given && step.time_s > 30.0 {
                given = orders.give(Order::Jog { arcsec: [5.0, 5.0].into() });
            }
            refused.extend(orders.refusals());
        })
        .unwrap();
        let led = went.steps.iter().any(|step| step.state == TrackState::Locked);
        assert_eq!((led, refused.is_empty()), (!german, !german), "{refused:?}");
    }
}

/// Truth: the virtual telescope's own: a fork whose driver makes a side of a pier up from the hour angle, as some do. Its camera does not turn over at the meridian, and the target is followed on.
#[test]
fn a_side_that_is_made_up_turns_no_camera_over() {
    for (seed, pass, crosses) in over_the_meridian(40..70, 3) {
        let made = german(seed).with(|o| (o.past_meridian_deg, o.makes_sides_up) = (None, true));
        let (span, earth) = ((pass.from, pass.seconds), EarthOrientation::embedded());
        let axes = MountAxes::Equatorial;
        let path = TargetPath::new(&pass.orbit, &site(), earth, span, axes, false).unwrap();
        let begins = angles(path.at(0.0).direction)[0];
        let side = if begins < 0.0 { PierSide::West } else { PierSide::East };
        let options = TrackOptions::default();
        let went =
            try_to_follow(&pass, [0.5, 10.0], (made, Some(side)), options, &mut |_, _, _| {});
        let went = went.unwrap();
        let late: Vec<_> = went.steps.iter().filter(|s| s.time_s > crosses - 30.0).collect();
        let turns = late.windows(2).filter(|two| two[0].pier != two[1].pier).count();
        assert_eq!(turns, 1, "{seed}");
        let after = went.rms(60.0 + crosses + 30.0, 60.0 + pass.seconds);
        println!("{seed}: rms {after:.2}″ after the meridian");
        assert!(after < 5.0, "{seed}: {after}");
    }
}

/// Truth: the same orbit on a longer path, and plain arithmetic: beyond its ends a path goes on along the orbit, where a straight line would be degrees beside it; a path that is late stands at the same
/// angles so much later, at right ascensions of that time.
#[test]
fn a_path_goes_on_beyond_its_ends() {
    let pass = pass([400.0, 600.0], [60.0, 80.0], &mut Dice(3));
    let earth = EarthOrientation::embedded();
    let middle = pass.from + 0.5 * pass.seconds * Unit::Second;
    let of = |from: Epoch, seconds: f64| {
        let span = (from, seconds);
        TargetPath::new(&pass.orbit, &site(), earth, span, MountAxes::Equatorial, true).unwrap()
    };
    let long = of(middle - 60.0 * Unit::Second, 140.0);
    let short = of(middle, 20.0);
    assert_eq!(short.seconds(), 20.0);
    for time_s in [-58.3, -30.0, -0.2, 0.0, 12.3, 20.0, 21.1, 78.0] {
        let (a, b) = (short.at(time_s), long.at(time_s + 60.0));
        let off = a.direction.angle_between(b.direction).to_degrees() * 3600.0;
        assert!(off < 0.01, "{time_s}: {off}″");
        assert!((a.per_s - b.per_s).length() < 1e-8);
    }
    let (late, then) = (short.clone().later(30.0), of(middle + 30.0 * Unit::Second, 20.0));
    assert_eq!(late.from(), then.from());
    assert_eq!(late.at(5.0), short.at(5.0));
    assert!((late.sidereal_deg(7.0) - then.sidereal_deg(7.0)).abs() < 1e-4);
}

/// Truth: the altitude that the mount says: a path that sinks below the lowest altitude is left five seconds after it is known, three seconds ahead, that it will be half a degree lower.
#[test]
fn a_target_that_sinks_too_low_is_left() {
    let pass = pass([600.0, 1200.0], [35.0, 65.0], &mut Dice(5));
    let (earth, axes) = (EarthOrientation::embedded(), MountAxes::Horizontal);
    let half_s = 0.5 * pass.seconds;
    let from = pass.from + half_s * Unit::Second;
    let path = TargetPath::new(&pass.orbit, &site(), earth, (from, half_s), axes, false).unwrap();
    let clock = DeviceClock {
        clock: Arc::new(VirtualClock::new()),
        zero_utc: Some(from - 60.0 * Unit::Second),
    };
    let telescope = Telescope::new(TelescopeOptions::default(), clock.clone(), Arc::new(|_| None));
    let cone = SunCone::default().with_limit_deg(0.0).with_pointing_deg(0.0);
    let least_deg = 22.0;
    let guard = Guard::new(&site(), axes, false, cone).with_horizon(Horizon::Flat(0.0), least_deg);
    let mut mount = telescope.mount();
    let mut options = TrackOptions::default();
    options.watch_clock = false;
    let mut steps: Vec<TrackStep> = Vec::new();
    let mut tracker = Tracker::new(&path, &guard, &mut mount, None, clock, options);
    let ended = tracker.run(&Cancel::new(), &mut |step| {
        steps.push(*step);
        ControlFlow::Continue(())
    });
    assert!(matches!(ended, Err(TrackError::Danger(Danger::Low { .. }))), "{ended:?}");
    let last = steps.last().unwrap();
    let then = |s: f64| path.altitude_deg(last.time_s + s) - (least_deg - 0.5);
    assert!(then(0.5) < 0.0 && then(-2.5) > 0.0, "{:.2}", last.altitude_deg);
}

fn quantile(mut values: Vec<f64>, part: f64) -> f64 {
    values.sort_by(f64::total_cmp);
    values[((values.len() - 1) as f64 * part).round() as usize]
}

/// Passes of a row of the campaign: acquisition and rms of each.
fn row(
    seeds: std::ops::Range<u64>,
    late_s: f64,
    telescope: impl Fn(&mut TelescopeOptions) + Sync,
    options: impl Fn(&mut TrackOptions) + Sync,
) -> Vec<(Option<f64>, f64)> {
    seeds
        .into_par_iter()
        .map(|seed| {
            let mut dice = Dice(seed * 7919 + 1);
            let pass = pass([400.0, 2000.0], [20.0, 75.0], &mut dice);
            let axes = if seed % 2 == 0 { MountAxes::Horizontal } else { MountAxes::Equatorial };
            let off = [dice.between(-late_s, late_s), dice.between(-30.0, 30.0)];
            let made = TelescopeOptions::default().with(|o| {
                (o.axes, o.seed) = (axes, seed);
                telescope(o);
            });
            let mut track = TrackOptions::default();
            track.estimator.frame_s = made.frame_s;
            track.estimator.along_s = late_s;
            options(&mut track);
            let went = follow(&pass, off, made, track);
            (went.acquired_s, went.rms_arcsec)
        })
        .collect()
}

fn figures(went: &[(Option<f64>, f64)]) -> [f64; 4] {
    let rms: Vec<f64> = went.iter().map(|w| w.1).collect();
    let times: Vec<f64> = went.iter().map(|w| w.0.unwrap_or(f64::INFINITY)).collect();
    [
        quantile(rms.clone(), 0.5),
        quantile(rms, 0.95),
        quantile(times.clone(), 0.5),
        quantile(times, 0.95),
    ]
}

/// Truth: the virtual telescope's own: where its tube pointed, and where the target was. Orbits of 400 to 2,000 km that culminate at 20° to 75°, alt-azimuth and equatorial mounts in
/// turn, elements that are off by up to 2 s along the track and 30″ across it, 2″ of seeing, frames at 10 Hz, a field of ±2°.
#[test]
fn campaign_telescope() {
    let mut campaign = Campaign::start("telescope", 200);
    let seeds = campaign.seeds();
    let closed = row(seeds.clone(), 2.0, |_| {}, |_| {});
    let [median, most, acquired, late] = figures(&closed);
    println!(
        "closed: rms {median:.2}″, 95 % {most:.2}″; acquired {acquired:.1} s, 95 % {late:.1} s"
    );
    assert!(median <= 2.0 && most <= 5.0, "{median} {most}");
    assert!(late <= 5.0, "{late}");
    campaign.largest("largest_rms_arcsec", closed.iter().map(|w| w.1).fold(0.0, f64::max));
    if campaign.is_whole() {
        campaign.largest("closed_median_arcsec", median);
        campaign.largest("closed_95_arcsec", most);
        for (name, [median_as, most_as], late_s, telescope, open) in ROWS {
            let went = row(seeds.clone(), late_s, telescope, |track| track.open_loop = open);
            let [median, most, acquired, late] = figures(&went);
            println!(
                "{name}: rms {median:.2}″, 95 % {most:.2}″; acquired {acquired:.1} s, 95 % {late:.1} s"
            );
            campaign.largest(median_as, median);
            campaign.largest(most_as, most);
        }
    }
    campaign.finish();
}

/// A row of the campaign beside the closed loop: its name, those of its median and of what 95 % of its passes keep to in the campaign's file, by how much the elements may be late, s, what is otherwise, and whether it follows
/// the prediction alone.
type Row = (&'static str, [&'static str; 2], f64, fn(&mut TelescopeOptions), bool);

const ROWS: [Row; 15] = [
    ("open loop", ["open_median_arcsec", "open_95_arcsec"], 2.0, |_| {}, true),
    (
        "periodic error 10″",
        ["periodic_median_arcsec", "periodic_95_arcsec"],
        2.0,
        |o| o.periodic_arcsec = 10.0,
        false,
    ),
    ("wind 3″", ["wind_median_arcsec", "wind_95_arcsec"], 2.0, |o| o.wind_arcsec = 3.0, false),
    (
        "20 % of frames lost",
        ["lost_frames_median_arcsec", "lost_frames_95_arcsec"],
        2.0,
        |o| o.lost_frames = 0.2,
        false,
    ),
    (
        "10 % of commands lost",
        ["dropped_median_arcsec", "dropped_95_arcsec"],
        2.0,
        |o| o.dropped = 0.1,
        false,
    ),
    (
        "a star a square degree, four times as bright",
        ["stars_median_arcsec", "stars_95_arcsec"],
        2.0,
        |o| o.stars = (1.0, 4.0),
        false,
    ),
    (
        "rates each twice the one before",
        ["octaves_median_arcsec", "octaves_95_arcsec"],
        2.0,
        |o| o.steps_deg_s = octaves(),
        false,
    ),
    (
        "rates each twice the one before, open loop",
        ["octaves_open_median_arcsec", "octaves_open_95_arcsec"],
        2.0,
        |o| o.steps_deg_s = octaves(),
        true,
    ),
    (
        "rates 0.05°/s apart",
        ["fine_steps_median_arcsec", "fine_steps_95_arcsec"],
        2.0,
        |o| o.steps_deg_s = fine_steps(),
        false,
    ),
    (
        "a camera of ±0.25° without a finder",
        ["narrow_median_arcsec", "narrow_95_arcsec"],
        2.0,
        |o| o.field_deg = 0.25,
        false,
    ),
    (
        "a camera of ±0.25° without a finder, elements off by 0.2 s",
        ["narrow_good_median_arcsec", "narrow_good_95_arcsec"],
        0.2,
        |o| o.field_deg = 0.25,
        false,
    ),
    (
        "the thesis' camera, ±4′, elements off by 0.2 s",
        ["thesis_median_arcsec", "thesis_95_arcsec"],
        0.2,
        |o| o.field_deg = 4.0 / 60.0,
        false,
    ),
    (
        "2 frames a second",
        ["frames_2_hz_median_arcsec", "frames_2_hz_95_arcsec"],
        2.0,
        |o| o.frame_s = 0.5,
        false,
    ),
    (
        "1 frame a second",
        ["frames_1_hz_median_arcsec", "frames_1_hz_95_arcsec"],
        2.0,
        |o| o.frame_s = 1.0,
        false,
    ),
    (
        "a frame each two seconds",
        ["frames_half_hz_median_arcsec", "frames_half_hz_95_arcsec"],
        2.0,
        |o| o.frame_s = 2.0,
        false,
    ),
];

/// Rates each twice the one before, from that of the stars to 4.3 °/s, deg/s.
fn octaves() -> Vec<f64> {
    (0..11).map(|i| 15.041 / 3600.0 * f64::from(1 << i)).collect()
}

/// Rates 0.05 °/s apart, to 10 °/s, deg/s.
fn fine_steps() -> Vec<f64> {
    (1..=200).map(|i| 0.05 * f64::from(i)).collect()
}

/// Truth: the virtual telescope's own, which refuses every rate that is not on its list, and arithmetic: between two rates that differ by d a target is within d·T/2 on each axis, T the time between two commands
/// (0.1 s), and anywhere in there: rms d·T/√6 for both axes together, 7.3″ for rates 0.05 °/s apart. Tolerance: half as much again, since a command that acts 0.02 s later adds d·0.02 s (3.6″), and 1″ that any mount has.
#[test]
fn a_mount_of_a_few_rates_goes_to_and_fro_between_them() {
    for (seed, axes) in [(3, MountAxes::Horizontal), (4, MountAxes::Equatorial)] {
        let pass = pass([500.0, 1200.0], [40.0, 70.0], &mut Dice(seed));
        let made = TelescopeOptions::default().with(|o| {
            (o.axes, o.seed, o.steps_deg_s) = (axes, seed, fine_steps());
        });
        let went = follow(&pass, [1.2, -20.0], made, TrackOptions::default());
        let steps = fine_steps();
        let is_step = |rate: f64| rate == 0.0 || steps.contains(&rate.abs());
        assert!(
            went.steps.iter().all(|step| step.commanded_deg_s.to_array().map(is_step) == [true; 2])
        );
        println!("{axes:?}: rms {:.1}″, acquired {:?}", went.rms_arcsec, went.acquired_s);
        assert!((5.0..11.0).contains(&went.rms_arcsec), "{axes:?}: {}", went.rms_arcsec);
    }
}

/// Truth: as above. A cloud of 5 s in the middle of a pass: the target is seen again within 3 s, and the telescope stays on it afterwards.
#[test]
fn a_cloud_is_coasted_through() {
    for (seed, axes) in [(3, MountAxes::Horizontal), (4, MountAxes::Equatorial)] {
        let mut dice = Dice(seed);
        let pass = pass([500.0, 1200.0], [40.0, 70.0], &mut dice);
        let middle = 0.5 * pass.seconds;
        let telescope = TelescopeOptions::default().with(|o| {
            (o.axes, o.seed) = (axes, seed);
            o.clouds_s = vec![[60.0 + middle, 65.0 + middle].into()];
        });
        let went = follow(&pass, [1.2, -20.0], telescope, TrackOptions::default());
        let state_at = |s: f64| went.steps.iter().find(|step| step.time_s > s).unwrap().state;
        assert_eq!(state_at(middle - 1.0), TrackState::Locked);
        assert_eq!(state_at(middle + 4.0), TrackState::Coasting);
        assert_eq!(state_at(middle + 8.0), TrackState::Locked, "{axes:?}");
        let after = went.rms(60.0 + middle + 8.0, 60.0 + pass.seconds);
        assert!(after < 5.0, "{axes:?} {after}");
    }
}

/// Truth: as above. A pass that is brighter stars' neighbour all along: the telescope never leaves the target for one.
#[test]
fn stars_are_not_followed() {
    for seed in 10..13 {
        let mut dice = Dice(seed);
        let pass = pass([500.0, 1500.0], [30.0, 70.0], &mut dice);
        let telescope = TelescopeOptions::default().with(|o| {
            o.seed = seed;
            o.stars = (10.0, 4.0);
        });
        let went = follow(&pass, [-1.5, 25.0], telescope, TrackOptions::default());
        assert!(went.acquired_s.is_some_and(|s| s < 5.0), "{:?}", went.acquired_s);
        let worst = went.truth.iter().filter(|row| row.time_s > 75.0).map(|row| row.off_arcsec);
        let worst = worst.fold(0.0, f64::max);
        assert!(worst < 60.0, "{seed}: {worst}");
    }
}

/// Truth: the virtual telescope's own. A target that hardly moves against the ground, 24 h, 12 h and 48 h orbits, off its prediction by half a minute of arc: no other time of its path is
/// where it is. It is followed as one that moves: the rms of fast passes (`campaign_telescope`) is 2″.
#[test]
fn a_target_that_stands_over_the_earth_is_followed() {
    let from = parse_utc("2026-10-27T00:00:00Z").unwrap();
    for (seed, height_km, axes) in [
        (31, 35_786.0, MountAxes::Horizontal),
        (32, 35_786.0, MountAxes::Equatorial),
        (33, 20_200.0, MountAxes::Horizontal),
        (34, 60_600.0, MountAxes::Equatorial),
    ] {
        let mut dice = Dice(seed);
        let conditions = Conditions { min_altitude_deg: 25.0, sun_below_deg: 90.0 };
        let window = (from, from + 6.0 * Unit::Hour);
        let (horizon, earth) = (Horizon::Flat(0.0), EarthOrientation::embedded());
        let search = Search::new(&site(), &horizon, window, conditions, earth).unwrap();
        let pass = loop {
            let orbit = orbit(height_km, 0.05, &mut dice);
            let found = search.passes(&orbit).passes;
            if let Some(pass) = found.iter().find(|pass| pass.span.seconds() > 1200.0) {
                break Pass { orbit, from: pass.span.from, seconds: 1200.0 };
            }
        };
        let telescope = TelescopeOptions::default().with(|o| (o.axes, o.seed) = (axes, seed));
        let went = follow(&pass, [0.3, 30.0], telescope, TrackOptions::default());
        println!(
            "{height_km} km, {axes:?}: {:?} s, {:.2}\u{2033}",
            went.acquired_s, went.rms_arcsec
        );
        assert!(went.acquired_s.is_some_and(|s| s < 10.0), "{:?}", went.acquired_s);
        assert!(went.rms_arcsec < 5.0, "{}", went.rms_arcsec);
        let locked = went.steps.iter().filter(|step| step.state == TrackState::Locked).count();
        assert!(locked > went.steps.len() * 8 / 10, "{locked} of {}", went.steps.len());
    }
}

/// Truth: geometry (design figures): a pass over the zenith asks an azimuth axis for more than it has; it runs ahead and meets the target again, and less than a minute is lost at 6°/s.
#[test]
fn a_zenith_pass_goes_by_the_keyhole() {
    let mut dice = Dice(77);
    let pass = pass([450.0, 600.0], [86.5, 89.0], &mut dice);
    let telescope = TelescopeOptions::default().with(|o| o.fastest_deg_s = 6.0);
    let went = follow(&pass, [0.5, 10.0], telescope, TrackOptions::default());
    let off = |row: &&TruthRow| row.off_arcsec > 60.0 && row.time_s > 75.0;
    let lost_s = went.truth.iter().filter(off).count() as f64 * 0.1;
    println!("lost for {lost_s:.1} s");
    assert!(lost_s < 60.0, "{lost_s}");
    let end = went.rms(60.0 + pass.seconds - 60.0, 60.0 + pass.seconds);
    assert!(end < 5.0, "{end}");
}

/// Truth: the virtual telescope's own. Elements that are 900″ off across the track, beyond what is searched: the target is never found.
/// A person clicks on it in a frame that is two seconds old, and it is followed as any other, 3 s later.
#[test]
fn a_click_says_which_light_is_the_target() {
    for (seed, axes) in [(21, MountAxes::Horizontal), (22, MountAxes::Equatorial)] {
        let mut dice = Dice(seed);
        let pass = pass([600.0, 1200.0], [35.0, 65.0], &mut dice);
        let telescope = || {
            TelescopeOptions::default().with(|o| {
                (o.axes, o.seed) = (axes, seed);
                o.stars = (0.0, 1.0);
            })
        };
        let off = [0.8, 900.0];
        let alone = follow(&pass, off, telescope(), TrackOptions::default());
        assert!(alone.rms(60.0 + 40.0, 60.0 + pass.seconds) > 300.0, "found alone");
        let (mut seen, mut clicked) = (Vec::new(), None);
        let went = follow_by_hand(
            &pass,
            off,
            telescope(),
            TrackOptions::default(),
            &mut |step, frame, orders| {
                if let Some(frame) = frame
                    && let [spot] = frame.spots.as_slice()
                {
                    let (middle, offset_arcsec) = (frame.middle, spot.offset_arcsec);
                    seen.push((step.time_s, Order::Lock { middle, offset_arcsec }));
                }
                // People take a moment to click.
                if clicked.is_none() && step.time_s > 20.0 {
                    let old = seen.iter().rev().find(|(at, _)| *at < step.time_s - 2.0);
                    if let Some((_, order)) = old {
                        assert!(orders.give(*order));
                        clicked = Some(step.time_s);
                    }
                }
                assert_eq!(orders.refusals(), Vec::<String>::new());
            },
        );
        let at = clicked.unwrap();
        let after = went.rms(60.0 + at + 6.0, 60.0 + pass.seconds);
        println!("{axes:?}: clicked at {at:.1} s, rms {after:.2}″ afterwards");
        assert!(after < 5.0, "{axes:?} {after}");
    }
}

/// Truth: the virtual telescope's own: a German mount whose tube and camera hang upside down on one side, and whose switches stop it 10° past the meridian. Passes that cross the meridian
/// above the pole: it is turned over once, before the switches; less than a minute is lost (30 s of half a turn at 6 °/s, its begin and end, and the way to the target); after it the target is
/// followed as before it, and stands at the place of the frame where a person wanted it, upside down or not.
#[test]
fn a_german_mount_turns_over_within_a_pass() {
    let went: Vec<_> = (40..70_u64)
        .into_par_iter()
        .filter_map(|seed| {
            let mut dice = Dice(seed);
            let pass = pass([800.0, 1500.0], [35.0, 65.0], &mut dice);
            let span = (pass.from, pass.seconds);
            let (earth, axes) = (EarthOrientation::embedded(), MountAxes::Equatorial);
            let path = TargetPath::new(&pass.orbit, &site(), earth, span, axes, false).unwrap();
            let hour_angle = |s: f64| angles(path.at(s).direction)[0];
            // From one side of the meridian to the other above the pole, and not near the ends of the pass.
            let crosses = (0..pass.seconds as usize).map(|i| i as f64).find(|s| {
                let (a, b) = (hour_angle(*s), hour_angle(s + 1.0));
                a * b <= 0.0 && (a - b).abs() < 90.0
            })?;
            if crosses < 60.0 || crosses > pass.seconds - 100.0 {
                return None;
            }
            let past_deg = if seed % 2 == 0 { 0.0 } else { 8.0 };
            let mut track = TrackOptions::default();
            track.past_meridian_deg = past_deg;
            let telescope = TelescopeOptions::default().with(|o| {
                (o.axes, o.seed, o.fastest_deg_s) = (axes, seed, 6.0);
                o.past_meridian_deg = Some(10.0);
            });
            let (mut kept, mut seen) = (false, Vec::new());
            let went =
                follow_by_hand(&pass, [0.5, 10.0], telescope, track, &mut |step, frame, orders| {
                    if !kept && step.time_s > 15.0 {
                        kept = orders.give(Order::Keep { offset_arcsec: [90.0, -120.0].into() });
                    }
                    if let (Some(frame), TrackState::Locked) = (frame, step.state)
                        && let [spot] = frame.spots.as_slice()
                    {
                        seen.push((step.time_s, step.pier, spot.offset_arcsec));
                    }
                });
            Some((seed, crosses, pass.seconds, went, seen))
        })
        .collect();
    assert!(went.len() >= 5, "{} passes", went.len());
    let mut compared = 0;
    for (seed, crosses, seconds, went, seen) in went {
        assert!(!went.hit_end, "{seed}: it ran into its end");
        let sides: Vec<_> = went.steps.iter().filter_map(|step| step.pier).collect();
        let turns = sides.windows(2).filter(|two| two[0] != two[1]).count();
        // The slew to the begin of the pass may be one, too.
        let follows = |step: &&TrackStep| step.time_s > crosses - 30.0;
        let late: Vec<_> = went.steps.iter().filter(follows).collect();
        let turned: Vec<f64> = late
            .windows(2)
            .filter(|two| two[0].pier != two[1].pier)
            .map(|two| two[1].time_s)
            .collect();
        let [turned_s] = turned[..] else { panic!("{seed}: turned over at {turned:?} s") };
        assert!(turns <= 2, "{seed}: {turns}");
        let lost = went.truth.iter().filter(|row| {
            (60.0 + 25.0..60.0 + seconds).contains(&row.time_s) && row.off_arcsec > 200.0
        });
        let lost_s = lost.count() as f64 * 0.1;
        println!("{seed}: crosses at {crosses:.0} s of {seconds:.0} s, lost {lost_s:.1} s");
        assert!(lost_s < 60.0, "{seed}: {lost_s}");
        for (name, from_s, to_s) in
            [("before", 25.0, turned_s - 40.0), ("after", turned_s + 30.0, seconds)]
        {
            let rows = seen.iter().filter(|(at, ..)| (from_s..to_s).contains(at));
            let rows: Vec<_> = rows.map(|(_, side, at)| (*side, *at)).collect();
            if to_s - from_s < 30.0 {
                continue;
            }
            compared += 1;
            assert!(rows.len() > 100, "{seed} {name}: {} frames", rows.len());
            let rms = |i: usize, at: f64| {
                let sum: f64 = rows.iter().map(|(_, seen)| (seen[i] - at).powi(2)).sum();
                (sum / rows.len() as f64).sqrt()
            };
            let (x, y) = (rms(0, 90.0), rms(1, -120.0));
            assert!(x.hypot(y) < 5.0, "{seed} {name}: {x:.1}″ {y:.1}″ {:?}", rows.last());
        }
    }
    assert!(compared >= 10, "{compared}");
}

/// Truth: the virtual telescope's own, and Pythagoras: a target that is kept 90″ and −120″ from the finder's middle is 150″ from the axis, within 5″ as when it is kept there; after a jog of as
/// much the other way it is in the middle again. A frame from before the last minute is refused.
#[test]
fn a_target_is_kept_where_a_person_wants_it() {
    for (seed, axes) in [(31, MountAxes::Horizontal), (32, MountAxes::Equatorial)] {
        let mut dice = Dice(seed);
        let pass = pass([800.0, 1200.0], [40.0, 65.0], &mut dice);
        let from = pass.from;
        let telescope = TelescopeOptions::default().with(|o| (o.axes, o.seed) = (axes, seed));
        let (mut kept, mut jogged, mut refused) = (false, false, Vec::new());
        let went = follow_by_hand(
            &pass,
            [0.5, 10.0],
            telescope,
            TrackOptions::default(),
            &mut |step, _, orders| {
                if !kept && step.time_s > 30.0 {
                    kept = orders.give(Order::Keep { offset_arcsec: [90.0, -120.0].into() });
                }
                if !jogged && step.time_s > 90.0 {
                    jogged = orders.give(Order::Jog { arcsec: [90.0, -120.0].into() });
                    let middle = from - 3600.0 * Unit::Second;
                    assert!(orders.give(Order::Lock { middle, offset_arcsec: [0.0; 2].into() }));
                }
                refused.extend(orders.refusals());
            },
        );
        let off = |a: f64, b: f64| {
            let rows = went.truth.iter().filter(|r| (60.0 + a..60.0 + b).contains(&r.time_s));
            let off: Vec<f64> = rows.map(|row| row.off_arcsec).collect();
            (quantile(off.clone(), 0.0), quantile(off, 1.0))
        };
        let (least, most) = off(40.0, 89.0);
        assert!(least > 145.0 && most < 155.0, "{axes:?}: {least} to {most}");
        let (_, most) = off(100.0, 140.0);
        assert!(most < 6.0, "{axes:?}: {most}");
        assert!(refused.len() == 1 && refused[0].contains("take a newer frame"), "{refused:?}");
    }
}

/// Truth: in words. Looking down by 1.5° again and again: the second time is refused, and the target is followed on, so that the telescope ends no lower than that below it.
#[test]
fn a_jog_does_not_lead_far_from_the_target() {
    let mut dice = Dice(41);
    let pass = pass([800.0, 1200.0], [40.0, 65.0], &mut dice);
    let telescope = TelescopeOptions::default().with(|o| o.seed = 41);
    let (mut refused, mut jogs, mut lowest, mut next_s) = (Vec::new(), 0, f64::INFINITY, 30.0);
    let options = TrackOptions::default();
    let went = follow_by_hand(&pass, [0.5, 10.0], telescope, options, &mut |step, _, orders| {
        refused.extend(orders.refusals());
        lowest = step.altitude_deg.min(lowest);
        if step.time_s > next_s && refused.is_empty() {
            next_s = step.time_s + 5.0;
            jogs += 1;
            assert!(orders.give(Order::Jog { arcsec: [0.0, -5400.0].into() }));
        }
    });
    assert!(jogs == 2 && refused.len() == 1, "{jogs} jogs, {refused:?}");
    assert!(refused[0].contains("2° at most"), "{refused:?}");
    // The pass is above 15°.
    assert!(lowest > 15.0 - 1.6, "{lowest}");
    let after = went.truth.iter().filter(|row| row.time_s > 60.0 + 50.0);
    let off: Vec<f64> = after.map(|row| row.off_arcsec).collect();
    assert!((quantile(off, 0.5) - 5400.0).abs() < 10.0);
}

/// Truth: the virtual telescope's own, and geometry: the one pass of the campaign's 200 that an equatorial mount meets 1.4° from the pole of the sky. Its first axis would have to turn by 14.6 °/s, does 9.8 °/s, and is beside the target by up to
/// 3,100″ for 12.5 s, as its plan says before; then it follows as on any other pass.
#[test]
fn a_pass_by_the_pole_of_the_sky_is_lost_for_as_long_as_its_plan_says() {
    const SEED: u64 = 73;
    let mut dice = Dice(SEED * 7919 + 1);
    let pass = pass([400.0, 2000.0], [20.0, 75.0], &mut dice);
    let off = [dice.between(-2.0, 2.0), dice.between(-30.0, 30.0)];
    let made = TelescopeOptions::default().with(|o| {
        (o.axes, o.seed) = (MountAxes::Equatorial, SEED);
    });
    let went = follow(&pass, off, made, TrackOptions::default());
    let keyhole = went.keyhole.unwrap();
    assert!((10.0..15.0).contains(&keyhole.lost_s()), "{keyhole:?}");
    assert!(went.rms_arcsec < 5.0, "{}", went.rms_arcsec);
    let lost = went.truth.iter().filter(|row| row.time_s > 75.0 && row.off_arcsec > 60.0);
    let lost_s = 0.1 * lost.count() as f64;
    assert!(lost_s < keyhole.lost_s() + 3.0, "{lost_s} {keyhole:?}");
}
