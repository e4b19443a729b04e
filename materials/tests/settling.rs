//! How long readings take to settle, on a meter with a known lag.
#![allow(clippy::unwrap_used, reason = "helper functions of tests")]

use rand::{RngExt as _, SeedableRng as _};
use rand_xoshiro::Xoshiro256PlusPlus;
use std::sync::Arc;
use std::time::Duration;
use sunglint_drivers::clock::{Cancel, Clock as _, Deadline, DeviceClock, VirtualClock};
use sunglint_drivers::device::{Device, DeviceError, Identity, Power, PowerMeter, Setting};
use sunglint_materials::log::RecordError;
use sunglint_materials::reading::{Keep, Reader, Seen, State};
use sunglint_materials::settling::Settling;

/// A meter whose readings follow the light exponentially.
struct Lagging {
    light_w: f64,
    shown_w: f64,
    at: Duration,
    constant_s: f64,
    noise: f64,
    random: Xoshiro256PlusPlus,
}

impl Lagging {
    fn follow(&mut self, now: Duration) {
        let passed = (now - self.at).as_secs_f64();
        let part = if self.constant_s > 0.0 { (-passed / self.constant_s).exp() } else { 0.0 };
        self.shown_w = self.light_w + (self.shown_w - self.light_w) * part;
        self.at = now;
    }
}

impl Device for Lagging {
    fn identity(&mut self, _: &Deadline) -> Result<Identity, DeviceError> {
        unreachable!("nobody asks")
    }

    fn settings(&mut self, _: &Deadline) -> Result<Vec<Setting>, DeviceError> {
        Ok(Vec::new())
    }
}

impl PowerMeter for Lagging {
    fn power(&mut self, deadline: &Deadline) -> Result<Power, DeviceError> {
        let wait = deadline.sleep(Duration::from_millis(150));
        wait.map_err(|expired| DeviceError::expired("meter", "reading", expired))?;
        self.follow(deadline.now());
        let sum: f64 = (0..12).map(|_| self.random.random_range(0.0..1.0)).sum();
        Ok(Power::Watts(self.shown_w * (1.0 + self.noise * (sum - 6.0))))
    }

    fn set_wavelength_nm(&mut self, nm: f64, _: &Deadline) -> Result<f64, DeviceError> {
        Ok(nm)
    }

    fn ranges(&mut self, _: &Deadline) -> Result<Vec<String>, DeviceError> {
        Ok(Vec::new())
    }

    fn set_range(&mut self, range: &str, _: &Deadline) -> Result<String, DeviceError> {
        Ok(range.to_owned())
    }

    fn zero(&mut self, _: &Deadline) -> Result<(), DeviceError> {
        Ok(())
    }
}

struct Kept {
    clock: DeviceClock,
    lines: Vec<(f64, f64, State)>,
    powers: Vec<f64>,
    events: Vec<String>,
}

impl Keep for Kept {
    fn reading(&mut self, power_w: f64, state: State, _: &str) -> Result<(), RecordError> {
        self.lines.push((self.clock.clock.now().as_secs_f64(), power_w, state));
        if state == State::Read {
            self.powers.push(power_w);
        }
        Ok(())
    }

    fn sync(&mut self) -> Result<(), RecordError> {
        Ok(())
    }

    fn event(&mut self, text: &str) -> Result<(), RecordError> {
        self.events.push(text.to_owned());
        Ok(())
    }
}

