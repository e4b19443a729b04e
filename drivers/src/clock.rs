//! Time as drivers see it: a clock that a test can turn by hand, deadlines on it, and a token that ends every wait.
//!
//! A [`Deadline`] carries its clock and its [`Cancel`] token, so that one argument says how long a call may take, on
//! whose clock, and who may end it early. On a [`VirtualClock`] a thousand timeouts pass in no time.

use hifitime::{Epoch, TimeScale};
use std::fmt;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, OnceLock, PoisonError};
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

/// The longest sleep between two looks at the cancel token.
pub(crate) const SLICE: Duration = Duration::from_millis(20);

/// A monotonic clock.
pub trait Clock: Send + Sync + fmt::Debug {
    /// Time since the clock's own start; never goes back.
    fn now(&self) -> Duration;
    /// Returns once `time` has passed.
    fn sleep(&self, time: Duration);
    /// Longest sleep between two looks at a cancel token.
    fn longest_sleep(&self) -> Duration {
        SLICE
    }
}

/// UTC of the computer's clock as it stands now: it steps when somebody sets it.
pub fn computer_utc() -> Epoch {
    let since_1970 = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
    let nanoseconds = i128::try_from(since_1970.as_nanos()).unwrap_or(i128::MAX);
    let epoch = Epoch::from_unix_duration(hifitime::Duration::from_total_nanoseconds(nanoseconds));
    epoch.to_time_scale(TimeScale::TAI)
}

/// UTC that never steps: the computer's clock at a moment, carried on by a monotonic clock.
///
/// The monotonic clock follows the rate corrections of NTP, so that a clock that is steered stays right. A step changes nothing until it is adopted.
#[derive(Debug, Clone, Copy)]
struct SteadyUtc {
    utc: Epoch,
    monotonic: Duration,
}

impl SteadyUtc {
    fn at(&self, monotonic: Duration) -> Epoch {
        let passed = monotonic.saturating_sub(self.monotonic).as_nanos();
        let passed = i128::try_from(passed).unwrap_or(i128::MAX);
        self.utc + hifitime::Duration::from_total_nanoseconds(passed)
    }
}

static STEADY: Mutex<Option<SteadyUtc>> = Mutex::new(None);
static ADOPTED: AtomicU64 = AtomicU64::new(0);

/// UTC for time stamps and plans: the computer's clock as it stood when it was first asked, carried on by the monotonic clock. It does not step
/// with the computer's clock: see [`clock_offset_s`] and [`adopt_computer_clock`].
pub fn utc_now() -> Epoch {
    let monotonic = SystemClock.now();
    let mut steady = STEADY.lock().unwrap_or_else(PoisonError::into_inner);
    steady.get_or_insert_with(|| SteadyUtc { utc: computer_utc(), monotonic }).at(monotonic)
}

/// How far the computer's clock has stepped away from [`utc_now`], s: above zero where it jumped ahead. It is near zero where it did not.
pub fn clock_offset_s() -> f64 {
    let steady = utc_now();
    (computer_utc() - steady).to_seconds()
}

/// Lets [`utc_now`] go on from the computer's clock as it stands now. Gives the step, s.
pub fn adopt_computer_clock() -> f64 {
    let step_s = clock_offset_s();
    let now = SteadyUtc { utc: computer_utc(), monotonic: SystemClock.now() };
    *STEADY.lock().unwrap_or_else(PoisonError::into_inner) = Some(now);
    ADOPTED.fetch_add(1, Ordering::SeqCst);
    step_s
}

/// How often the computer's clock was adopted: who keeps times of before begins anew when this changes.
pub(crate) fn adoptions() -> u64 {
    ADOPTED.load(Ordering::SeqCst)
}

/// The computer's monotonic clock.
#[derive(Debug, Clone, Copy, Default)]
pub struct SystemClock;

impl Clock for SystemClock {
    fn now(&self) -> Duration {
        static START: OnceLock<Instant> = OnceLock::new();
        START.get_or_init(Instant::now).elapsed()
    }

    fn sleep(&self, time: Duration) {
        std::thread::sleep(time);
    }
}

/// A clock that only moves when somebody sleeps on it. Clones show the same time.
#[derive(Debug, Clone, Default)]
pub struct VirtualClock {
    nanoseconds: Arc<AtomicU64>,
}

impl VirtualClock {
    /// A clock at zero.
    pub fn new() -> Self {
        Self::default()
    }
}

