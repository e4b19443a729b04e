//! Nights that are made up: geometry of passes, and counts drawn by the observatory's laws.

use hifitime::{Epoch, Unit};
use ndarray::Array2;
use rand_xoshiro::Xoshiro256PlusPlus;
use rand_xoshiro::rand_core::SeedableRng as _;
use sunglint_calibration::stars::scintillation::Aperture;
use sunglint_ephemeris::orbit::{Orbit, TleOrbit, tle};
use sunglint_inference::solver::Data;
use sunglint_radiometry::station::{Detector, Station};
use sunglint_simulator::light::engine::Switch;
use sunglint_simulator::pass::{Overrides, Pass, PassFile, Place, Study};
use sunglint_virtual::observatory::events;
use sunglint_virtual::observatory::wander::Wander;

/// Young's coefficient of the made-up site.
pub const COEFFICIENT: f64 = 1.5;

fn checksum(line: &str) -> u32 {
    line.chars().map(|c| if c == '-' { 1 } else { c.to_digit(10).unwrap_or(0) }).sum::<u32>() % 10
}

/// A circular orbit: revolutions a day, inclination and node, degrees; on 2020-11-18 at noon it crosses the equator northwards.
pub fn orbit(revolutions: f64, inclination_deg: f64, node_deg: f64) -> Orbit {
    let first = "1 99004U 20001A   20323.50000000  .00000000  00000-0  10000-4 0    1";
    let second = format!(
        "2 99004 {inclination_deg:8.4} {node_deg:8.4} 0000100   0.0000   0.0000 {revolutions:11.8}    1"
    );
    let text = format!("{first}{}\n{second}{}", checksum(first), checksum(&second));
    let (good, bad) = tle::parse_lenient("made up", &text);
    assert!(bad.is_empty(), "{text}: {bad:?}");
    TleOrbit::new(good[0].clone()).unwrap().into()
}

/// A pass of a target over the built-in station; no time is looked at yet.
pub fn scene(target: &str, orbit: Orbit) -> Pass {
    let text = format!(
        "target.{target}\norbit.lines = [\"1 25544U 98067A   08264.51782528 -.00002182  00000-0 -11606-4 0  2927\", \
         \"2 25544  51.6416 247.4627 0006703 130.5360 325.0288 15.72125391563537\"]\nstation.name = \"ufo\"\n\
         times.from = 2020-11-18T16:00:00Z\ntolerance = 0.01\n"
    );
    let mut pass =
        PassFile::parse("scene.toml", &text).unwrap().resolve(Overrides::default()).unwrap();
    pass.orbit = orbit;
    // Of what is drawn from the engine no effect matters that costs light paths; closed forms know none of them.
    pass.effects.inter_reflection = Switch::Off;
    pass.effects.earthshine = Switch::Off;
    pass.effects.solar_disc = Switch::Off;
    pass
}

/// Sets the times of a pass.
pub fn over(pass: &Pass, from: Epoch, samples: usize, step_s: f64, exposure_s: f64) -> Pass {
    let times = (0..samples).map(|i| from + (i as f64 * step_s) * Unit::Second).collect();
    Pass { times, exposure_s: vec![exposure_s; samples], ..pass.clone() }
}

/// The stretches of three days in which the target stands 25° high in sunlight, with the Sun 8° below the horizon: first moment, length in s.
pub fn visible(pass: &Pass) -> Vec<(Epoch, f64)> {
    let noon = Epoch::from_gregorian_utc(2020, 11, 18, 12, 0, 0, 0);
    let study = Study::new(over(pass, noon, 3 * 4320, 20.0, 1.0)).unwrap();
    let good = |p: &Place| {
        p.apparent_zenith_deg.is_some_and(|z| z < 65.0)
            && p.sunlit == 1.0
            && p.sun_altitude_deg < -8.0
    };
    let mut found: Vec<(Epoch, f64)> = Vec::new();
    let mut inside = false;
    for place in study.places() {
        match (good(place), inside) {
            (true, false) => found.push((place.geometry.epoch, 0.0)),
            (true, true) => found.last_mut().unwrap().1 += 20.0,
            _ => {}
        }
        inside = good(place);
    }
    found.retain(|(_, s)| *s >= 120.0);
    found
}

