//! Meters that measure by themselves and repeat their last value: no copy is handed on as a reading. The simulated meter knows which measurement each answer told.
#![allow(clippy::unwrap_used, reason = "helper functions of tests")]

use rand::{RngExt as _, SeedableRng as _};
use rand_xoshiro::Xoshiro256PlusPlus;
use std::sync::{Arc, Mutex};
use std::time::Duration;
use sunglint_drivers::clock::{Clock as _, Deadline, VirtualClock};
use sunglint_drivers::device::{Power, PowerMeter as _, Repeats, Update};
use sunglint_drivers::ophir::{Link, LinkSettings, Meter, MeterSettings};
use sunglint_drivers::simulated::ophir::{Measured, Ophir, OphirSettings};
use sunglint_drivers::simulated::{InMemory, PowerSource};
use sunglint_drivers::transport::{Bytes, TransportError};
use sunglint_testkit::Campaign;

/// When the meter was asked for its power, and which measurement it told.
type Told = Arc<Mutex<Vec<(Duration, Measured)>>>;

/// A line to the meter that writes down what is told.
struct Watched {
    line: InMemory<Ophir>,
    told: Told,
}

impl Bytes for Watched {
    fn send(&mut self, bytes: &[u8], deadline: &Deadline) -> Result<(), TransportError> {
        self.line.send(bytes, deadline)?;
        if bytes.starts_with(b"$SP") {
            self.told.lock().unwrap().push((deadline.now(), self.line.device.told()));
        }
        Ok(())
    }

    fn receive(&mut self, buffer: &mut [u8], deadline: &Deadline) -> Result<usize, TransportError> {
        self.line.receive(buffer, deadline)
    }

    fn discard(&mut self, deadline: &Deadline) -> Result<Vec<u8>, TransportError> {
        self.line.discard(deadline)
    }
}

/// Light of 1.3 mW, of which the meter shows four digits (a step is 1 µW), with Gaussian noise of so many steps that is another at each time.
fn light(noise: f64, seed: u64) -> impl PowerSource + 'static {
    move |at: Duration| {
        let at = u64::try_from(at.as_nanos()).unwrap();
        let mut random = Xoshiro256PlusPlus::seed_from_u64(seed ^ at.wrapping_mul(0x9E37_79B9));
        let sum: f64 = (0..12).map(|_| random.random_range(0.0..1.0)).sum();
        1.3e-3 + 1e-6 * noise * (sum - 6.0)
    }
}

/// How a meter is asked, and what it is.
struct Case {
    update: Duration,
    noise: f64,
    pause: Duration,
    settings: OphirSettings,
    seed: u64,
}

impl Case {
    fn new(seed: u64) -> Self {
        let mut random = Xoshiro256PlusPlus::seed_from_u64(seed);
        let mut pick = |of: &[f64]| of[random.random_range(0..of.len())];
        let update = pick(&[1.0, 3.0, 5.0, 10.0, 15.0, 15.0, 15.0, 30.0, 60.0]);
        let update = Duration::from_secs_f64(1.0 / update);
        let noise = pick(&[0.0, 0.3, 1.0, 2.0, 10.0, 30.0]);
        let pause = Duration::from_secs_f64(pick(&[0.0, 0.005, 0.02, 0.045, 0.067, 0.15, 0.4]));
        let latency = Duration::from_secs_f64(pick(&[0.002, 0.02, 0.06]));
        let update_jitter = pick(&[0.0, 0.05, 0.1, 0.2]);
        let settings = OphirSettings { update, update_jitter, latency, ..OphirSettings::default() };
        Self { update, noise, pause, settings, seed }
    }

    fn line(&self) -> Watched {
        let device = Ophir::new(self.settings.clone(), light(self.noise, self.seed));
        Watched { line: InMemory::new(device), told: Told::default() }
    }

    /// A pause between two readings, within a fifth.
    fn pause(&self, random: &mut Xoshiro256PlusPlus) -> Duration {
        self.pause.mul_f64(random.random_range(0.8..1.2))
    }
}

#[derive(Default)]
struct Found {
    copies: u32,
    /// Measured before the reading was asked for.
    older: u32,
    /// New measurements that were taken for copies.
    wrongly: u32,
    repeats: Repeats,
}

fn within(clock: &Arc<VirtualClock>) -> Deadline {
    Deadline::after(clock.clone(), Duration::from_secs(30))
}

