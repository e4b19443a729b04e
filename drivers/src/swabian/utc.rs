//! Where bins lie in UTC, by the computer's clock.

use super::frame::Bin;
use crate::clock;
use hifitime::Epoch;
use std::collections::VecDeque;

/// Bins whose delays are compared: a minute of 0.1 s bins. In a minute two clocks drift apart by some microseconds.
const BINS: usize = 600;

/// Less of a difference between the clocks is no step, ns.
const STEP_NS: i128 = 20_000_000;

/// Bins are read some time after they ended, never before. The shortest delay of the last ones is the best guess of how far
/// the computer's clock is ahead of the counter's.
#[derive(Debug, Default)]
pub(super) struct Placement {
    /// Reading time less end of the bin, ns.
    delays_ns: VecDeque<i128>,
    /// How often the computer's clock had been adopted when these were measured.
    adoptions: u64,
}

impl Placement {
    /// The start of the bin.
    pub(super) fn start(&mut self, bin: &Bin) -> Epoch {
        self.start_within(bin.start_ps, bin)
    }

    /// The start of a bin that became known by this stretch of a stream.
    pub(super) fn start_within(&mut self, start_ps: i64, read: &Bin) -> Epoch {
        let end_ps = i128::from(read.start_ps) + i128::from(read.width_ps);
        let delay = i128::from(read.read_ns) - end_ps.div_euclid(1000);
        let adoptions = clock::adoptions();
        if adoptions != self.adoptions {
            self.forget();
            self.adoptions = adoptions;
        }
        let delay = self.steady(delay, (clock::clock_offset_s() * 1e9) as i128);
        if self.delays_ns.len() == BINS {
            self.delays_ns.pop_front();
        }
        self.delays_ns.push_back(delay);
        let least = self.delays_ns.iter().copied().min().unwrap_or(delay);
        let unix_ns = i128::from(start_ps).div_euclid(1000) + least;
        Epoch::from_unix_duration(hifitime::Duration::from_total_nanoseconds(unix_ns))
    }

    /// The delay without the step of the computer's clock. The bridge stamps with that clock, before the step or after it:
    /// the nearer of the two to the last delays is meant.
    fn steady(&self, delay: i128, offset: i128) -> i128 {
        let stepped = delay - offset;
        match self.delays_ns.back() {
            _ if offset.abs() < STEP_NS => delay,
            Some(last) if (delay - last).abs() <= (stepped - last).abs() => delay,
            _ => stepped,
        }
    }

    /// The counter's clock jumped, or counting starts anew.
    pub(super) fn forget(&mut self) {
        self.delays_ns.clear();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Truth: arithmetic. Bins of 0.1 s are read 5, 2 and 40 ms after they ended; from the second on their starts are
    /// right but for its 2 ms.
    #[test]
    fn the_shortest_delay_places_bins() {
        let zero_ns = 1_767_225_600_000_000_000; // 2026-01-01 (Unix time 1767225600)
        let mut placement = Placement::default();
        let starts = [5, 2, 40].iter().zip(0..).map(|(late_ms, i)| {
            let bin = Bin {
                start_ps: i * 100_000_000_000,
                width_ps: 100_000_000_000,
                read_ns: zero_ns + (i + 1) * 100_000_000 + late_ms * 1_000_000,
                flags: 0,
                counts: vec![],
                missed: vec![],
            };
            placement.start(&bin)
        });
        let starts: Vec<String> = starts.map(sunglint_formats::time::format_utc_shortest).collect();
        assert_eq!(
            starts,
            ["2026-01-01T00:00:00.005Z", "2026-01-01T00:00:00.102Z", "2026-01-01T00:00:00.202Z"]
        );
    }
}
