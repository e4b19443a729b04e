//! Meters that measure by themselves: they tell their last value until the next one is there.

use super::DeviceError;
use crate::clock::Deadline;
use std::time::Duration;

/// Wait before a reading, in times from one value to the next: the rest is for times that are not even, and for those that were measured a little short.
const MARGIN: f64 = 1.3;
/// The same for a wait after which a value that has not changed tells that the time between values is longer than it was taken to be.
const LATE: f64 = 1.5;
/// Changes that are waited for when the time is measured, the least that tell it, how long this may take, and how long where there are some changes, but too few.
const ENOUGH: usize = 24;
const LEAST: usize = 3;
const LOOK: Duration = Duration::from_secs(3);
const LOOK_ON: Duration = Duration::from_secs(8);
/// Pause between two questions while changes are waited for, beside the time that the line takes.
const PAUSE: Duration = Duration::from_millis(5);
/// Longest wait for a value that differs from the last one.
const PATIENCE: Duration = Duration::from_secs(2);

/// Time from one value of a meter that measures by itself to the next.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Update {
    /// A person or the maker said so.
    Known(Duration),
    /// It is measured by when values change. Until then, and where they do not change, it is taken to be this.
    Measured(Duration),
}

/// Account of the readings of a meter that measures by itself.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Repeats {
    /// Readings that were handed on.
    pub readings: u64,
    /// Those of them that were equal to the one before: measured anew, as far as the time tells.
    pub equal: u64,
    /// Answers that were taken for a copy of the reading before, and asked for anew.
    pub discarded: u64,
    /// Time from one value to the next.
    pub period: Duration,
    /// Whether that time was measured; otherwise it is what was said or assumed.
    pub is_measured: bool,
}

/// Takes readings that a meter measured after it was asked, so that none is a copy of the one before.
///
/// Each reading is asked for once a new value must be there. Equal readings are no sign of a copy where a meter has few digits, in the dark above all. Only where each of the last 16 readings
/// differed from the one before is an equal one asked for anew, for [`PATIENCE`] or three waits at most.
#[derive(Debug)]
pub(crate) struct Pace<V> {
    rule: Update,
    measured: Option<Duration>,
    /// Whether it is to be measured before the next reading.
    due: bool,
    /// Changes since it was looked for in vain, and how many of them let it be looked for again.
    changes: u32,
    again: u32,
    last: Option<V>,
    /// Whether the last 16 pairs of readings differed, the newest in the lowest bit.
    differed: u16,
    counts: Repeats,
}

impl<V: Copy + PartialEq> Pace<V> {
    pub fn new(rule: Update) -> Self {
        Self {
            rule,
            measured: None,
            due: false,
            changes: 0,
            again: 0,
            last: None,
            differed: 0,
            counts: Repeats::default(),
        }
    }

    /// Measures the time anew before the next reading: a setting has changed it.
    pub fn forget(&mut self) {
        self.due = self.last.is_some();
        // What was found before no longer holds, also where the next look finds nothing.
        self.measured = None;
        (self.changes, self.again, self.differed) = (0, 0, 0);
    }

    pub fn period(&self) -> Duration {
        match self.rule {
            Update::Known(period) => period,
            Update::Measured(assumed) => self.measured.unwrap_or(assumed),
        }
    }

    pub fn repeats(&self) -> Repeats {
        let is_measured = self.measured.is_some();
        Repeats { period: self.period(), is_measured, ..self.counts }
    }

    /// Takes a reading that was measured after this call began. `ask` gives what the meter shows.
    pub fn read(
        &mut self,
        device: &'static str,
        deadline: &Deadline,
        mut ask: impl FnMut(&Deadline) -> Result<V, DeviceError>,
    ) -> Result<V, DeviceError> {
        let expired = |expired| DeviceError::expired(device, "waiting for a new value", expired);
        if self.due && matches!(self.rule, Update::Measured(_)) {
            self.measure(deadline, &mut ask);
        }
        let wait = self.period().mul_f64(MARGIN);
        deadline.sleep(wait).map_err(expired)?;
        let mut value = ask(deadline)?;
        let mut differs = self.last.is_some_and(|last| last != value);
        // All of the last 16 pairs differed.
        if self.last == Some(value) && self.differed == u16::MAX {
            let begun = deadline.now();
            let room = deadline.remaining().map_err(expired)? / 2;
            let patience = PATIENCE.max(wait * 3).min(room);
            while self.last == Some(value) && deadline.now().saturating_sub(begun) < patience {
                deadline.sleep(PAUSE).map_err(expired)?;
                value = ask(deadline)?;
            }
            let took = deadline.now().saturating_sub(begun);
            let is_other = self.last != Some(value);
            self.counts.discarded += u64::from(is_other);
            // A next value that comes in its time says that this one was equal by chance.
            let is_late = is_other && took > wait.mul_f64(LATE);
            self.due |= is_late;
            differs = is_late;
        }
        self.count(value, differs);
        Ok(value)
    }

    fn count(&mut self, value: V, differs: bool) {
        self.counts.readings += 1;
        match self.last.replace(value) {
            // The first reading cannot be a copy.
            None => self.due = true,
            Some(last) => {
                self.differed = self.differed << 1 | u16::from(differs);
                self.counts.equal += u64::from(last == value);
                self.changes += u32::from(last != value);
                self.due |= self.measured.is_none() && self.changes >= self.again.max(1);
            }
        }
    }

    /// Measures the time from one value to the next. Whatever fails here fails again with the reading, and is told there.
    fn measure(
        &mut self,
        deadline: &Deadline,
        ask: &mut impl FnMut(&Deadline) -> Result<V, DeviceError>,
    ) {
        self.due = false;
        self.changes = 0;
        self.again = self.again.saturating_mul(2).max(4);
        let Ok(room) = deadline.remaining() else { return };
        let begun = deadline.now();
        let (mut changes, mut asked, mut last) = (Vec::new(), 0, None);
        while changes.len() < ENOUGH {
            let look = if (1..LEAST).contains(&changes.len()) { LOOK_ON } else { LOOK };
            if deadline.now().saturating_sub(begun) >= look.min(room / 2) {
                break;
            }
            let Ok(value) = ask(deadline) else { break };
            asked += 1;
            if last.replace(value).is_some_and(|last| last != value) {
                changes.push(deadline.now());
            }
            if deadline.sleep(PAUSE).is_err() {
                break;
            }
        }
        let step = deadline.now().saturating_sub(begun) / asked.max(1);
        self.measured = period(&changes, step).or(self.measured);
    }
}

/// The time from one value to the next, of when values were seen to change, looked at every `step`. A value that is equal to the one before by chance makes a gap of twice the time, so
/// that long gaps are left out.
fn period(changes: &[Duration], step: Duration) -> Option<Duration> {
    if changes.len() < LEAST {
        return None;
    }
    let mut gaps: Vec<Duration> = changes.windows(2).map(|pair| pair[1] - pair[0]).collect();
    gaps.sort_unstable();
    let most = (gaps[gaps.len() / 4] + step).mul_f64(1.5);
    gaps.retain(|gap| *gap <= most);
    let sum: Duration = gaps.iter().sum();
    u32::try_from(gaps.len()).ok().map(|n| sum / n.max(1))
}