impl Clock for VirtualClock {
    fn now(&self) -> Duration {
        Duration::from_nanos(self.nanoseconds.load(Ordering::SeqCst))
    }

    fn sleep(&self, time: Duration) {
        let step = u64::try_from(time.as_nanos()).unwrap_or(u64::MAX);
        // 584 years; it stays there rather than starting again.
        let _ = self
            .nanoseconds
            .fetch_update(Ordering::SeqCst, Ordering::SeqCst, |now| Some(now.saturating_add(step)));
    }
}

/// A token that ends waits early: given to a call through its [`Deadline`], kept by whoever may want to stop it (a key,
/// a signal, another thread). Clones are one token. Once set, it stays set.
#[derive(Debug, Clone, Default)]
pub struct Cancel(Arc<AtomicBool>);

impl Cancel {
    /// A token that is not set.
    pub fn new() -> Self {
        Self::default()
    }

    /// Ends every wait that knows this token.
    pub fn cancel(&self) {
        self.0.store(true, Ordering::SeqCst);
    }

    /// Whether somebody has asked to stop.
    pub fn is_cancelled(&self) -> bool {
        self.0.load(Ordering::SeqCst)
    }
}

/// Why a wait ended before what it waited for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum Expired {
    /// The time is over.
    #[error("no answer within {:.3} s", after.as_secs_f64())]
    Timeout {
        /// How long was waited.
        after: Duration,
    },
    /// The [`Cancel`] token was set.
    #[error("cancelled after {:.3} s", after.as_secs_f64())]
    Cancelled {
        /// How long was waited.
        after: Duration,
    },
}

/// Until when a call may take, on which clock, and with which [`Cancel`] token.
#[derive(Debug, Clone)]
pub struct Deadline {
    clock: Arc<dyn Clock>,
    cancel: Cancel,
    start: Duration,
    end: Duration,
}

impl Deadline {
    /// `time` from now on the clock.
    pub fn after(clock: Arc<dyn Clock>, time: Duration) -> Self {
        let start = clock.now();
        Self { clock, cancel: Cancel::new(), start, end: start.saturating_add(time) }
    }

    /// `time` from now on the computer's clock.
    pub fn within(time: Duration) -> Self {
        Self::after(Arc::new(SystemClock), time)
    }

    /// The same deadline, which `cancel` can end early.
    #[must_use]
    pub fn with_cancel(mut self, cancel: &Cancel) -> Self {
        self.cancel = cancel.clone();
        self
    }

    /// `time` from now, but never later than this deadline: for one step of a longer call.
    #[must_use]
    pub fn at_most(&self, time: Duration) -> Self {
        let start = self.clock.now();
        Self { start, end: self.end.min(start.saturating_add(time)), ..self.clone() }
    }

    /// `time` from now on the same clock, whatever happened to this deadline or its token: for what must still be done
    /// after it, such as stopping a motor.
    #[must_use]
    pub fn grace(&self, time: Duration) -> Self {
        Self::after(self.clock.clone(), time)
    }

    /// The clock's time.
    pub fn now(&self) -> Duration {
        self.clock.now()
    }

    /// How long ago this deadline was set.
    pub fn elapsed(&self) -> Duration {
        self.now().saturating_sub(self.start)
    }

    /// Returns the time left, more than zero.
    ///
    /// # Errors
    /// The time is over or the token was set.
    pub fn remaining(&self) -> Result<Duration, Expired> {
        let now = self.now();
        let after = now.saturating_sub(self.start);
        if self.cancel.is_cancelled() {
            return Err(Expired::Cancelled { after });
        }
        match self.end.saturating_sub(now) {
            Duration::ZERO => Err(Expired::Timeout { after }),
            left => Ok(left),
        }
    }

    /// Returns the time left, at most the time that a blocking call may take before it has to look at the token again.
    ///
    /// # Errors
    /// The errors of [`remaining`](Self::remaining).
    pub fn slice(&self) -> Result<Duration, Expired> {
        Ok(self.remaining()?.min(SLICE))
    }

    /// Sleeps for `time`.
    ///
    /// # Errors
    /// The deadline came first (and has now passed), or the token was set.
    pub fn sleep(&self, time: Duration) -> Result<(), Expired> {
        let wake = self.now().saturating_add(time);
        loop {
            let left = wake.saturating_sub(self.now());
            if left.is_zero() {
                return Ok(());
            }
            self.clock.sleep(left.min(self.remaining()?).min(self.clock.longest_sleep()));
        }
    }
}

