//! Readings of a power meter at one place, safe from changes of its range and from a line that fails once.

use crate::log::RecordError;
use crate::retro::AtAngle;
use crate::settling::{Lag, Settling};
use std::collections::BTreeMap;
use std::time::Duration;
use sunglint_drivers::clock::{Cancel, Deadline, DeviceClock};
use sunglint_drivers::device::{Device, DeviceError, Power, PowerMeter, Value};

/// State of a reading.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum State {
    /// It has a power.
    Read,
    /// The meter was over its range.
    Over,
    /// The readings since the last such line are all of this place: they count.
    Kept,
    /// They do not count: the range changed between them.
    Again,
}

impl State {
    const ALL: [(Self, &'static str); 4] =
        [(Self::Read, "read"), (Self::Over, "over"), (Self::Kept, "kept"), (Self::Again, "again")];

    /// Name of the state in a table.
    #[must_use]
    pub fn name(self) -> &'static str {
        Self::ALL.iter().find(|(state, _)| *state == self).map_or("", |(_, name)| name)
    }

    /// The state of a name.
    #[must_use]
    pub fn named(name: &str) -> Option<Self> {
        Self::ALL.iter().find(|(_, known)| *known == name).map(|(state, _)| *state)
    }

    /// Whether it is a reading, not a word about readings.
    #[must_use]
    pub fn is_reading(self) -> bool {
        matches!(self, Self::Read | Self::Over)
    }
}

/// Keeper of the readings at a place.
pub trait Keep {
    /// Takes a reading (W; not a number where there is none), or a word about those before it.
    ///
    /// # Errors
    /// It cannot be written.
    fn reading(&mut self, power_w: f64, state: State, range: &str) -> Result<(), RecordError>;

    /// All readings so far are safe when it returns.
    ///
    /// # Errors
    /// The disk refuses.
    fn sync(&mut self) -> Result<(), RecordError>;

    /// Something happened that is worth a line of its own.
    ///
    /// # Errors
    /// It cannot be written.
    fn event(&mut self, text: &str) -> Result<(), RecordError>;
}

/// Why there are no readings.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ReadError {
    /// Somebody stopped it.
    #[error("stopped")]
    Stopped,
    /// The meter's error, the last time.
    #[error(transparent)]
    Meter(DeviceError),
    /// Readings that cannot be kept.
    #[error(transparent)]
    Record(#[from] RecordError),
}

/// Reads of the meter that may fail one after the other, and the wait between them.
pub(crate) const TRIES: u32 = 3;
pub(crate) const TRY_AGAIN: Duration = Duration::from_secs(1);
/// Times that a place is read anew because the range changed.
const RANGES: u32 = 5;

/// A meter with what it takes to read it.
pub struct Reader<'a> {
    /// The meter.
    pub meter: &'a mut dyn PowerMeter,
    /// The meter's clock.
    pub clock: &'a DeviceClock,
    /// Stops it.
    pub cancel: &'a Cancel,
    /// Wait before the first reading and after a change of range, s; longer where the readings were found to take longer.
    pub settle_s: f64,
    /// How long a reading may take, s.
    pub timeout_s: f64,
    /// Readings at a place.
    pub readings: u32,
    /// Wait between readings, s.
    pub interval_s: f64,
    /// How long readings take to settle, as the places of the run so far tell.
    pub settling: &'a mut Settling,
}