/// A scan over a lobe and back, of 120 places whose light goes over a factor of 300. Gives the wait that was found (s, that of the plan where none was), the largest error of the last 60 places
/// over their steps, and what was said.
fn scan(constant_s: f64, noise: f64, settle_s: f64, seed: u64) -> (f64, f64, Vec<String>) {
    let clock = Arc::new(VirtualClock::new());
    let device_clock = DeviceClock { clock: clock.clone(), zero_utc: None };
    let cancel = Cancel::new();
    let random = Xoshiro256PlusPlus::seed_from_u64(seed);
    let (shown_w, at) = (0.0, Duration::ZERO);
    let mut meter = Lagging { light_w: 0.0, shown_w, at, constant_s, noise, random };
    let (mut settling, mut worst, mut events) = (Settling::default(), 0.0_f64, Vec::new());
    let mut lines = Vec::new();
    for place in 0..120 {
        // The stage has arrived.
        meter.follow(clock.now());
        let before_w = meter.light_w;
        let x = f64::from(place % 40 - 20) / 6.0;
        meter.light_w = 1e-6 * ((-x * x).exp() + 1.0 / 300.0);
        let light_w = meter.light_w;
        let mut kept = Kept {
            clock: device_clock.clone(),
            lines: Vec::new(),
            powers: Vec::new(),
            events: Vec::new(),
        };
        let mut reader = Reader {
            meter: &mut meter,
            clock: &device_clock,
            cancel: &cancel,
            settle_s,
            timeout_s: 10.0,
            readings: 5,
            interval_s: 0.0,
            settling: &mut settling,
        };
        reader.take("at a place", &mut kept).unwrap();
        events.append(&mut kept.events);
        let line = |(time_s, power_w, state): &(f64, f64, State)| Seen {
            key: place,
            angle_deg: x,
            time_s: *time_s,
            power_w: *power_w,
            state: *state,
            range: "",
        };
        lines.extend(kept.lines.iter().map(line));
        let mean_w = kept.powers.iter().sum::<f64>() / kept.powers.len() as f64;
        if place >= 60 {
            worst = worst.max((mean_w - light_w).abs() / (before_w - light_w).abs().max(0.03e-6));
        }
    }
    // A run that goes on after this one, or after half of it, whose last place was broken off, waits as long.
    for lines in [&lines[..], &lines[..lines.len() / 2 - 3]] {
        let again = Settling::of_run(lines.iter().copied(), settle_s, |_, _| true);
        assert_eq!(again.wait_s(settle_s), settling.wait_s(settle_s), "{} lines", lines.len());
    }
    (settling.wait_s(settle_s), worst, events)
}

/// Truth: a lag of first order: exp(−t/τ) of a step is left, a thousandth after τ ln 1000. Waits that are too short are found from the readings and lengthened to that; afterwards the error that is left is below a thousandth
/// of the step and the noise. Tolerance of the wait 15 %: noise of 0.1 %, and a step that is told by readings which still run.
#[test]
fn a_wait_that_is_too_short_is_lengthened() {
    for (constant_s, settle_s) in [(0.3, 0.5), (0.5, 0.5), (0.2, 0.2), (1.0, 1.5)] {
        let truth_s = constant_s * 1000_f64.ln();
        let (wait_s, worst, events) = scan(constant_s, 0.0, settle_s, 1);
        // The first reading comes 0.15 s after the wait.
        assert!(((wait_s + 0.15) / truth_s - 1.0).abs() < 0.1, "{wait_s} {truth_s} {events:?}");
        assert!(worst < 1.2e-3, "{worst} {events:?}");
        let (wait_s, _, events) = scan(constant_s, 1e-3, settle_s, 2);
        assert!(((wait_s + 0.15) / truth_s - 1.0).abs() < 0.15, "{wait_s} {truth_s} {events:?}");
        assert!(events[0].contains("settle_s") && events[0].contains("of a step"), "{events:?}");
    }
}

/// Truth: a meter without a lag, and one that has settled: nothing is found in a hundred scans, whatever the noise.
#[test]
fn nothing_is_found_where_readings_have_settled() {
    for seed in 0..100 {
        let noise = [0.0, 1e-4, 1e-3, 5e-3, 2e-2][seed as usize % 5];
        let constant_s = [0.0, 0.08][seed as usize / 5 % 2];
        let (wait_s, _, events) = scan(constant_s, noise, 0.7, seed);
        assert!(events.is_empty() && wait_s == 0.7, "{seed}: {events:?}");
    }
}
