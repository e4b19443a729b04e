//! A simulated motor with a counter, a reference and limits: what the simulated stages of several protocols turn.

use std::time::Duration;

#[derive(Debug, Clone, Copy)]
struct Leg {
    from: i64,
    to: i64,
    since: Duration,
    /// Whether it searches its reference, which lies at the end.
    search: bool,
}

/// End of a motion.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Ended {
    /// Where it was sent.
    There,
    /// At its reference, where the counter is now zero.
    Referenced,
    /// At an obstacle or a limit.
    Short,
}

/// The motor. Places are counts from where it stood when it was switched on.
#[derive(Debug, Clone)]
pub(crate) struct Motor {
    /// Speed, counts/s.
    pub speed: i64,
    /// Where the reference is.
    pub reference: i64,
    /// Where the limits are.
    pub limits: Option<[i64; 2]>,
    /// The motor cannot pass this place.
    pub obstacle: Option<i64>,
    place: i64,
    offset: i64,
    referenced: bool,
    leg: Option<Leg>,
    /// Where the motion should have ended.
    wanted: i64,
}

impl Motor {
    /// A motor that has just been switched on.
    pub fn new(speed: i64, reference: i64, limits: Option<[i64; 2]>) -> Self {
        Self {
            speed: speed.max(1),
            reference,
            limits,
            obstacle: None,
            place: 0,
            offset: 0,
            referenced: false,
            leg: None,
            wanted: 0,
        }
    }

    /// Where it stands.
    pub fn place(&self) -> i64 {
        self.place
    }

    /// The counter, which has 32 bits.
    pub fn counter(&self) -> i32 {
        (self.place - self.offset) as i32
    }

    /// Whether it moves.
    pub fn is_moving(&self) -> bool {
        self.leg.is_some()
    }

    /// Whether it found its reference since it was switched on.
    pub fn is_referenced(&self) -> bool {
        self.referenced
    }

    /// Takes the place where it stands for its reference.
    pub fn assume_reference(&mut self) {
        (self.offset, self.referenced) = (self.place, true);
    }

    /// Whether it searches its reference.
    pub fn is_searching(&self) -> bool {
        self.leg.is_some_and(|leg| leg.search)
    }

    /// Whether it stands at the lower or upper limit.
    pub fn at_limit(&self) -> [bool; 2] {
        let [low, high] = self.limits.unwrap_or([i64::MIN, i64::MAX]);
        [self.place <= low, self.place >= high]
    }

    /// Forgets its reference and its counter, as without power.
    pub fn power_cycle(&mut self) {
        (self.offset, self.referenced, self.leg) = (self.place, false, None);
    }

    /// When the motion ends, if nothing stops it.
    pub fn ends(&self) -> Option<Duration> {
        let leg = self.leg?;
        let nanoseconds =
            i128::from((leg.to - leg.from).abs()) * 1_000_000_000 / i128::from(self.speed) + 1;
        Some(leg.since + Duration::from_nanos(u64::try_from(nanoseconds).unwrap_or(u64::MAX / 4)))
    }

    /// Where it stands at `now`.
    pub fn place_at(&self, now: Duration) -> i64 {
        let Some(leg) = self.leg else { return self.place };
        let way = leg.to - leg.from;
        let time = i128::try_from(now.saturating_sub(leg.since).as_nanos()).unwrap_or(i128::MAX);
        let gone = i128::from(self.speed).saturating_mul(time) / 1_000_000_000;
        // At most the way, which is 64 bits.
        leg.from + way.signum() * gone.min(i128::from(way.abs())) as i64
    }

    /// Lets it turn until `now`; how the motion ended, if it did.
    pub fn advance(&mut self, now: Duration) -> Option<Ended> {
        let leg = self.leg?;
        self.place = self.place_at(now);
        if self.ends().is_some_and(|end| now < end) {
            return None;
        }
        self.place = leg.to;
        self.leg = None;
        if self.place != self.wanted {
            return Some(Ended::Short);
        }
        if !leg.search {
            return Some(Ended::There);
        }
        (self.offset, self.referenced) = (self.place, true);
        Some(Ended::Referenced)
    }

    fn drive(&mut self, to: i64, search: bool, now: Duration) {
        self.wanted = to;
        let mut end = to;
        if let Some([low, high]) = self.limits {
            end = end.clamp(low.min(self.place), high.max(self.place));
        }
        if let Some(obstacle) = self.obstacle
            && (self.place.min(end)..=self.place.max(end)).contains(&obstacle)
        {
            end = obstacle;
        }
        self.leg = Some(Leg { from: self.place, to: end, since: now, search });
    }

    /// Sends it to a value of its counter.
    pub fn go(&mut self, counter: i64, now: Duration) {
        self.drive(self.offset + counter, false, now);
    }

    /// Searches its reference.
    pub fn search(&mut self, now: Duration) {
        self.referenced = false;
        self.drive(self.reference, true, now);
    }

    /// Stops it where it is.
    pub fn stop(&mut self, now: Duration) {
        let _ = self.advance(now);
        self.leg = None;
    }
}