impl Reader<'_> {
    fn within(&self, s: f64) -> Deadline {
        Deadline::after(self.clock.clock.clone(), Duration::from_secs_f64(s))
            .with_cancel(self.cancel)
    }

    fn wait(&self, s: f64) -> Result<(), ReadError> {
        let wait = self.within(s + 1.0).sleep(Duration::from_secs_f64(s));
        wait.map_err(|_| ReadError::Stopped)
    }

    /// All readings at a place, which `place` names for people; anew after a change of range, until it stays.
    ///
    /// # Errors
    /// See [`ReadError`]; what was read until then is kept.
    pub fn take(&mut self, place: &str, keep: &mut dyn Keep) -> Result<(), ReadError> {
        let settle_s = self.settling.wait_s(self.settle_s);
        self.wait(settle_s)?;
        let mut range = self.range(place, keep)?;
        for take in 1..=RANGES {
            let mut read = Vec::new();
            for number in 0..self.readings {
                if number > 0 {
                    self.wait(self.interval_s)?;
                }
                let power = self.ask(place, keep, |meter, deadline| meter.power(deadline))?;
                let (power_w, state) = match power {
                    Power::Watts(power_w) => (power_w, State::Read),
                    _ => (f64::NAN, State::Over),
                };
                read.push((self.clock.clock.now().as_secs_f64(), power_w));
                keep.reading(power_w, state, &range)?;
            }
            let now = self.range(place, keep)?;
            let stays = now == range || take == RANGES;
            if stays && now != range {
                let text = format!(
                    "{place} the meter's range does not settle after {RANGES} times: choose a fixed one"
                );
                keep.event(&text)?;
            }
            let state = if stays { State::Kept } else { State::Again };
            keep.reading(f64::NAN, state, &range)?;
            keep.sync()?;
            if stays {
                // Readings after a change of range no longer follow the move.
                let lag = self.settling.place(&read, settle_s, take == 1);
                if let Some(lag) = lag {
                    keep.event(&lag_text(place, &lag, settle_s))?;
                }
                return Ok(());
            }
            range = now;
            self.wait(settle_s)?;
        }
        Ok(())
    }

    /// The range, as the meter names it; empty where it does not.
    fn range(&mut self, place: &str, keep: &mut dyn Keep) -> Result<String, ReadError> {
        let settings =
            self.ask(place, keep, |meter, deadline| Device::settings(meter, deadline))?;
        let range = settings.iter().find(|s| matches!(s.name, "range_w" | "range"));
        Ok(range.map_or(String::new(), |s| match &s.value {
            Value::Number(end_w) => format!("{end_w:e}W"),
            value => value.to_string(),
        }))
    }

    /// Asks the meter; one that fails is asked again a little later.
    fn ask<T>(
        &mut self,
        place: &str,
        keep: &mut dyn Keep,
        mut what: impl FnMut(&mut dyn PowerMeter, &Deadline) -> Result<T, DeviceError>,
    ) -> Result<T, ReadError> {
        for attempt in 1.. {
            let deadline = self.within(self.timeout_s);
            match what(&mut *self.meter, &deadline) {
                Ok(found) => return Ok(found),
                Err(DeviceError::Cancelled { .. }) => return Err(ReadError::Stopped),
                Err(error) if attempt >= TRIES => return Err(ReadError::Meter(error)),
                Err(error) => {
                    keep.event(&format!("{place}, try {attempt} of {TRIES}: {error}"))?;
                    self.wait(TRY_AGAIN.as_secs_f64())?;
                }
            }
        }
        Err(ReadError::Stopped)
    }
}

/// Says of a run that goes on that it waits longer than its plan says, where its readings asked for that.
///
/// # Errors
/// It cannot be written.
pub(crate) fn tell_wait(
    settling: &Settling,
    settle_s: f64,
    event: impl FnOnce(&str) -> Result<(), RecordError>,
) -> Result<(), RecordError> {
    let wait_s = settling.wait_s(settle_s);
    if wait_s > settle_s {
        return event(&format!(
            "the readings so far ask for a wait of {wait_s:.2} s after each move: the plan's settle_s is {settle_s:.2}"
        ));
    }
    Ok(())
}

fn lag_text(place: &str, lag: &Lag, settle_s: f64) -> String {
    let Lag { left, sigma, constant_s, wait_s } = lag;
    format!(
        "{place} the meter still follows the light when it is read: {:.2} ± {:.2} % of a step is left {settle_s:.2} s after the move, with a time constant of {constant_s:.2} s. From now on it is waited for {wait_s:.2} s. The readings before have that error: begin anew with settle_s = {wait_s:.1}",
        100.0 * left,
        100.0 * sigma,
    )
}

/// A line of a run, as [`kept`] takes it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Seen<'a, K> {
    /// Part and place within the run.
    pub key: K,
    /// Where the stage stood, degrees.
    pub angle_deg: f64,
    /// Seconds since the run's begin.
    pub time_s: f64,
    /// The power, W; not a number where there is none.
    pub power_w: f64,
    /// State of the reading.
    pub state: State,
    /// The meter's range.
    pub range: &'a str,
}

/// The readings that count, in their order: of each place those before the last line that keeps them.
pub fn kept<'a, K: Ord + Copy>(lines: impl Iterator<Item = Seen<'a, K>>) -> Vec<(K, AtAngle)> {
    let mut places: BTreeMap<K, (usize, AtAngle)> = BTreeMap::new();
    let mut now: Vec<Seen<'a, K>> = Vec::new();
    for (place, line) in lines.enumerate() {
        // A place whose reading was broken off, and then another one.
        if now.first().is_some_and(|first| first.key != line.key) {
            now.clear();
        }
        match line.state {
            State::Read | State::Over => now.push(line),
            State::Again => now.clear(),
            State::Kept => {
                let n = now.len().max(1) as f64;
                let read = now.iter().filter(|l| l.state == State::Read);
                let at = AtAngle {
                    angle_deg: line.angle_deg,
                    time_s: now.iter().map(|l| l.time_s).sum::<f64>() / n,
                    power_w: read.map(|l| l.power_w).collect(),
                    over: now.iter().filter(|l| l.state == State::Over).count(),
                    range: line.range.to_owned(),
                };
                places.insert(line.key, (place, at));
                now.clear();
            }
        }
    }
    let mut found: Vec<(K, (usize, AtAngle))> = places.into_iter().collect();
    found.sort_by_key(|(_, (place, _))| *place);
    found.into_iter().map(|(key, (_, at))| (key, at)).collect()
}
