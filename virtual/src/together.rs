//! Virtual clocks that wait for each other: what one device does at a time is done before another looks at it later.
//!
//! A virtual night without a mount needs none of this: each device runs on a clock of its own. With a mount the camera's frames depend on where the mount
//! points, and the mount on the frames. So of all devices only the one whose time is the earliest goes on. The order is that of time, then of joining, and not that of threads.

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;
use sunglint_drivers::clock::Clock;

/// Longest sleep at once on such a clock.
const LONGEST: Duration = Duration::from_secs(1);

#[derive(Debug, Default)]
struct Members {
    /// When each member goes on, by its number, ns.
    wakes: BTreeMap<u64, u64>,
    next: u64,
}

/// Group of clocks that wait for each other.
#[derive(Debug, Clone, Default)]
pub struct Together(Arc<(Mutex<Members>, Condvar)>);

impl Together {
    /// A group without members.
    pub fn new() -> Self {
        Self::default()
    }

    fn members(&self) -> MutexGuard<'_, Members> {
        self.0.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// A new member, at zero. The others wait for it until it is dropped.
    pub fn join(&self) -> JoinedClock {
        let mut members = self.members();
        let number = members.next;
        members.next += 1;
        members.wakes.insert(number, 0);
        drop(members);
        JoinedClock { group: self.clone(), number, nanoseconds: AtomicU64::new(0) }
    }
}

/// Clock of one member: a thread of its own has to sleep on it.
#[derive(Debug)]
pub struct JoinedClock {
    group: Together,
    number: u64,
    nanoseconds: AtomicU64,
}

impl Clock for JoinedClock {
    fn now(&self) -> Duration {
        Duration::from_nanos(self.nanoseconds.load(Ordering::SeqCst))
    }

    fn sleep(&self, time: Duration) {
        let step = u64::try_from(time.as_nanos()).unwrap_or(u64::MAX);
        let wake = self.nanoseconds.load(Ordering::SeqCst).saturating_add(step);
        let mut members = self.group.members();
        members.wakes.insert(self.number, wake);
        self.group.0.1.notify_all();
        let is_first = |members: &Members| {
            members.wakes.iter().all(|(number, at)| (*at, *number) >= (wake, self.number))
        };
        while !is_first(&members) {
            members = self.group.0.1.wait(members).unwrap_or_else(PoisonError::into_inner);
        }
        self.nanoseconds.store(wake, Ordering::SeqCst);
    }

    fn longest_sleep(&self) -> Duration {
        LONGEST
    }
}

impl Drop for JoinedClock {
    fn drop(&mut self) {
        self.group.members().wakes.remove(&self.number);
        self.group.0.1.notify_all();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Truth: by hand: three threads that sleep 30, 70 and 110 ms write in the order of time, at equal times in that of joining; one that ends holds up nobody.
    #[test]
    fn the_earliest_goes_on() {
        let group = Together::new();
        let log = Arc::new(Mutex::new(Vec::new()));
        let steps = [30_u64, 70, 110];
        let clocks: Vec<_> = steps.iter().map(|_| group.join()).collect();
        let threads: Vec<_> = clocks
            .into_iter()
            .zip(steps)
            .map(|(clock, step)| {
                let log = log.clone();
                std::thread::spawn(move || {
                    while clock.now() < Duration::from_millis(700) {
                        clock.sleep(Duration::from_millis(step));
                        log.lock().unwrap().push((clock.now().as_millis() as u64, step));
                    }
                })
            })
            .collect();
        threads.into_iter().for_each(|thread| thread.join().unwrap());
        let mut expected: Vec<(u64, u64)> = steps
            .iter()
            .flat_map(|step| (1..=700_u64.div_ceil(*step)).map(move |k| (k * step, *step)))
            .collect();
        expected.sort();
        assert_eq!(*log.lock().unwrap(), expected);
    }
}
