//! Cost of the geometry of an epoch, and of its parts: 6,000 epochs should stay far below half a second on one core.

#![allow(clippy::unwrap_used, reason = "in helpers too, a failure should stop the run")]

use divan::{Bencher, black_box};
use glam::DVec3;
use hifitime::{Epoch, Unit};
use sunglint_ephemeris::geometry::Geometry;
use sunglint_ephemeris::orbit::eclipse::{Discs, EarthShape, contacts};
use sunglint_ephemeris::orbit::{Ephemeris, EphemerisRow, Orbit, tle};
use sunglint_formats::time::parse_utc;
use sunglint_radiometry::sky::{EarthOrientation, Geodetic, Observer, Site, SkyFrame, SkyFrames};

fn main() {
    divan::main();
}

const LOW: &str = "1 28057U 03049A   06177.78615833  .00000060  00000-0  35940-4 0  1836
2 28057  98.4283 247.6961 0000884  88.1964 271.9322 14.35478080140550
";
const MOLNIYA: &str = "1 21897U 92011A   06176.02341244 -.00001273  00000-0 -13525-3 0  3044
2 21897  62.1749 198.0096 7421690 253.0462  20.1561  2.01269994104880
";

fn orbit(text: &str) -> Orbit {
    tle::parse("bench", text).unwrap()[0].orbit().unwrap().into()
}

fn epoch() -> Epoch {
    parse_utc("2006-06-27T05:42:15.25Z").unwrap()
}

fn site() -> Site {
    Site::new(Geodetic { latitude_deg: 48.782389, longitude_deg: 9.196417, height_m: 399.0 })
        .unwrap()
}

fn observer() -> Observer {
    Observer::at(epoch(), &site(), EarthOrientation::embedded()).unwrap()
}

fn ephemeris() -> Orbit {
    let low = orbit(LOW);
    let rows: Vec<EphemerisRow> = (-60..=60)
        .map(|minute| {
            let epoch = epoch() + f64::from(minute) * Unit::Minute;
            let frame = SkyFrame::new(epoch, EarthOrientation::embedded()).unwrap();
            let state = low.state(epoch, &frame).unwrap();
            let velocity_m_s = Some(state.velocity_m_s);
            EphemerisRow { epoch, position_m: state.position_m, velocity_m_s }
        })
        .collect();
    Ephemeris::new("bench", &rows).unwrap().into()
}

#[divan::bench]
fn state_low(bencher: Bencher) {
    let (orbit, observer) = (orbit(LOW), observer());
    bencher.bench_local(|| orbit.state(black_box(epoch()), observer.frame()));
}

#[divan::bench]
fn state_molniya(bencher: Bencher) {
    let (orbit, observer) = (orbit(MOLNIYA), observer());
    bencher.bench_local(|| orbit.state(black_box(epoch()), observer.frame()));
}

#[divan::bench]
fn state_ephemeris(bencher: Bencher) {
    let (orbit, observer) = (ephemeris(), observer());
    bencher.bench_local(|| orbit.state(black_box(epoch()), observer.frame()));
}

#[divan::bench]
fn geometry_of_a_known_observer(bencher: Bencher) {
    let (orbit, observer) = (orbit(LOW), observer());
    bencher.bench_local(|| Geometry::at(black_box(&orbit), black_box(&observer)));
}

#[divan::bench]
fn observer_of_an_epoch(bencher: Bencher) {
    let site = site();
    bencher.bench_local(|| Observer::at(black_box(epoch()), &site, EarthOrientation::embedded()));
}

#[divan::bench(sample_count = 10)]
fn pass_of_6000_epochs(bencher: Bencher) {
    let (orbit, site) = (orbit(LOW), site());
    bencher.bench_local(|| {
        (0..6000)
            .map(|i| {
                let epoch = epoch() + 0.1 * f64::from(i) * Unit::Second;
                let observer = Observer::at(epoch, &site, EarthOrientation::embedded()).unwrap();
                Geometry::at(&orbit, &observer).unwrap().range_m
            })
            .sum::<f64>()
    });
}

#[divan::bench(sample_count = 10)]
fn pass_of_6000_epochs_with_shared_frames(bencher: Bencher) {
    let (orbit, site) = (orbit(LOW), site());
    let earth = EarthOrientation::embedded();
    bencher.bench_local(|| {
        let frames = SkyFrames::over(epoch(), epoch() + 10.0 * Unit::Minute, earth).unwrap();
        (0..6000)
            .map(|i| {
                let epoch = epoch() + 0.1 * f64::from(i) * Unit::Second;
                let observer = Observer::new(frames.at(epoch).unwrap(), &site);
                Geometry::at(&orbit, &observer).unwrap().range_m
            })
            .sum::<f64>()
    });
}

#[divan::bench]
fn visible_fraction_in_the_penumbra(bencher: Bencher) {
    let observer = observer();
    let sun = observer.frame().sun();
    let side = sun.direction_gcrs.cross(DVec3::Z).normalize();
    let position = side * 6.378e6 - sun.direction_gcrs * 2.5e6;
    bencher.bench_local(|| {
        Discs::at(black_box(position), black_box(&sun), EarthShape::default()).visible_fraction()
    });
}

#[divan::bench(sample_count = 10)]
fn contacts_of_a_day(bencher: Bencher) {
    let orbit = orbit(LOW);
    let to = epoch() + 1.0 * Unit::Day;
    let earth = EarthOrientation::embedded();
    bencher.bench_local(|| contacts(&orbit, epoch(), to, earth, EarthShape::default()));
}

#[divan::bench]
fn parse_1000_sets(bencher: Bencher) {
    let text = LOW.repeat(1000);
    bencher.bench_local(|| tle::parse_lenient("bench", black_box(&text)).0.len());
}