/// Disturbances of a pass.
#[derive(Clone, Copy, Default)]
pub struct Weather {
    /// A tenth of the samples fall out, in one gap.
    pub gap: bool,
    /// A tenth of the time a cloud takes half of the light and more.
    pub cloud: bool,
}

/// Counts of a pass, drawn: photons, dark counts and scintillation common to the channels; σ as a reduction states it, from the counts themselves.
pub fn measured(
    seed: u64,
    pass: &Pass,
    places: &[Place],
    truth: &Array2<f64>,
    weather: Weather,
) -> Data {
    let station = &pass.station;
    let aperture = aperture(station);
    let n = places.len();
    let mut twinkle = Twinkle::new(seed);
    let (mut rate, mut sigma) = (truth.clone(), truth.clone());
    let mut common = Vec::with_capacity(n);
    for (i, place) in places.iter().enumerate() {
        let t = pass.exposure_s[i];
        let zenith = place.apparent_zenith_deg.unwrap().to_radians();
        let variance = aperture.variance(t, zenith.cos().recip());
        common.push(variance);
        let cloudy = weather.cloud && (n / 3..n / 3 + n / 10).contains(&i);
        let sky = (1.0 + variance.sqrt() * twinkle.normal()) * if cloudy { 0.45 } else { 1.0 };
        for (c, channel) in station.channels.iter().enumerate() {
            // Counts, or electrons, for a rate of 1 Hz; and what is there besides.
            let (per_hz, dark_hz) = match &channel.detector {
                Detector::Counter(counter) => {
                    (1.0 / channel.typical_kappa.unwrap(), counter.dark_rate_hz)
                }
                Detector::CameraPlane(_) => {
                    let gain = station.camera.as_ref().unwrap().gain_e_per_adu;
                    (gain / channel.typical_kappa.unwrap(), 500.0)
                }
            };
            let detector = events::Detector { dark_rate_hz: dark_hz, ..events::Detector::IDEAL };
            let span = 0..(t * 1e12) as i64;
            let arriving = truth[[i, c]] * sky * per_hz;
            let own = seed * 64 + c as u64;
            let counts = detector.counts(own, i as i64, span, &[arriving]) as f64;
            rate[[i, c]] = (counts / t - dark_hz) / per_hz;
            sigma[[i, c]] = counts.max(1.0).sqrt() / t / per_hz;
        }
    }
    let mut data = Data::new(format!("seed {seed}"), rate, sigma);
    data.common_variance = common;
    if weather.gap {
        for i in n / 2..n / 2 + n / 10 {
            data.used.row_mut(i).fill(false);
        }
    }
    data.follow_photons(&pass.exposure_s);
    data
}

pub fn aperture(station: &Station) -> Aperture {
    Aperture {
        diameter_m: station.telescope.primary_diameter_m,
        height_m: station.site.geodetic().height_m,
        coefficient: COEFFICIENT,
    }
}

/// Normal numbers, one after the other: the observatory's wandering quantity at moments far apart.
struct Twinkle {
    wander: Wander,
    at_s: f64,
}

impl Twinkle {
    fn new(seed: u64) -> Self {
        // Correlated over 1 ms, asked for every 0.1 s.
        Self { wander: Wander::new(seed, 1e-3), at_s: 0.0 }
    }

    fn normal(&mut self) -> f64 {
        self.at_s += 0.1;
        self.wander.at(self.at_s)
    }
}

/// A generator for draws of a test's own.
pub fn random(seed: u64) -> Xoshiro256PlusPlus {
    Xoshiro256PlusPlus::seed_from_u64(seed)
}