/// Readings of the driver, of which the truth says which measurement each was.
fn read(case: &Case, readings: u32) -> Found {
    let clock = Arc::new(VirtualClock::new());
    let mut random = Xoshiro256PlusPlus::seed_from_u64(case.seed + 1_000_000);
    let line = case.line();
    let told = Arc::clone(&line.told);
    let (link, settings) = (LinkSettings::default(), MeterSettings::default());
    let mut meter = Meter::open(line, link, settings, &within(&clock)).unwrap();
    let (mut found, mut last) = (Found::default(), 0);
    for _ in 0..readings {
        clock.sleep(case.pause(&mut random));
        let begun = clock.now();
        let before = meter.repeats();
        told.lock().unwrap().clear();
        let reading = meter.power(&within(&clock)).unwrap();
        assert!(matches!(reading, Power::Watts(_)), "{reading:?}");
        let told = told.lock().unwrap();
        let (_, now) = *told.last().unwrap();
        found.copies += u32::from(now.number == last);
        found.older += u32::from(now.at < begun);
        if meter.repeats().discarded > before.discarded {
            let first = told[0].0 - begun >= before.period;
            found.wrongly += u32::from(!first || told[0].1.number != last);
        }
        last = now.number;
    }
    found.repeats = meter.repeats();
    found
}

/// Copies among as many bare questions.
fn bare(case: &Case, readings: u32) -> u32 {
    let clock = Arc::new(VirtualClock::new());
    let mut random = Xoshiro256PlusPlus::seed_from_u64(case.seed + 1_000_000);
    let line = case.line();
    let told = Arc::clone(&line.told);
    let mut link = Link::new(line, LinkSettings::default());
    for _ in 0..readings {
        clock.sleep(case.pause(&mut random));
        link.ask("$SP", &within(&clock)).unwrap();
    }
    let told = told.lock().unwrap();
    let copies = told.windows(2).filter(|pair| pair[0].1.number == pair[1].1.number);
    u32::try_from(copies.count()).unwrap()
}

/// Meters of 1 to 60 values a second whose times vary by up to 20 %, asked 200 times after pauses of 0 to 0.4 s. Truth: the number of the measurement that each answer told.
///
/// Light with noise of at least a step: less than 0.1 % of the readings are copies of the one before. The bare questions show what there was to find. Without noise, or with little, a meter of fewer than
/// 15 values a second cannot be told from one of 15: those copies are counted apart, and are equal to what they are copies of.
#[test]
fn campaign_stale_readings() {
    const READINGS: u32 = 200;
    let mut campaign = Campaign::start("stale_readings", 600);
    let (mut noisy, mut fine, mut dark) = (Found::default(), Found::default(), Found::default());
    let (mut readings, mut bare_copies, mut discarded) = ([0; 3], 0, 0);
    let mut worst = 0.0_f64;
    for seed in campaign.seeds() {
        let case = Case::new(seed);
        let found = read(&case, READINGS);
        let slow = case.update > Duration::from_millis(67);
        let (kind, sum) = match (case.noise >= 1.0, slow) {
            (true, _) => (0, &mut noisy),
            (_, false) => (1, &mut fine),
            (_, true) => (2, &mut dark),
        };
        sum.copies += found.copies;
        sum.older += found.older;
        sum.wrongly += found.wrongly;
        readings[kind] += READINGS;
        discarded += found.repeats.discarded;
        if kind == 0 {
            bare_copies += bare(&case, READINGS);
            // The line's own time of a question is the least that can be seen.
            let truth = case.update.max(case.settings.latency).as_secs_f64();
            let ratio = found.repeats.period.as_secs_f64() / truth;
            worst = worst.max((1.0 / ratio).max(1.0));
        }
    }
    eprintln!(
        "of {readings:?} (with noise; with little or none, of 15 values a second and more, and of fewer): copies {} {} {}, older than the question {} {} {}, discarded {discarded}, wrongly {} {} {}; bare {bare_copies}; period too short by {worst}",
        noisy.copies,
        fine.copies,
        dark.copies,
        noisy.older,
        fine.older,
        dark.older,
        noisy.wrongly,
        fine.wrongly,
        dark.wrongly,
    );
    assert!(f64::from(noisy.copies) < 1e-3 * f64::from(readings[0]), "{}", noisy.copies);
    assert!(f64::from(fine.copies) < 1e-3 * f64::from(readings[1]), "{}", fine.copies);
    campaign.largest("readings_with_noise", f64::from(readings[0]));
    campaign.largest("copies", f64::from(noisy.copies));
    campaign.largest("copies_of_bare_questions", f64::from(bare_copies));
    campaign.largest("measured_before_the_question", f64::from(noisy.older));
    campaign.largest("new_ones_discarded", f64::from(noisy.wrongly));
    campaign.largest("readings_with_little_noise", f64::from(readings[1]));
    campaign.largest("copies_with_little_noise", f64::from(fine.copies));
    campaign.largest("readings_with_little_noise_of_slow_meters", f64::from(readings[2]));
    campaign.largest("copies_with_little_noise_of_slow_meters", f64::from(dark.copies));
    campaign.largest("period_too_short_by", worst);
    campaign.finish();
}