/// A monotonic clock, and UTC as it goes with it.
#[derive(Debug, Clone)]
pub struct DeviceClock {
    /// Clock that waits go by.
    pub clock: Arc<dyn Clock>,
    /// UTC where the clock shows zero; `None` for [`utc_now`].
    pub zero_utc: Option<Epoch>,
}

impl DeviceClock {
    /// The computer's.
    pub fn live() -> Self {
        Self { clock: Arc::new(SystemClock), zero_utc: None }
    }

    /// UTC now.
    pub fn utc(&self) -> Epoch {
        match self.zero_utc {
            None => utc_now(),
            Some(zero) => {
                let passed = i128::try_from(self.clock.now().as_nanos()).unwrap_or(i128::MAX);
                zero + hifitime::Duration::from_total_nanoseconds(passed)
            }
        }
    }

    /// Whether it is the computer's own.
    pub fn is_live(&self) -> bool {
        self.zero_utc.is_none()
    }

    /// How long it is until then; zero where that is past.
    pub fn until(&self, then: Epoch) -> Duration {
        let left = (then - self.utc()).total_nanoseconds();
        Duration::from_nanos(u64::try_from(left.max(0)).unwrap_or(u64::MAX))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Truth: arithmetic. A day of sleeping on a virtual clock is exact and takes no time.
    #[test]
    fn a_virtual_clock_passes_thousands_of_timeouts() {
        let clock = Arc::new(VirtualClock::new());
        let begun = Instant::now();
        for _ in 0..10_000 {
            let deadline = Deadline::after(clock.clone(), Duration::from_secs(1));
            let expired = deadline.sleep(Duration::from_secs(9)).unwrap_err();
            assert_eq!(expired, Expired::Timeout { after: Duration::from_secs(1) });
        }
        assert_eq!(clock.now(), Duration::from_secs(10_000));
        assert!(begun.elapsed() < Duration::from_secs(10), "a virtual second must not be real");
    }

    /// Truth: arithmetic: 7.25 s on the monotonic clock are 7.25 s of UTC, whatever the computer's clock does meanwhile.
    #[test]
    fn steady_utc_goes_with_the_monotonic_clock() {
        let utc = sunglint_formats::time::parse_utc("2020-11-18T17:00:00Z").unwrap();
        let steady = SteadyUtc { utc, monotonic: Duration::from_secs(100) };
        let later = steady.at(Duration::from_millis(107_250));
        assert_eq!(sunglint_formats::time::format_utc(later, 3), "2020-11-18T17:00:07.250Z");
        // Two clocks of one computer, read one after the other.
        assert!(clock_offset_s().abs() < 1.0);
        assert!((computer_utc() - utc_now()).to_seconds().abs() < 1.0);
    }

    #[test]
    fn a_step_ends_with_the_whole_and_grace_outlives_it() {
        let clock = Arc::new(VirtualClock::new());
        let whole = Deadline::after(clock.clone(), Duration::from_secs(3));
        assert_eq!(whole.at_most(Duration::from_secs(1)).remaining(), Ok(Duration::from_secs(1)));
        clock.sleep(Duration::from_millis(2500));
        assert_eq!(
            whole.at_most(Duration::from_secs(1)).remaining(),
            Ok(Duration::from_millis(500))
        );
        let cancel = Cancel::new();
        let whole = whole.with_cancel(&cancel);
        cancel.cancel();
        assert_eq!(
            whole.at_most(Duration::from_secs(1)).remaining(),
            Err(Expired::Cancelled { after: Duration::ZERO })
        );
        assert_eq!(whole.grace(Duration::from_secs(1)).remaining(), Ok(Duration::from_secs(1)));
    }

    /// Truth: the other thread cancels after 50 ms of a 60 s sleep; one slice is 20 ms, the rest is for a busy machine.
    #[test]
    fn another_thread_ends_a_real_sleep() {
        let cancel = Cancel::new();
        let deadline = Deadline::within(Duration::from_secs(60)).with_cancel(&cancel);
        let other = std::thread::spawn(move || {
            std::thread::sleep(Duration::from_millis(50));
            cancel.cancel();
        });
        assert!(matches!(deadline.sleep(Duration::from_secs(60)), Err(Expired::Cancelled { .. })));
        assert!(deadline.elapsed() < Duration::from_secs(5));
        other.join().unwrap();
    }
}
