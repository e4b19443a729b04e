//! How long something takes, on a machine that does other things too.

use std::hint::black_box;
use std::time::{Duration, Instant};

/// A stretch that is measured at once is at least as long: far above what reading the clock costs.
const LEAST: Duration = Duration::from_micros(200);
/// And this long where the budget allows: below the slices in which a busy system hands out its cores, so that most stretches are undisturbed.
const MOST: Duration = Duration::from_millis(2);
/// Stretches that a median needs.
const FEWEST: usize = 5;
/// Stretches that the budget is divided into.
const WANTED: u32 = 31;

/// The time that one epoch takes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Timing {
    /// Median over the stretches, s.
    pub median_s: f64,
    /// The fastest stretch, s per epoch.
    pub fastest_s: f64,
    /// Stretches.
    pub repeats: usize,
    /// Epochs in each.
    pub epochs: usize,
}

/// Times `epoch`, which is given a number that rises by one with each call, for about `budget` (or five times, where that is longer). A
/// tenth of it goes ahead, to warm up and to see how many epochs make a stretch.
pub(super) fn time<E>(
    budget: Duration,
    mut epoch: impl FnMut(usize) -> Result<f64, E>,
) -> Result<Timing, E> {
    let mut number = 0;
    let mut run = |epochs: usize| -> Result<Duration, E> {
        let start = Instant::now();
        for _ in 0..epochs {
            black_box(epoch(black_box(number))?);
            number = number.wrapping_add(1);
        }
        Ok(start.elapsed())
    };
    let stretch = (budget / WANTED).clamp(LEAST, MOST);
    let (start, mut epochs) = (Instant::now(), 1_usize);
    // Doubling until one run is a good part of a stretch and the warm-up is over.
    let per_epoch_s = loop {
        let spent = run(epochs)?;
        let enough = spent >= stretch / 2;
        if enough && (start.elapsed() >= budget / 10 || spent >= stretch * 4) {
            break spent.as_secs_f64() / epochs as f64;
        }
        if !enough {
            epochs = epochs.saturating_mul(2);
        }
    };
    let epochs = ((stretch.as_secs_f64() / per_epoch_s).ceil() as usize).max(1);
    let (start, mut seconds) = (Instant::now(), Vec::new());
    while seconds.len() < FEWEST || start.elapsed() < budget * 9 / 10 {
        seconds.push(run(epochs)?.as_secs_f64() / epochs as f64);
    }
    seconds.sort_by(f64::total_cmp);
    let (middle, odd) = (seconds.len() / 2, seconds.len() % 2 == 1);
    let median_s =
        if odd { seconds[middle] } else { 0.5 * (seconds[middle - 1] + seconds[middle]) };
    Ok(Timing { median_s, fastest_s: seconds[0], repeats: seconds.len(), epochs })
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::convert::Infallible;

    /// Truth: the system's own sleep, which is never shorter than asked for; a busy machine makes it longer, without a limit.
    #[test]
    fn a_pause_takes_at_least_as_long_as_it_should() {
        let pause = Duration::from_millis(3);
        let mut last = None;
        let timing = time(Duration::from_millis(50), |number| {
            assert!(last.is_none_or(|last| number == last + 1));
            last = Some(number);
            std::thread::sleep(pause);
            Ok::<f64, Infallible>(1.0)
        });
        let Ok(timing) = timing;
        assert!(timing.fastest_s >= 3e-3 && timing.median_s >= timing.fastest_s, "{timing:?}");
        assert!(timing.repeats >= FEWEST && timing.epochs == 1, "{timing:?}");
    }

    #[test]
    fn an_error_ends_it() {
        let timing =
            time(Duration::from_millis(50), |n| if n < 7 { Ok(0.0) } else { Err("seven") });
        assert_eq!(timing, Err("seven"));
    }
}