/// A meter in light that does not change, which gets slower after a while, and whose light ends. Truth: the simulated meter's own measurements, and its clock.
#[test]
fn equal_readings_are_handed_on_and_a_slower_meter_is_noticed() {
    // Nothing but equal values: each is handed on after a time that the patience bounds.
    let case = Case { noise: 0.0, ..Case::new(0) };
    let settings = OphirSettings { update_jitter: 0.1, ..OphirSettings::default() };
    let case = Case { pause: Duration::ZERO, settings, ..case };
    let found = read(&case, 100);
    assert_eq!((found.copies, found.older), (0, 0));
    assert_eq!(
        (found.repeats.readings, found.repeats.equal, found.repeats.discarded),
        (100, 99, 0)
    );
    assert!(!found.repeats.is_measured, "{:?}", found.repeats);

    let clock = Arc::new(VirtualClock::new());
    let dark = Duration::from_secs(300);
    let mut noise = light(10.0, 1);
    let source = move |at: Duration| if at < dark { noise.power_w(at) } else { 0.0 };
    let device = Ophir::new(OphirSettings::default(), source);
    let (link, settings) = (LinkSettings::default(), MeterSettings::default());
    let mut meter = Meter::open(InMemory::new(device), link, settings, &within(&clock)).unwrap();
    let mut last = 0;
    let mut copies = |meter: &mut Meter<InMemory<Ophir>>, readings: u32| {
        let mut copies = 0;
        for _ in 0..readings {
            meter.power(&within(&clock)).unwrap();
            let now = meter.line().device.told().number;
            copies += u32::from(now == last);
            last = now;
        }
        copies
    };
    assert_eq!(copies(&mut meter, 40), 0);
    let ms = |meter: &Meter<InMemory<Ophir>>| meter.repeats().period.as_secs_f64() * 1e3;
    assert!((ms(&meter) / 66.7 - 1.0).abs() < 0.1, "{} ms", ms(&meter));
    // 2.5 values a second from now on: the first copy is one too many for a light with noise.
    meter.line_mut().device.set_update(Duration::from_millis(400));
    assert_eq!(copies(&mut meter, 40), 0);
    assert!((ms(&meter) / 400.0 - 1.0).abs() < 0.1, "{} ms", ms(&meter));
    assert!(clock.now() < dark, "{:?}", clock.now());
    clock.sleep(dark);
    let begun = clock.now();
    assert_eq!(copies(&mut meter, 100), 0);
    // 100 times 1.3 times 0.4 s, and 2 s for each of the first three equal ones.
    let took = (clock.now() - begun).as_secs_f64();
    assert!(took < 65.0, "{took}");
}

/// A time that is known is not measured. Truth: the meter's count of questions.
#[test]
fn a_known_time_is_taken() {
    let clock = Arc::new(VirtualClock::new());
    let case = Case::new(3);
    let line = case.line();
    let told = Arc::clone(&line.told);
    let settings =
        MeterSettings { update: Update::Known(Duration::from_secs(2)), ..MeterSettings::default() };
    let mut meter = Meter::open(line, LinkSettings::default(), settings, &within(&clock)).unwrap();
    for _ in 0..5 {
        let begun = clock.now();
        meter.power(&within(&clock)).unwrap();
        assert!(clock.now() - begun >= Duration::from_secs(2));
    }
    assert_eq!(told.lock().unwrap().len(), 5);
}
